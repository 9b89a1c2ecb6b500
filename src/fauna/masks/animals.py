"""A mask may show several animals, one animal in several pieces, and specks."""

import numpy as np
from jaxtyping import Bool, Int
from scipy.ndimage import distance_transform_edt, label


def split_animals(
    mask: Bool[np.ndarray, "height width"], *, animal_share: float, speck_share: float, same_gap: float
) -> list[Bool[np.ndarray, "height width"]]:
    """The animals of a mask, largest first.

    Connected parts (8 neighbours) with at least ``animal_share`` of the largest part's area are animals; but where only a narrow gap is
    between two of them, something stands before one animal. Smaller parts belong to the nearest animal, unless they are smaller
    than ``speck_share`` of the largest: these are dropped.

    Args:
        mask: true on animals.
        animal_share: in (0, 1].
        speck_share: in [0, ``animal_share``].
        same_gap: widest gap within one animal, extents of its larger part.
    """
    labels, count = connected(mask)
    if count == 0:
        return []
    areas = np.bincount(labels.ravel(), minlength=count + 1)[1:]
    order = np.argsort(-areas, kind="stable")
    large = [int(index) for index in order if areas[index] >= animal_share * areas[order[0]]]
    small = [int(index) for index in order[len(large) :] if areas[index] >= max(speck_share * areas[order[0]], 1)]
    animals: list[Bool[np.ndarray, "height width"]] = []
    for index in large:
        part = labels == index + 1
        nearest, gap = _nearest(animals, part)
        if nearest is not None and gap <= same_gap * extent(nearest):
            nearest |= part
        else:
            animals.append(part)
    for index in small:
        part = labels == index + 1
        nearest, _ = _nearest(animals, part)
        assert nearest is not None, "the largest part is an animal"
        nearest |= part
    return sorted(animals, key=lambda animal: -int(animal.sum()))


def connected(mask: Bool[np.ndarray, "height width"]) -> tuple[Int[np.ndarray, "height width"], int]:
    """Connected parts (8 neighbours) by number from 1, 0 outside; and how many there are."""
    labels = np.zeros(mask.shape, np.int32)
    label(mask, structure=np.ones((3, 3), bool), output=labels)
    return labels, int(labels.max(initial=0))


def extent(mask: Bool[np.ndarray, "height width"]) -> int:
    """Longer side of the bounding box of a mask, which is not empty."""
    rows, columns = np.nonzero(mask)
    return int(max(np.ptp(rows), np.ptp(columns))) + 1


def _nearest(
    animals: list[Bool[np.ndarray, "height width"]], part: Bool[np.ndarray, "height width"]
) -> tuple[Bool[np.ndarray, "height width"] | None, float]:
    """The animal that is nearest to any pixel of a part, and the distance in pixels."""
    if not animals:
        return None, np.inf
    away = np.asarray(distance_transform_edt(~part))
    gaps = [float(away[animal].min()) for animal in animals]
    best = int(np.argmin(gaps))
    return animals[best], gaps[best]


def touched_border(mask: Bool[np.ndarray, "height width"]) -> float:
    """Share of a bounding box's circumference along which the mask lies on the picture's border.

    >>> mask = np.zeros((8, 8), bool)
    >>> mask[2:6, 0:4] = True
    >>> touched_border(mask)
    0.25
    """
    rows, columns = np.nonzero(mask)
    if not len(rows):
        return 0.0
    touching = sum(int(edge.sum()) for edge in (mask[0], mask[-1], mask[:, 0], mask[:, -1]))
    return touching / float(2 * (np.ptp(rows) + 1 + np.ptp(columns) + 1))
