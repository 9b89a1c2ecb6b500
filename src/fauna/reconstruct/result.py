"""What comes of one animal of one photograph: in memory, the same for the command line and for Python."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Bool, UInt8
from PIL import Image

from fauna.bank.view import BankView
from fauna.data.crop_box import CropBox
from fauna.model import FaunaModel
from fauna.reconstruct.quality import Measures
from fauna.reconstruct.settings import Settings
from fauna.reconstruct.status import Status
from fauna.types import Batch, Reconstruction

if TYPE_CHECKING:
    from fauna.export import RiggedAnimal
    from fauna.texture import Texture


@dataclass(frozen=True)
class Weights:
    """Which model it was.

    Attributes:
        name: ``pretrained`` or the file's name.
        sha256: of the weight file.
        encoder: fingerprint of the frozen encoder.
    """

    name: str
    sha256: str
    encoder: str


@dataclass(frozen=True)
class InputFacts:
    """Where a result comes from.

    Attributes:
        file: name of the photograph's file, ``None`` from memory.
        sha256: of the file or the pixels, ``None`` when it could not be read.
        format: of the file, e.g. ``JPEG``.
        size: (width, height) upright, pixels.
        orientation: EXIF tag by which it was turned upright.
        mask_source: ``given``, ``beside``, ``alpha`` or ``segmenter``.
        mask_sha256: of the mask's file or pixels.
        segmenter: its name, where the mask comes from one.
    """

    file: str | None = None
    sha256: str | None = None
    format: str | None = None
    size: tuple[int, int] | None = None
    orientation: int | None = None
    mask_source: str | None = None
    mask_sha256: str | None = None
    segmenter: str | None = None


@dataclass(frozen=True, eq=False)
class Fit:
    """The animal.

    Attributes:
        model: that made it; its texture network is fitted to the photograph where that was asked for.
        batch: the crop as the model took it, with its features.
        out: what the model said, one row; camera and pose are fitted to the mask where that was asked for.
        window: place of the crop, pixels of the upright photograph.
        crop: (size, size, 3) 8-bit RGB.
        mask: (size, size) of the animal.
        measures: how well what the model said fits.
        refined_iou: of mask and silhouette after camera and pose were fitted to the mask, ``None`` where they were not.
        bank: what the bank saw, ``None`` for banks without slots.
    """

    model: FaunaModel
    batch: Batch
    out: Reconstruction
    window: CropBox
    crop: UInt8[np.ndarray, "size size 3"]
    mask: Bool[np.ndarray, "size size"]
    measures: Measures
    refined_iou: float | None = None
    bank: BankView | None = None


@dataclass(frozen=True, eq=False)
class Result:
    """One animal, or the reason why there is none.

    Attributes:
        name: of the animal, and of its folder.
        status: in a word.
        reason: one line, empty when the status is ``ok``.
        flags: what else is to be said, see :data:`fauna.reconstruct.status.FLAGS`.
        confidence: in [0, 1], see :func:`fauna.reconstruct.quality.confidence`; 0 without an animal.
        source: the photograph and its mask.
        weights: the model.
        settings: everything that was asked for.
        fit: the animal, ``None`` without one.
        seconds: by stage.
    """

    name: str
    status: Status
    reason: str
    flags: tuple[str, ...]
    confidence: float
    source: InputFacts
    weights: Weights
    settings: Settings
    fit: Fit | None = None
    seconds: Mapping[str, float] = field(default_factory=dict)

    @property
    def ok(self) -> bool:
        """Whether the status is ``ok``."""
        return self.status == "ok"

    @cached_property
    def texture(self) -> "Texture | None":
        """The texture that the settings ask for, baked when first asked for.

        Raises:
            FaunaError: when there is no animal.
        """
        from fauna.reconstruct.outputs import texture

        return texture(self)

    def rigged(self) -> "RiggedAnimal":
        """The animal with skeleton, skin, clips and, unless the settings leave it out, texture.

        Raises:
            FaunaError: when there is no animal.
        """
        from fauna.reconstruct.outputs import rig

        return rig(self)

    def bank_picture(self) -> Image.Image:
        """What the bank saw: slots, species and training pictures that the animal resembles.

        Raises:
            FaunaError: when there is no animal, or the bank has no slots.
        """
        from fauna.reconstruct.outputs import bank_picture

        return bank_picture(self)

    def save(self, folder: str | Path) -> Path:
        """Write model, pictures and ``result.json`` into a folder, which is made; what is there is replaced file by file.

        Returns:
            The folder.
        """
        from fauna.reconstruct.outputs import write

        path = Path(folder).expanduser()
        path.mkdir(parents=True, exist_ok=True)
        write(self, path)
        return path
