"""The mirror image of a photo and everything that belongs to it."""

from collections.abc import Sequence

import torch
from jaxtyping import Float, Shaped
from torch import Tensor

from fauna.data.photos import LoadedPhoto


def flip_map(values: Shaped[Tensor, "*lead width"]) -> Shaped[Tensor, "*lead width"]:
    """Mirror images, masks, distances or feature targets left to right."""
    return values.flip(-1)


def flip_keypoints(points: Float[Tensor, "key 3"], swap: Sequence[int]) -> Float[Tensor, "key 3"]:
    """Mirror keypoints and exchange left and right ones.

    Args:
        points: (key, 3) NDC x, y and annotation flag.
        swap: for each keypoint the index of its left-right counterpart, itself where it has none.
    """
    mirrored = points[torch.tensor(list(swap), dtype=torch.long)].clone()
    mirrored[:, 0] = -mirrored[:, 0]
    return mirrored


def flip_photo(photo: LoadedPhoto, swap: Sequence[int] | None) -> LoadedPhoto:
    """Mirror a loaded photo; ``swap`` as in :func:`flip_keypoints`, or ``None`` to drop the keypoints."""
    keypoints = None
    if photo.keypoints is not None and swap is not None:
        keypoints = flip_keypoints(photo.keypoints, swap)
    return LoadedPhoto(flip_map(photo.image), flip_map(photo.mask), flip_map(photo.valid), keypoints)
