"""Time. A ``Schedule`` turns a step into a frozen ``Stage``; nothing below the LightningModule knows the step.

Windows are half-open ``[start, stop)`` in 0-based steps; ``stop`` of ``None`` means forever, a window of ``None`` means never.
"""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from typing import Any, Literal, TypeGuard

from fauna.errors import FaunaError

Window = Sequence[int | None] | None
Number = int | float
Piecewise = Any
"""A constant, or pairs ``[step, value]`` in ascending order: the value holds from its step on."""


@dataclass(frozen=True)
class Stage:
    """What is switched on at one step, and with which numbers.

    Attributes:
        articulation: bones are placed and posed.
        deformation: instances deform.
        adversarial: the discriminator and its generator loss are active.
        legs_attached: spine bones carry the legs.
        leg_limits: name of the angle limits in ``fauna.articulation.constraints``.
        elevation: the viewpoint may look up or down.
        grid_resolution: of the lattice, ``None`` = as configured.
        hypotheses: render one sampled viewpoint hypothesis per photo, or all.
        temperature: of the hypothesis probabilities.
        uniform_mix: share of the uniform distribution mixed into them.
        best_fraction: share of photos that take their most likely hypothesis.
        lr_scale: factor on every learning rate.
        viewpoint_lr_scale: further factor on that of the viewpoint network.
        weights: weight of each loss term; a missing term has weight 0.
        target_weights: weight of each image term in the hypothesis target.
    """

    articulation: bool = True
    deformation: bool = True
    adversarial: bool = False
    legs_attached: bool = True
    leg_limits: str = "paper"
    elevation: bool = True
    grid_resolution: int | None = None
    hypotheses: Literal["one", "all"] = "one"
    temperature: float = 1.0
    uniform_mix: float = 0.0
    best_fraction: float = 1.0
    lr_scale: float = 1.0
    viewpoint_lr_scale: float = 1.0
    weights: Mapping[str, float] = field(default_factory=dict)
    target_weights: Mapping[str, float] = field(default_factory=dict)

    def weight(self, name: str) -> float:
        """Weight of a loss term, 0 when it is off."""
        return self.weights.get(name, 0.0)

    def state(self) -> dict[str, Any]:
        """Plain containers, for checkpoints and weight files."""
        return {**asdict(self), "weights": dict(self.weights), "target_weights": dict(self.target_weights)}

    @classmethod
    def from_state(cls, state: Mapping[str, Any]) -> "Stage":
        """Inverse of :meth:`state`."""
        return cls(**state)


def in_window(step: int, window: Window) -> bool:
    """Whether ``start <= step < stop``.

    >>> in_window(10, [10, 20]), in_window(20, [10, 20]), in_window(99, [10, None]), in_window(0, None)
    (True, False, True, False)
    """
    if window is None:
        return False
    start, stop = window
    return (start is None or step >= start) and (stop is None or step < stop)


def piecewise(step: int, value: Piecewise) -> Any:
    """A constant, or the value of the last pair that does not begin after ``step``.

    >>> piecewise(299_999, [[0, 10], [300_000, 1]]), piecewise(300_000, [[0, 10], [300_000, 1]]), piecewise(7, 0.5)
    (10, 1, 0.5)
    """
    if not _is_pairs(value):
        return value
    return [held for start, held in value if start <= step][-1]


def ramp(step: int, start: Number, stop: Number) -> float:
    """Linear from 0 at ``start`` to 1 at ``stop``, clamped.

    >>> ramp(0, 10, 20), ramp(15, 10, 20), ramp(30, 10, 20)
    (0.0, 0.5, 1.0)
    """
    return min(max((step - start) / max(stop - start, 1e-9), 0.0), 1.0)


