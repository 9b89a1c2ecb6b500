"""A mask may show several animals, one animal in several pieces, and specks."""

import numpy as np
from jaxtyping import Bool, Int
from scipy.ndimage import distance_transform_edt, label


def split_animals(
    mask: Bool[np.ndarray, "height width"], *, animal_share: float, speck_share: float
) -> list[Bool[np.ndarray, "height width"]]:
    """The animals of a mask, largest first.

    Connected parts (8 neighbours) with at least ``animal_share`` of the largest part's area are animals. Smaller parts belong
    to the nearest animal, unless they are smaller than ``speck_share`` of the largest: these are dropped.

    Args:
        mask: true on animals.
        animal_share: in (0, 1].
        speck_share: in [0, ``animal_share``].
    """
    labels, count = label(mask, structure=np.ones((3, 3), bool))
    if count == 0:
        return []
    areas = np.bincount(labels.ravel(), minlength=count + 1)[1:]
    order = np.argsort(-areas, kind="stable")
    animals = [int(index) for index in order if areas[index] >= animal_share * areas[order[0]]]
    pieces = [int(index) for index in order[len(animals) :] if areas[index] >= max(speck_share * areas[order[0]], 1)]
    found = [labels == index + 1 for index in animals]
    if pieces:
        _join(found, labels, pieces)
    return found


def _join(
    animals: list[Bool[np.ndarray, "height width"]], labels: Int[np.ndarray, "height width"], pieces: list[int]
) -> None:
    """Add each piece to the animal that is nearest to any of its pixels."""
    distances = [distance_transform_edt(~animal) for animal in animals]
    for index in pieces:
        piece = labels == index + 1
        nearest = int(np.argmin([float(distance[piece].min()) for distance in distances]))
        animals[nearest] |= piece


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
