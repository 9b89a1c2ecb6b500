"""The features step: a quantised map of principal components for every crop."""

import hashlib
import io
from dataclasses import replace
from functools import cached_property
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Float, UInt8
from PIL import Image
from torch import Tensor
from torch.nn import functional as F

from fauna.data.feature_map import tile_channels
from fauna.encoder.base import Encoder
from fauna.encoder.feature_space import FeatureSpace
from fauna.errors import FaunaError
from fauna.prepare.basis import FILE, encode_crop, read_basis
from fauna.prepare.encoders import encoder_by_name
from fauna.prepare.record import Record, Rows
from fauna.prepare.settings import FeatureSettings, Settings, digest
from fauna.prepare.steps import Step
from fauna.prepare.workspace import Workspace, file_digest, write_file

VERSION = 1


class FeatureStep(Step):
    """Encodes crops one at a time on one thread and stores their maps as ``_feat16.png``, value / 255.

    Args:
        settings: group ``features``.
        workspace: where crops and the basis are.

    Raises:
        FaunaError: when there is no basis.
    """

    name = "features"

    def __init__(self, *, settings: Settings, workspace: Workspace) -> None:
        self.settings = settings
        self.workspace = workspace
        path = workspace.work / FILE
        try:
            self._basis = hashlib.blake2b(path.read_bytes(), digest_size=8).hexdigest()
        except OSError as error:
            raise FaunaError(
                f"{path} expects the basis of the feature maps, got none; run fauna-prepare features"
            ) from error

    @property
    def key(self) -> str:
        """Of the settings and the basis, which names the weights."""
        return digest(VERSION, self.settings.features, self._basis)

    @cached_property
    def encoder(self) -> Encoder:
        """Loaded when the first crop needs it."""
        return encoder_by_name(self.settings.features.encoder or "")

    @cached_property
    def space(self) -> FeatureSpace:
        """Likewise."""
        return read_basis(self.workspace.work / FILE, self.encoder, self.settings.features)

    def __call__(self, rows: Rows) -> Rows:
        """The rows with digests of their maps."""
        return tuple(self._encoded(row) if row.ok else row for row in rows)

    def outputs(self, rows: Rows) -> list[Path]:
        """The maps of rows that are ok."""
        return [self.workspace.crop(row.id, "feat16.png") for row in rows if row.ok]

    def intact(self, rows: Rows) -> bool:
        """Whether every map has the bytes that were made."""
        return all(file_digest(self.workspace.crop(row.id, "feat16.png")) == row.feat_sha256 for row in rows if row.ok)

    def _encoded(self, row: Record) -> Record:
        features = encode_crop(self.encoder, self.workspace.crop(row.id, "rgb.jpg"))
        maps = self.space.targets(features)[0]
        content = encode_map(maps, self.settings.features)
        write_file(self.workspace.crop(row.id, "feat16.png"), content)
        return replace(row, feat_sha256=hashlib.sha256(content).hexdigest())


def encode_map(maps: Float[Tensor, "chan height width"], settings: FeatureSettings) -> bytes:
    """A map in [0, 1] as a PNG of RGB tiles, value / 255, brought to ``features.grid`` cells."""
    if settings.grid is not None and settings.grid != maps.shape[-1]:
        size = (settings.grid, settings.grid)
        maps = F.interpolate(maps[None], size=size, mode="bilinear", align_corners=False, antialias=True)[0]
    buffer = io.BytesIO()
    Image.fromarray(quantised(maps)).save(buffer, "PNG")
    return buffer.getvalue()


def quantised(maps: Float[Tensor, "chan height width"]) -> UInt8[np.ndarray, "height wide 3"]:
    """Values in [0, 1] rounded to 8 bits and laid out as tiles."""
    return tile_channels((maps.clamp(0.0, 1.0) * 255.0).round().to(torch.uint8))
