"""Photos: what a data source must offer, and how a photo becomes tensors."""

import hashlib
from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Literal

import numpy as np
import torch
from jaxtyping import Bool, Float, UInt8
from PIL import Image
from torch import Tensor

from fauna.data.crop_box import CropBox, read_box, valid_mask
from fauna.data.photo_files import decode_image, digest_file, file_stamp, read_keypoints
from fauna.data.stored import StoredFile
from fauna.data.truth import Truth3D
from fauna.errors import FaunaError

MaskSource = Literal["annotation", "box"]
"""Whether a mask was annotated (or segmented), or is only the box around the animal: good enough to place a crop, not to compare with."""

MASK_THRESHOLD = 127  # 8-bit mask values above it are foreground; robust to JPEG masks


@dataclass(frozen=True)
class RawPhoto:
    """A decoded, square crop around one animal.

    Attributes:
        image: (side, side, 3) 8-bit RGB, background kept.
        mask: (side, side) True on the animal.
        box: window of the crop in the original photo, if known.
        keypoints: (key, 3) x, y in crop pixels (0 is the left or top edge) and 1 where annotated, if known.
        mask_source: ``box`` where ``mask`` is only the box around the animal: not for training, not for silhouette IoU.
    """

    image: UInt8[np.ndarray, "side side 3"]
    mask: Bool[np.ndarray, "side side"]
    box: CropBox | None
    keypoints: Float[np.ndarray, "key 3"] | None
    mask_source: MaskSource = "annotation"


class PhotoSource(ABC):
    """Something a photo can be read from. Implementations are frozen dataclasses (hashable)."""

    @abstractmethod
    def read(self) -> RawPhoto:
        """Decode or generate the photo; raises FaunaError when it cannot be used."""

    @abstractmethod
    def content_key(self) -> str:
        """Hexadecimal digest that changes whenever the picture changes; the feature cache's key."""

    def annotation_key(self) -> str:
        """Changes with whatever is annotated beyond what :meth:`content_key` covers; scores depend on it, features do not."""
        return ""

    def pictured(self) -> str:
        """Names what is pictured, in whatever dataset, size or crop: the drawn individual, or the photograph's file.

        Raises:
            FaunaError: when the file cannot be read.
        """
        return self.content_key()

    def stamp(self) -> str:
        """Changes whenever the photo's files do, without reading them; tells a screened photo from a new one."""
        return self.content_key()

    @property
    def mask_source(self) -> MaskSource:
        """Of the photo that :meth:`read` gives, known without reading it."""
        return "annotation"

    def truth(self) -> Truth3D | None:
        """Geometry behind the crop, where it is known."""
        return None


@dataclass(frozen=True)
class Photo:
    """One crop of a data set.

    Attributes:
        name: unique within the data set, for messages, reports and split files.
        category: species.
        photograph: the original photograph; all crops of one photograph go to the same split.
        source: where the pixels come from.
        feature_map: published ``feat16.png`` of the photo, if any.
    """

    name: str
    category: str
    photograph: str
    source: PhotoSource
    feature_map: StoredFile | None = None


@dataclass(frozen=True)
class LoadedPhoto:
    """A photo at a chosen resolution.

    Attributes:
        image: (3, size, size) in [0, 1].
        mask: (size, size) share of each pixel's area that is foreground, in [0, 1].
        valid: (size, size) 1 where the pixel comes from inside the original photo.
        keypoints: (key, 3) NDC x, y (y down) and 1 where annotated, or ``None``.
    """

    image: Float[Tensor, "3 size size"]
    mask: Float[Tensor, "size size"]
    valid: Float[Tensor, "size size"]
    keypoints: Float[Tensor, "key 3"] | None


