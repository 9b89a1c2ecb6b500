import math

import pytest
import torch

from fauna.articulation.constraints import LEG_LIMITS, angle_limits
from fauna.errors import FaunaError

UPPER = [10, 13, 16, 19]
MIDDLE = [9, 12, 15, 18]
FEET = [8, 11, 14, 17]


def degrees(name: str) -> torch.Tensor:
    return torch.rad2deg(angle_limits(name, max_angle_deg=60.0, body_sideways_deg=60.0, body_twist_deg=6.0))


@pytest.mark.parametrize("name", list(LEG_LIMITS))
def test_spine_and_swing_do_not_depend_on_the_phase(name):
    limits = degrees(name)
    torch.testing.assert_close(limits[:, 0], torch.full((20,), 60.0))
    torch.testing.assert_close(limits[:8, 1], torch.full((8,), 60.0))
    torch.testing.assert_close(limits[:8, 2], torch.full((8,), 6.0))


@pytest.mark.parametrize(
    ("name", "upper", "middle", "feet"),
    [("early", 18.0, 18.0, 18.0), ("paper", 10.0, 0.0, 0.0), ("released", 0.0, 0.0, 3.0)],
)
def test_sideways_and_twist_of_the_legs(name, upper, middle, feet):
    limits = degrees(name)[:, 1:]
    for bones, expected in ((UPPER, upper), (MIDDLE, middle), (FEET, feet)):
        torch.testing.assert_close(limits[bones], torch.full((4, 2), expected))


def test_no_limit_exceeds_the_maximum():
    limits = angle_limits("paper", max_angle_deg=5.0, body_sideways_deg=60.0, body_twist_deg=6.0)
    assert float(limits.max()) == pytest.approx(math.radians(5.0))


def test_unknown_names_are_refused():
    with pytest.raises(FaunaError, match="early, paper, released, got 'late'"):
        angle_limits("late", max_angle_deg=60.0, body_sideways_deg=60.0, body_twist_deg=6.0)
