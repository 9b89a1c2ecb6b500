"""From photos to batches: pixels, masks, distances, features; decoded photos are kept in memory up to a budget."""

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
    """What a batch needs of one photo at render resolution, not mirrored; 8-bit where that loses nothing."""

    image: Tensor
    mask: Tensor
    inside: Tensor
    outside: Tensor
    valid: Tensor

    def size(self) -> int:
        """Bytes in memory."""
        return sum(tensor.nbytes for tensor in (self.image, self.mask, self.inside, self.outside, self.valid))


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

    def batch(self, photos: Sequence[Photo], flips: Sequence[bool], category: int | None) -> Batch:
        """A batch of photos, each mirrored where ``flips`` says so."""
        pixels = [self._mirrored(self._load(photo), flip) for photo, flip in zip(photos, flips, strict=True)]
        stack = {name: torch.stack([getattr(p, name) for p in pixels]).float() for name in Pixels.__dataclass_fields__}
        return Batch(
            images=stack["image"] / 255.0,
            masks=stack["mask"] / 255.0,
            distance_inside=stack["inside"],
            distance_outside=stack["outside"],
            valid=stack["valid"],
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
        image = (loaded.image * 255.0).round().to(torch.uint8)
        pixels = Pixels(
            image, (loaded.mask * 255.0).round().to(torch.uint8), inside, outside, loaded.valid.to(torch.uint8)
        )
        if self._budget >= pixels.size():
            self._budget -= pixels.size()
            self._pixels[photo] = pixels
        return pixels

    def _mirrored(self, pixels: Pixels, flip: bool) -> Pixels:
        if not flip:
            return pixels
        return Pixels(*(flip_map(getattr(pixels, name)) for name in Pixels.__dataclass_fields__))

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
