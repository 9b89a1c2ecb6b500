"""Pictures that are in the set twice, nearly twice, or are the next frame of a video: which one is used, and what stays in one split.

The one place that looks at all photographs at once. It holds some 100 bytes of each (:class:`_Looks`) and never a row.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from jaxtyping import Int, UInt64
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from fauna.prepare.hashes import distances, near_pairs
from fauna.prepare.record import Record, Rows
from fauna.prepare.settings import DuplicateSettings
from fauna.prepare.shard import shard_of

STEP = "scan"
NOTHING = -1


@dataclass(frozen=True)
class _Looks:
    """What is compared, an entry for every photograph.

    Attributes:
        photo: id.
        group: digest of the photograph or video.
        frame: number, -1 for photographs.
        sha: first half of the file's digest.
        phash: perceptual hash, 0 where :attr:`has_phash` is not set.
        has_phash: whether there is one.
        rank: the better one of two equal pictures has the larger: annotated mask, then pixels.
        ok: whether it is used so far.
        kept: whether it is to be kept by the list of overrides.
    """

    photo: UInt64[np.ndarray, " photo"]
    group: UInt64[np.ndarray, " photo"]
    frame: Int[np.ndarray, " photo"]
    sha: np.ndarray
    phash: UInt64[np.ndarray, " photo"]
    has_phash: np.ndarray
    rank: Int[np.ndarray, " photo"]
    ok: np.ndarray
    kept: np.ndarray


@dataclass(frozen=True)
class Verdicts:
    """What is found, an entry for every photograph in the order of reading.

    Attributes:
        photo: ids.
        reason: 0 none, else 1 + index into :data:`WORDS`.
        of: index of the photograph that it repeats, -1 without.
        cluster: index of the photograph with the smallest id among those that must stay in one split.
    """

    photo: UInt64[np.ndarray, " photo"]
    reason: Int[np.ndarray, " photo"]
    of: Int[np.ndarray, " photo"]
    cluster: Int[np.ndarray, " photo"]


WORDS = ("duplicate", "same_frame", "near_duplicate")


def find_duplicates(photos: Iterable[Rows], settings: DuplicateSettings) -> Verdicts:
    """Compare all photographs of a set.

    Args:
        photos: rows of every photograph.
        settings: distances.
    """
    looks = _collect(photos)
    count = len(looks.photo)
    reason, of = np.zeros(count, np.int64), np.full(count, NOTHING)
    order = np.lexsort((looks.photo, -looks.rank))  # the better ones first, equal ones by id
    place = np.empty(count, np.int64)
    place[order] = np.arange(count)
    _exact(looks, place, reason, of)
    same = [np.stack([np.nonzero(of >= 0)[0], of[of >= 0]], axis=1)]
    _frames(looks, settings.frame_bits, reason, of)
    pairs, away = _near(looks, place, reason, max(settings.near_bits, settings.same_split_bits))
    close = pairs[away <= settings.near_bits]
    _drop_near(close, place, looks, reason, of)
    same += [pairs[away <= max(settings.same_split_bits, settings.near_bits)], _chains(looks.group)]
    return Verdicts(looks.photo, reason, of, _clusters(np.concatenate(same), looks.photo))


def judged(photos: Iterable[Rows], verdicts: Verdicts) -> Iterator[Record]:
    """The rows with what was found about their photographs; in the order in which the verdicts were found, or any part of it."""
    by_id = np.argsort(verdicts.photo)
    ids = verdicts.photo[by_id]
    for rows in photos:
        index = by_id[np.searchsorted(ids, np.uint64(int(rows[0].photo, 16)))]
        cluster = f"{verdicts.photo[verdicts.cluster[index]]:016x}"
        of = verdicts.of[index]
        repeated = f"{verdicts.photo[of]:016x}" if of >= 0 else None
        for row in rows:
            row = replace(row, cluster=cluster, duplicate_of=repeated)
            reason = verdicts.reason[index]
            yield row.rejected(STEP, WORDS[reason - 1]) if reason and row.ok else row


def photographs(tables: Sequence[Path]) -> Iterator[Rows]:
    """The photographs of several tables, one table after the other; only what is compared is read."""
    from fauna.prepare.tables import read_columns

    for table in tables:
        for part in read_columns(table, COLUMNS):
            yield from _grouped([dict(zip(part, values, strict=True)) for values in zip(*part.values(), strict=True)])


COLUMNS = [
    "id", "photo", "instance", "dataset", "source", "species", "group", "frame", "given_mask", "sha256", "phash",
    "width", "height", "override", "status",
]  # fmt: skip


def _grouped(values: list[dict]) -> Iterator[Rows]:
    for each in values:
        yield (Record.from_values(each),)


def _collect(photos: Iterable[Rows]) -> _Looks:
    """One entry for every photograph; a photograph that comes in several pieces is joined."""
    kind = np.dtype([
        ("photo", "u8"), ("group", "u8"), ("frame", "i8"), ("sha", "S16"), ("phash", "u8"), ("has", "?"), ("rank", "i8"),
        ("ok", "?"), ("kept", "?"),
    ])  # fmt: skip
    entries = np.fromiter((_look(rows) for rows in photos), kind)
    _, first, inverse = np.unique(entries["photo"], return_index=True, return_inverse=True)
    ok, kept = np.zeros(len(first), bool), np.zeros(len(first), bool)
    np.logical_or.at(ok, inverse, entries["ok"])
    np.logical_or.at(kept, inverse, entries["kept"])
    rank = np.zeros(len(first), np.int64)
    np.maximum.at(rank, inverse, entries["rank"])
    entries = entries[first]
    names = ("photo", "group", "frame", "sha", "phash", "has")
    photo, group, frame, sha, phash, has = (np.ascontiguousarray(entries[name]) for name in names)
    return _Looks(photo, group, frame, sha, phash, has, rank, ok, kept)


def _look(rows: Rows) -> tuple:
    row = rows[0]
    pixels = (row.width or 0) * (row.height or 0)
    given = any(each.given_mask is not None for each in rows)
    return (
        int(row.photo, 16),
        shard_of(row.group, 2**64),
        -1 if row.frame is None else row.frame,
        bytes.fromhex((row.sha256 or "")[:32]),
        int(row.phash or "0", 16),
        row.phash is not None,
        (given << 40) + pixels,
        any(each.ok for each in rows),
        any(each.override == "keep" for each in rows),
    )


def _exact(looks: _Looks, place: Int[np.ndarray, " photo"], reason: np.ndarray, of: np.ndarray) -> None:
    (usable,) = np.nonzero(looks.ok)
    order = usable[np.lexsort((place[usable], looks.sha[usable]))]
    if not len(order):
        return
    new = np.r_[True, looks.sha[order][1:] != looks.sha[order][:-1]]
    first = order[np.maximum.accumulate(np.where(new, np.arange(len(order)), 0))]
    reason[order[~new]], of[order[~new]] = 1, first[~new]


def _frames(looks: _Looks, bits: int, reason: np.ndarray, of: np.ndarray) -> None:
    """Within each video, in the order of frames: those that differ too little from the last one kept."""
    usable = np.nonzero(looks.ok & (reason == 0) & (looks.frame >= 0) & looks.has_phash)[0]
    order = usable[np.lexsort((looks.photo[usable], looks.frame[usable], looks.group[usable]))]
    last = NOTHING
    for index in order:
        alike = last >= 0 and looks.group[last] == looks.group[index] and not looks.kept[index]
        if alike and int(looks.phash[last] ^ looks.phash[index]).bit_count() <= bits:
            reason[index], of[index] = 2, last
        else:
            last = index


def _near(looks: _Looks, place: np.ndarray, reason: np.ndarray, bits: int) -> tuple[np.ndarray, np.ndarray]:
    """Pairs of photographs still in use whose hashes are near, and how near. The best one of equal hashes stands for them."""
    (usable,) = np.nonzero(looks.ok & (reason == 0) & looks.has_phash)
    usable = usable[np.lexsort((place[usable], looks.phash[usable]))]
    values, start = np.unique(looks.phash[usable], return_index=True)
    pairs, _ = near_pairs(values, bits)
    first = np.repeat(start, np.diff(np.r_[start, len(usable)]))
    (again,) = np.nonzero(first != np.arange(len(usable)))
    joined = np.concatenate([np.stack([first[again], again], axis=1), start[pairs]])
    joined = usable[joined.astype(np.int64)].reshape(-1, 2)
    return joined, distances(looks.phash[joined[:, 0]], looks.phash[joined[:, 1]])


def _drop_near(pairs: np.ndarray, place: np.ndarray, looks: _Looks, reason: np.ndarray, of: np.ndarray) -> None:
    """Of every pair the one of lesser rank, unless the better one is itself left out."""
    neighbours: dict[int, list[int]] = {}
    for first, second in pairs:
        better, worse = (first, second) if place[first] < place[second] else (second, first)
        neighbours.setdefault(int(worse), []).append(int(better))
    for index in sorted(neighbours, key=lambda each: place[each]):
        used = [better for better in neighbours[index] if reason[better] == 0]
        if used and not looks.kept[index]:
            reason[index], of[index] = 3, min(used, key=lambda each: place[each])


def _chains(group: UInt64[np.ndarray, " photo"]) -> Int[np.ndarray, "pair 2"]:
    """Every photograph with the next one of its group."""
    order = np.argsort(group, kind="stable")
    same = group[order][1:] == group[order][:-1]
    return np.stack([order[:-1][same], order[1:][same]], axis=1)


def _clusters(pairs: Int[np.ndarray, "pair 2"], photo: UInt64[np.ndarray, " photo"]) -> Int[np.ndarray, " photo"]:
    """For every photograph the one with the smallest id among all that pairs join it with."""
    graph = coo_array((np.ones(len(pairs), np.int8), (pairs[:, 0], pairs[:, 1])), shape=(len(photo), len(photo)))
    _, label = connected_components(graph, directed=False)
    order = np.argsort(photo)
    smallest = np.full(int(label.max(initial=-1)) + 1, NOTHING)
    smallest[label[order][::-1]] = order[::-1]  # the last assignment, that of the smallest id, wins
    return smallest[label]
