"""From a photograph of a dataset to the :class:`~fauna.metrics.sample.Sample` it is scored against."""

import io
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from PIL import Image

from fauna.data.photos import Photo, load_photo
from fauna.errors import FaunaError
from fauna.metrics.sample import Sample

THUMBNAIL = 192
"""Side of the picture kept for the report, pixels."""
KEYPOINT_METRICS = "keypoint metrics"
"""Stands for all of them where a reason concerns all."""


@dataclass(frozen=True)
class ReadSample:
    """What a photograph is scored against.

    Attributes:
        sample: mask, keypoints and truth.
        picture: JPEG of the photograph.
        unnamed_keypoints: whether it has keypoints that are not in the sample because the dataset does not name them.
    """

    sample: Sample
    picture: bytes
    unnamed_keypoints: bool


def read_sample(photo: Photo, *, size: int, keypoint_names: Sequence[str]) -> ReadSample:
    """Mask, keypoints and truth of a photograph, and a JPEG of it.

    Args:
        photo: of the dataset.
        size: side of the mask, pixels.
        keypoint_names: of the dataset, empty when it has none.

    Raises:
        FaunaError: when the photograph cannot be used, or has another number of keypoints than there are names.
    """
    loaded = load_photo(photo, size=size, valid_margin=0.0)
    keypoints = None if loaded.keypoints is None else loaded.keypoints.numpy().astype(np.float32)
    unnamed = keypoints is not None and not keypoint_names
    if unnamed:
        keypoints = None
    if keypoints is not None and len(keypoints) != len(keypoint_names):
        raise FaunaError(
            f"photo {photo.name} expects {len(keypoint_names)} keypoints as the dataset names, got {len(keypoints)}; "
            "mend its annotation"
        )
    boxed = photo.source.mask_source == "box"  # a box is no mask: it must not be scored as one
    sample = Sample(
        name=photo.name,
        category=photo.category,
        mask=None if boxed else (loaded.mask > 0.5).numpy(),
        keypoints=keypoints,
        keypoint_names=tuple(keypoint_names),
        truth=photo.source.truth(),
    )
    picture = Image.fromarray((loaded.image.permute(1, 2, 0).numpy() * 255).round().astype(np.uint8))
    buffer = io.BytesIO()
    picture.resize((THUMBNAIL, THUMBNAIL), Image.Resampling.LANCZOS).save(buffer, format="JPEG", quality=88)
    return ReadSample(sample, buffer.getvalue(), unnamed)
