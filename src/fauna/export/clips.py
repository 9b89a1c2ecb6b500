"""Clips."""

from fauna.export.animal import Clip, RiggedAnimal


def author_clips(animal: RiggedAnimal) -> tuple[tuple[Clip, ...], tuple[str, ...]]:
    """TODO."""
    return (), ()