class Schedule:
    """Pure function from step to :class:`Stage` (Training Schedule, Sec. 3.2, and Tab. 6 of the paper).

    Args:
        start_at: step of the schedule at which a run begins; fine-tuning starts late.
        articulation: window in which bones bend.
        deformation: window in which instances deform.
        adversarial: window of the mask discriminator.
        legs_attached: window in which spine bones carry the legs.
        leg_limits: piecewise name of the angle limits, e.g. ``[[0, early], [300000, paper]]``.
        elevation: window in which the viewpoint may leave the horizontal.
        grid_resolution: piecewise lattice resolution, ``None`` = as configured in ``shape``.
        all_hypotheses: window in which all hypotheses are rendered instead of one sampled one.
        temperature: ``{start, stop, steps}``; 1 / clip(step * (start / stop) / steps, 1, start / stop) times start.
        uniform_until: last step of purely uniform sampling and the step from which it is purely learned.
        best_from: steps between which the share of best hypotheses ramps from 0 to ``best_fraction``.
        best_fraction: final share of photos that take their most likely hypothesis.
        lr_decay: ``{start, stop, factor}`` linear decay of the learning rates, ``None`` for constant.
        viewpoint_lr: piecewise factor on the learning rate of the viewpoint network. Once legs separate and bones bend, a
            walking animal seen from the side can also be explained by a standing one at three quarters; viewpoints that
            were found before that are kept by learning slowly.
        weights: loss weights, piecewise constant in the step.
        target_weights: weights of the hypothesis target, piecewise constant.
    """

    def __init__(
        self,
        *,
        start_at: int,
        articulation: Window,
        deformation: Window,
        adversarial: Window,
        legs_attached: Window,
        leg_limits: Piecewise,
        elevation: Window,
        grid_resolution: Piecewise | None,
        all_hypotheses: Window,
        temperature: Mapping[str, Number],
        uniform_until: Sequence[int],
        best_from: Sequence[int],
        best_fraction: Number,
        lr_decay: Mapping[str, Number] | None,
        viewpoint_lr: Piecewise,
        weights: Mapping[str, Piecewise],
        target_weights: Mapping[str, Piecewise],
    ) -> None:
        self.windows = {
            "articulation": articulation,
            "deformation": deformation,
            "adversarial": adversarial,
            "legs_attached": legs_attached,
            "elevation": elevation,
        }
        for name, window in {**self.windows, "all_hypotheses": all_hypotheses}.items():
            _check_window(name, window)
        _check_piecewise("leg_limits", leg_limits)
        _check_piecewise("grid_resolution", grid_resolution)
        _check_piecewise("viewpoint_lr", viewpoint_lr)
        pairs = _is_pairs(viewpoint_lr)
        for factor in [value for _, value in viewpoint_lr] if pairs else [viewpoint_lr]:
            if isinstance(factor, bool) or not isinstance(factor, int | float) or not 0 <= factor < float("inf"):
                raise FaunaError(
                    f"schedule.viewpoint_lr must be a factor >= 0 or pairs [step, factor], got {viewpoint_lr}; e.g. 0.1"
                )
        for group, values in (("weights", weights), ("target_weights", target_weights)):
            for name, value in values.items():
                _check_piecewise(f"{group}.{name}", value)
        self.start_at = start_at
        self.leg_limits = leg_limits
        self.grid_resolution = grid_resolution
        self.all_hypotheses = all_hypotheses
        self.temperature = dict(temperature)
        self.uniform_until = tuple(uniform_until)
        self.best_from = tuple(best_from)
        self.best_fraction = best_fraction
        self.lr_decay = lr_decay
        self.viewpoint_lr = viewpoint_lr
        self.weights = dict(weights)
        self.target_weights = dict(target_weights)

    def at(self, step: int) -> Stage:
        """The stage of a run's 0-based training step."""
        step += self.start_at
        flags = {name: in_window(step, window) for name, window in self.windows.items()}
        return Stage(
            **flags,
            leg_limits=piecewise(step, self.leg_limits),
            grid_resolution=piecewise(step, self.grid_resolution),
            hypotheses="all" if in_window(step, self.all_hypotheses) else "one",
            temperature=self._temperature(step),
            uniform_mix=1.0 - ramp(step, *self.uniform_until),
            best_fraction=self.best_fraction * ramp(step, *self.best_from),
            lr_scale=self._lr_scale(step),
            viewpoint_lr_scale=float(piecewise(step, self.viewpoint_lr)),
            weights={name: float(piecewise(step, value)) for name, value in self.weights.items()},
            target_weights={name: float(piecewise(step, value)) for name, value in self.target_weights.items()},
        )

    def boundaries(self) -> list[int]:
        """Every later step of a run at which something switches, ascending."""
        found = {edge for window in (*self.windows.values(), self.all_hypotheses) for edge in window or () if edge}
        steps = (self.leg_limits, self.grid_resolution, self.viewpoint_lr)
        for value in (*self.weights.values(), *self.target_weights.values(), *steps):
            if _is_pairs(value):
                found.update(int(start) for start, _ in value if start)
        return sorted(edge - self.start_at for edge in found if edge > self.start_at)

    def _temperature(self, step: int) -> float:
        start, stop, steps = (self.temperature[key] for key in ("start", "stop", "steps"))
        ratio = start / stop
        return start / min(max(step * ratio / steps, 1.0), ratio)

    def _lr_scale(self, step: int) -> float:
        if self.lr_decay is None:
            return 1.0
        return 1.0 - (1.0 - self.lr_decay["factor"]) * ramp(step, self.lr_decay["start"], self.lr_decay["stop"])


def _check_window(name: str, window: Window) -> None:
    if window is None:
        return
    if len(window) != 2:
        raise FaunaError(f"schedule.{name} must be [start, stop] or null, got {list(window)}; give two steps")
    start, stop = window
    if start is not None and stop is not None and stop < start:
        raise FaunaError(f"schedule.{name} must not end before it starts, got {list(window)}; swap the two steps")


def _is_pairs(value: Piecewise) -> TypeGuard[Sequence[Any]]:
    return isinstance(value, Sequence) and not isinstance(value, str)


def _check_piecewise(name: str, value: Piecewise) -> None:
    if not _is_pairs(value):
        return
    whole = all(_is_pairs(pair) and len(pair) == 2 and isinstance(pair[0], int) for pair in value)
    starts = [pair[0] for pair in value] if whole else []
    if not starts or starts[0] != 0 or starts != sorted(starts):
        raise FaunaError(
            f"schedule.{name} must be a number or pairs [step, value] from step 0 on in ascending order, got {value}; sort them"
        )
