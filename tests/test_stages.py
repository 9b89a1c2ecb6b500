import pytest

from fauna.build import build_schedule
from fauna.errors import FaunaError
from fauna.stages import Stage
from tests.runs import composed

SCHEDULES = [
    "paper",
    "published",
    "released",
    "laptop",
    "laptop_viewpoints",
    "laptop_bodies",
    "ablation",
    "ablation_bodies",
    "quickstart",
    "tiny",
]


@pytest.fixture(scope="module")
def paper():
    return build_schedule(composed("schedule=paper"))


@pytest.mark.parametrize(
    ("attribute", "boundary", "before", "after"),
    [
        ("articulation", 20_000, False, True),
        ("elevation", 20_000, False, True),
        ("deformation", 500_000, False, True),
        ("adversarial", 80_000, False, True),
        ("adversarial", 300_000, True, False),
        ("legs_attached", 60_000, False, True),
        ("leg_limits", 300_000, "early", "paper"),
    ],
)
def test_switches_are_exact(paper, attribute, boundary, before, after):
    assert getattr(paper.at(boundary - 1), attribute) == before
    assert getattr(paper.at(boundary), attribute) == after


def test_weights_switch(paper):
    assert paper.at(299_999).weight("feature") == 10
    assert paper.at(300_000).weight("feature") == 1
    assert paper.at(299_999).target_weights["feature"] == paper.at(300_000).target_weights["feature"] == 500
    assert paper.at(59_999).weight("articulation") == 0
    assert paper.at(60_000).weight("articulation") == 0.2


def test_exploration(paper):
    assert [paper.at(s).uniform_mix for s in (0, 2000, 3000, 4000)] == [1.0, 1.0, 0.5, 0.0]
    assert [paper.at(s).best_fraction for s in (6000, 7000, 7600, 10**6)] == pytest.approx([0.0, 0.5, 0.8, 0.8])
    assert paper.at(0).temperature == paper.at(1000).temperature == 1.0
    assert paper.at(100_000).temperature == pytest.approx(0.01)
    assert paper.at(10_000).temperature == pytest.approx(0.1)


@pytest.mark.parametrize("name", SCHEDULES)
def test_boundaries_are_where_something_changes(name):
    schedule = build_schedule(composed(f"schedule={name}"))
    edges = schedule.boundaries()
    assert edges == sorted(set(edges))

    def discrete(step):
        stage = schedule.at(step).state()
        return {k: v for k, v in stage.items() if k not in ("temperature", "uniform_mix", "best_fraction", "lr_scale")}

    changes = [edge for edge in edges if discrete(edge - 1) != discrete(edge)]
    assert changes
    for start, stop in zip([0, *changes], [*changes, changes[-1] + 100], strict=True):
        assert discrete(start) == discrete((start + stop) // 2) == discrete(stop - 1)


def test_start_at_shifts_everything():
    plain, late = (build_schedule(composed("schedule=tiny", f"schedule.start_at={n}")) for n in (0, 10))
    assert all(plain.at(step + 10) == late.at(step) for step in range(30))
    assert [edge - 10 for edge in plain.boundaries() if edge > 10] == late.boundaries()


def test_stage_survives_plain_containers(paper):
    stage = paper.at(123_456)
    assert Stage.from_state(stage.state()) == stage


@pytest.mark.parametrize(
    ("override", "message"),
    [
        ("schedule.articulation=[20,10]", "must not end before it starts"),
        ("schedule.articulation=[20]", r"must be \[start, stop\]"),
        ("schedule.weights.feature=[[5,1]]", "from step 0"),
    ],
)
def test_bad_windows(override, message):
    from hydra.errors import InstantiationException

    with pytest.raises(InstantiationException) as caught:
        build_schedule(composed(override))
    assert isinstance(caught.value.__cause__, FaunaError)
    assert __import__("re").search(message, str(caught.value.__cause__))


def test_constant_words_have_no_boundaries():
    steps = build_schedule(composed("schedule=laptop")).boundaries()
    assert build_schedule(composed("schedule=laptop", "schedule.leg_limits=paper")).boundaries() == steps


@pytest.mark.parametrize("value", ["[3]", "[[0,1],[5]]", "[[0,1,2]]", "[]", "[[zero,1]]"])
@pytest.mark.parametrize("key", ["viewpoint_lr", "weights.feature", "grid_resolution"])
def test_what_is_no_list_of_pairs_is_refused(key, value):
    with pytest.raises(Exception, match=rf"schedule\.{key} must be a number or pairs") as caught:
        build_schedule(composed(f"schedule.{key}={value}"))
    assert isinstance(caught.value.__cause__ or caught.value, FaunaError)