@dataclass(frozen=True)
class FileSource(PhotoSource):
    """A crop stored as files, on their own or in a shard.

    Attributes:
        image: ``.jpg`` or ``.png``.
        mask: 8-bit, first channel counts, above 127 is foreground.
        box: ``box.txt``, optional.
        keypoints: JSON ``{"keypoints": [[x, y, annotated], ...]}`` in crop pixels, optional.
        num_keypoints: how many the dataset has names for; ``None`` when it names none.
    """

    image: StoredFile
    mask: StoredFile
    box: StoredFile | None = None
    keypoints: StoredFile | None = None
    num_keypoints: int | None = None

    def read(self) -> RawPhoto:
        """Decode and check all files.

        Raises:
            FaunaError: for a missing or broken file, a crop that is not square, sizes that differ, or an empty mask.
        """
        image = decode_image(self.image, "RGB")
        mask_values = decode_image(self.mask, None)
        mask_values = mask_values if mask_values.ndim == 2 else mask_values[..., 0]
        height, width = image.shape[:2]
        if height != width:
            raise FaunaError(f"{self.image} expects a square crop, got {width}x{height}; crop it around the animal")
        if mask_values.shape != (height, width):
            mask_height, mask_width = mask_values.shape
            raise FaunaError(
                f"{self.mask} expects the image's size {width}x{height}, got {mask_width}x{mask_height}; remake it"
            )
        mask = mask_values.astype(np.int64) > MASK_THRESHOLD
        if not mask.any():
            raise FaunaError(
                f"{self.mask} expects foreground (values above {MASK_THRESHOLD}), got a largest value of {mask_values.max()}; remake it"
            )
        box = read_box(self.box) if self.box is not None else None
        return RawPhoto(image, mask, box, self._keypoints())

    def content_key(self) -> str:
        """Digest of the image file's bytes."""
        return digest_file(self.image)

    def annotation_key(self) -> str:
        """Digest of the bytes of mask, box and keypoints."""
        digest = hashlib.blake2b(digest_size=16)
        for path in (self.mask, self.box, self.keypoints):
            digest.update(digest_file(path).encode() if path is not None and path.is_file() else b"absent")
        return digest.hexdigest()

    def stamp(self) -> str:
        """Path, size and time of last change of every file, and how many keypoints are expected."""
        files = (self.image, self.mask, self.box, self.keypoints)
        return "|".join((*(file_stamp(path) for path in files), str(self.num_keypoints)))

    def _keypoints(self) -> Float[np.ndarray, "key 3"] | None:
        if self.keypoints is None:
            return None
        points = read_keypoints(self.keypoints)
        if self.num_keypoints not in (None, len(points)):
            raise FaunaError(
                f"{self.keypoints} expects {self.num_keypoints} keypoints, as keypoint_names.json names them, "
                f"got {len(points)}; mend one of the two"
            )
        return points


def load_photo(photo: Photo, *, size: int, valid_margin: float) -> LoadedPhoto:
    """Read a photo and bring it to ``size`` pixels.

    Args:
        photo: the photo.
        size: side of the result, pixels.
        valid_margin: untrusted strip along the border of the original photo, crop widths (2 % in 3D-Fauna).

    Raises:
        FaunaError: if the photo cannot be used; the message names the file.
    """
    raw = photo.source.read()
    mask = resize_mask(raw.mask, size)
    if not bool((mask > 0.5).any()):
        raise FaunaError(
            f"photo {photo.name} expects a visible animal, got none left of its mask at {size} px; leave it out"
        )
    keypoints = None
    if raw.keypoints is not None:
        keypoints = torch.from_numpy(raw.keypoints).float()
        keypoints[:, :2] = keypoints[:, :2] * (2.0 / raw.image.shape[1]) - 1.0
    valid = valid_mask(raw.box, size=size, margin=valid_margin)
    return LoadedPhoto(resize_image(raw.image, size), mask, valid, keypoints)


def resize_image(image: UInt8[np.ndarray, "height width 3"], size: int) -> Float[Tensor, "3 size size"]:
    """Bilinear when enlarging, triangle-filtered when shrinking; rounded to 8 bits; values in [0, 1]."""
    resized = Image.fromarray(image).resize((size, size), Image.Resampling.BILINEAR)
    return torch.from_numpy(np.array(resized)).permute(2, 0, 1).contiguous().float() / 255.0


def resize_mask(mask: Bool[np.ndarray, "height width"], size: int) -> Float[Tensor, "size size"]:
    """Share of each pixel's area that is foreground, rounded to 8 bits: as soft on the outline as a rendered silhouette."""
    coverage = Image.fromarray(mask.astype(np.float32)).resize((size, size), Image.Resampling.BOX)
    return torch.from_numpy(np.array(coverage)).mul_(255).round_().div_(255)
