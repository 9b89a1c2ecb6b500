"""From photos to batches: pixels, masks, distances, features; decoded photos are kept in memory up to a budget."""

import threading
from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

from fauna.data.distance import distance_maps
from fauna.data.feature_cache import FeatureCache
from fauna.data.feature_map import read_feature_map
from fauna.data.flip import flip_map
from fauna.data.photos import Photo, load_photo, resize_image
from fauna.encoder.base import Encoder
from fauna.types import Batch, Features

FEATURE_MAP_CHANNELS = 16  # of a published ``feat16.png``


@dataclass(frozen=True)
class Pixels:
    """What a batch needs of one photo at render resolution, not mirrored, as small as it can be without loss.

    Attributes:
        image: (3, size, size) 8-bit.
        mask: (size, size) 8-bit.
        distance: (size, size) positive inside, negative outside, image widths.
        valid: (size, size) 8-bit, 0 or 1; ``None`` where all pixels are valid.
    """

    image: Tensor
    mask: Tensor
    distance: Tensor
    valid: Tensor | None

    def size(self) -> int:
        """Bytes in memory."""
        tensors = (self.image, self.mask, self.distance, self.valid)
        return sum(tensor.nbytes for tensor in tensors if tensor is not None)

    def mirrored(self) -> "Pixels":
        """Of the mirror image."""
        valid = None if self.valid is None else flip_map(self.valid)
        return Pixels(flip_map(self.image), flip_map(self.mask), flip_map(self.distance), valid)


class PhotoLoader:
    """Makes batches.

    Args:
        encoder: whose features or input images the batches carry.
        image_size: render resolution, pixels.
        valid_margin: strip along the border of the original photo that is not trusted, crop widths.
        cache_features: look frozen features up on disk; otherwise the batch carries ``encoder_images``.
        memory_megabytes: budget for decoded photos.
    """

    def __init__(
        self, *, encoder: Encoder, image_size: int, valid_margin: float, cache_features: bool, memory_megabytes: int
    ) -> None:
        self.encoder = encoder
        self.image_size = image_size
        self.valid_margin = valid_margin
        self.features = FeatureCache(encoder=encoder, root=None) if cache_features else None
        self._budget = memory_megabytes * 1_000_000
        self._pixels: dict[Photo, Pixels] = {}
        self._lock = threading.Lock()

    def bytes_per_photo(self) -> int:
        """Memory of one photo of a batch."""
        encoder = self.encoder
        maps = (1 if encoder.keys_are_tokens else 2) * encoder.token_dim * encoder.grid_size**2
        values = encoder.global_dim + maps if self.features is not None else 3 * encoder.input_size**2
        return 4 * (7 * self.image_size**2 + values)  # 3 colours, mask, 2 distances, valid

    def reserve(self, steps: int, *, photos: int) -> int:
        """Set memory aside for prepared steps, at most half of the budget; called before photos are read.

        Args:
            steps: wanted beside the one under way.
            photos: of a step.

        Returns:
            How many steps there is room for.
        """
        size = photos * self.bytes_per_photo()
        granted = max(min(steps, self._budget // (2 * size) - 1), 0)
        self._budget -= (granted + 1) * size if granted else 0
        return granted

    def batch(self, photos: Sequence[Photo], flips: Sequence[bool], category: int | None) -> Batch:
        """A batch of photos, each mirrored where ``flips`` says so. Several threads may ask at a time."""
        pixels = [
            self._load(photo).mirrored() if flip else self._load(photo)
            for photo, flip in zip(photos, flips, strict=True)
        ]
        distance = torch.stack([each.distance for each in pixels])
        all_valid = torch.ones_like(pixels[0].mask)
        return Batch(
            images=torch.stack([each.image for each in pixels]).float() / 255.0,
            masks=torch.stack([each.mask for each in pixels]).float() / 255.0,
            distance_inside=distance.clamp(min=0.0),
            distance_outside=distance.neg_().clamp_(min=0.0),
            valid=torch.stack([all_valid if each.valid is None else each.valid for each in pixels]).float(),
            category=category,
            names=tuple(photo.name for photo in photos),
            features=None if self.features is None else self.features.get_many(photos, flips),
            encoder_images=self._encoder_images(photos, flips) if self.features is None else None,
            feature_targets=self._targets(photos, flips),
        )

    def sample(self, photo: Photo) -> tuple[Features, Tensor]:
        """Raw features and mask of one photo, for fitting the feature space."""
        batch = self.batch([photo], [False], None)
        features = batch.features
        if features is None:
            assert batch.encoder_images is not None
            features = self.encoder(batch.encoder_images)
        return features, batch.masks

    def _load(self, photo: Photo) -> Pixels:
        known = self._pixels.get(photo)
        if known is not None:
            return known
        loaded = load_photo(photo, size=self.image_size, valid_margin=self.valid_margin)
        inside, outside = distance_maps(loaded.mask)
        pixels = Pixels(
            image=(loaded.image * 255.0).round().to(torch.uint8),
            mask=(loaded.mask * 255.0).round().to(torch.uint8),
            distance=inside - outside,  # one of them is 0 at every pixel
            valid=None if bool(loaded.valid.all()) else loaded.valid.to(torch.uint8),
        )
        with self._lock:
            if photo not in self._pixels and self._budget >= pixels.size():
                self._budget -= pixels.size()
                self._pixels[photo] = pixels
        return pixels

    def _encoder_images(self, photos: Sequence[Photo], flips: Sequence[bool]) -> Tensor:
        images = [resize_image(photo.source.read().image, self.encoder.input_size) for photo in photos]
        return torch.stack([flip_map(image) if flip else image for image, flip in zip(images, flips, strict=True)])

    def _targets(self, photos: Sequence[Photo], flips: Sequence[bool]) -> Tensor | None:
        if any(photo.feature_map is None for photo in photos):
            return None
        maps = [
            read_feature_map(photo.feature_map, channels=FEATURE_MAP_CHANNELS, codec="unit")
            for photo in photos
            if photo.feature_map is not None
        ]
        return torch.stack([flip_map(each) if flip else each for each, flip in zip(maps, flips, strict=True)])
