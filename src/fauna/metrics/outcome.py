"""What a metric is: a function from the cases of one species to tallies and reasons."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

from fauna.metrics.sample import Case, LeftOut
from fauna.metrics.tally import Tally, image_tally


@dataclass(frozen=True)
class Options:
    """Choices of an evaluation.

    Attributes:
        seed: of pairs, splits, surface points.
        pairs: largest number of ordered pairs per species.
        settings: names of settings beyond the plain ones, see :func:`fauna.metrics.score.score`.
        flip: whether the model's +z is the tail, see :func:`fauna.metrics.truth_metrics.global_flip`.
    """

    seed: int
    pairs: int
    settings: frozenset[str]
    flip: bool


@dataclass(frozen=True)
class Outcome:
    """What a metric says about one species.

    Attributes:
        tallies: by key.
        left_out: images that a key does not count; the name of the species stands for all its images.
    """

    tallies: Mapping[str, Tally]
    left_out: Sequence[LeftOut] = field(default=())


Metric = Callable[[Sequence[Case], Options], Outcome]


def per_image(
    cases: Sequence[Case], keys: Sequence[str], measure: Callable[[Case], Mapping[str, float | str]]
) -> Outcome:
    """Outcome of metrics with one number per image.

    Args:
        cases: of one species.
        keys: of the metrics.
        measure: value of each key for a case, or the reason why it has none.
    """
    rows = [measure(case) for case in cases]
    values = {key: [None if isinstance(row[key], str) else float(row[key]) for row in rows] for key in keys}
    tallies = {key: image_tally(values[key]) for key in keys}
    reasons = {key: [row[key] if isinstance(row[key], str) else None for row in rows] for key in keys}
    return Outcome(tallies, [each for key in keys for each in reasons_to_rows(cases, key, reasons[key])])


def reasons_to_rows(cases: Sequence[Case], key: str, reasons: Sequence[str | float | None]) -> list[LeftOut]:
    """One row per image with a reason, or a single one for the species if all share it."""
    shared = set(reasons)
    if len(shared) == 1 and None not in shared and len(cases) > 1:
        return [LeftOut(cases[0].sample.category, key, f"all photos: {reasons[0]}")]
    return [
        LeftOut(case.sample.name, key, str(reason))
        for case, reason in zip(cases, reasons, strict=True)
        if reason is not None
    ]
