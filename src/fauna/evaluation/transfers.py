"""Keypoint transfers of a baseline, kept so that they can be scored again without encoder and model."""

import io
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import numpy as np
from jaxtyping import Float

from fauna.data.feature_cache import write_atomically
from fauna.errors import FaunaError
from fauna.evaluation.baselines.base import Bench, Transfer
from fauna.evaluation.store import UNREADABLE, names_digest
from fauna.metrics.sample import Sample
from fauna.metrics.score import score_transfer

Positions = dict[tuple[str, str], Float[np.ndarray, "key 2"]]
"""Predicted NDC by (source, target) photo."""


def record_transfers(
    path: Path,
    prepare: Callable[[Bench], Transfer],
    bench: Bench,
    groups: Mapping[str, Sequence[str]],
    *,
    seed: int,
    pairs: int,
) -> None:
    """Transfer the keypoints of all pairs that are scored, and write them down.

    A file of the same photographs and pairs is left alone; any other, also a damaged one, is replaced.

    Args:
        path: npz file.
        prepare: of the baseline.
        bench: samples and model.
        groups: photographs that are scored together.
        seed: of the pairs.
        pairs: largest number of them per species.
    """
    photos = names_digest(f"{group} {name}" for group, names in groups.items() for name in names)
    if _fits(path, seed=seed, pairs=pairs, photos=photos):
        return
    transfer = prepare(bench)
    positions: Positions = {}
    for names in groups.values():
        samples = [bench.samples[name] for name in names if bench.samples[name].keypoints is not None]

        def recording(source: int, target: int, samples: Sequence[Sample] = samples) -> Float[np.ndarray, "key 2"]:
            first, second = samples[source], samples[target]
            found = np.asarray(transfer(first, second), np.float32)
            positions[first.name, second.name] = found
            return found

        if samples:
            score_transfer(recording, samples, seed=seed, pairs=pairs, bootstrap=1)
    _write(path, positions, seed=seed, pairs=pairs, photos=photos)


def _fits(path: Path, *, seed: int, pairs: int, photos: str) -> bool:
    """Whether a file was recorded for the same pairs of the same photographs; a broken one does not fit."""
    try:
        with np.load(io.BytesIO(path.read_bytes())) as content:
            return (int(content["seed"]), int(content["pairs"]), str(content["photos"])) == (seed, pairs, photos)
    except UNREADABLE:
        return False


def read_transfers(path: Path, *, seed: int, pairs: int) -> Positions:
    """What :func:`record_transfers` wrote.

    Raises:
        FaunaError: when it is missing or damaged, or was made for other pairs.
    """
    try:
        with np.load(io.BytesIO(path.read_bytes())) as content:
            made = int(content["seed"]), int(content["pairs"])
            names, places, found = content["names"].tolist(), content["places"], content["positions"]
    except UNREADABLE as error:
        raise FaunaError(
            f"{path} expects stored transfers, got {type(error).__name__}; evaluate the checkpoint again into the same out"
        ) from error
    if made != (seed, pairs):
        raise FaunaError(
            f"{path.stem} was stored for seed={made[0]} pairs={made[1]}, got seed={seed} pairs={pairs}; "
            "evaluate the checkpoint again for other pairs"
        )
    return {(names[source], names[target]): row for (source, target), row in zip(places, found, strict=True)}


def lookup(positions: Positions, samples: Sequence[Sample]) -> Callable[[int, int], Float[np.ndarray, "key 2"]]:
    """The transfer function of stored positions, by index into ``samples``."""

    def transfer(source: int, target: int) -> Float[np.ndarray, "key 2"]:
        pair = samples[source].name, samples[target].name
        if pair not in positions:
            raise FaunaError(f"stored transfers expect the pair {pair[0]} -> {pair[1]}, got none; evaluate anew")
        return positions[pair]

    return transfer


def _write(path: Path, positions: Positions, *, seed: int, pairs: int, photos: str) -> None:
    names = sorted({name for both in positions for name in both})
    number = {name: place for place, name in enumerate(names)}
    places = np.array([[number[source], number[target]] for source, target in positions], np.int32).reshape(-1, 2)
    buffer = io.BytesIO()
    np.savez_compressed(
        buffer,
        names=np.array(names, dtype=str),
        places=places,
        positions=np.array(list(positions.values()), np.float32),
        seed=np.array(seed),
        pairs=np.array(pairs),
        photos=np.array(photos),
    )
    write_atomically(path, buffer.getvalue())
