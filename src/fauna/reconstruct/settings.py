"""The numbers of ``conf/reconstruct.yaml`` as frozen dataclasses; needs neither Hydra nor torch."""

import json
from dataclasses import asdict, dataclass
from typing import Any, Literal

import yaml

from fauna._conf import CONF_DIR
from fauna.errors import FaunaError
from fauna.masks.options import GrabCutOptions, SaliencyOptions
from fauna.yaml_groups import build_group

CROP_RULES = ("widen", "fauna")
FORMATS = ("glb", "obj", "ply")
MOST_FRAMES = 600
"""Of a morph."""


@dataclass(frozen=True)
class PhotoSettings:
    """What is read at all.

    Attributes:
        max_bytes: of a file.
        max_pixels: of a photograph, refused beyond before anything is decoded.
        max_pixels_jpeg: the same for JPEG, which is decoded at a reduced size.
        max_pixels_progressive: the same for progressive JPEG, whose coefficients are held whole.
        min_side: of a photograph, pixels.
        work_side: photographs are reduced to this longer side, pixels.
    """

    max_bytes: int
    max_pixels: int
    max_pixels_jpeg: int
    max_pixels_progressive: int
    min_side: int
    work_side: int


@dataclass(frozen=True)
class MaskSettings:
    """Where masks come from, and what of them is an animal.

    Attributes:
        segmenter: for photographs without a mask: ``grabcut``, ``sam[:MODEL]`` or ``rembg[:MODEL]``.
        animal_share: parts of a mask with this share of the largest part's area are animals of their own.
        speck_share: smaller parts are dropped; those between belong to the nearest animal.
        same_gap: widest gap between two parts of one animal, extents of its larger part.
        max_animals: of a photograph.
        max_pixels: of a mask's file.
        min_extent: longer side of an animal's bounding box, pixels of the photograph.
        alpha_shares: an alpha channel is a mask when the opaque share of the picture lies between these.
        alpha_decided: and at least this share of the pixels is nearly opaque or nearly transparent.
        saliency: of the default segmenter.
        grabcut: likewise.
    """

    segmenter: str
    animal_share: float
    speck_share: float
    same_gap: float
    max_animals: int
    max_pixels: int
    min_extent: int
    alpha_shares: tuple[float, float]
    alpha_decided: float
    saliency: SaliencyOptions
    grabcut: GrabCutOptions


@dataclass(frozen=True)
class CropSettings:
    """How the crop is cut.

    Attributes:
        rule: ``widen`` or ``fauna``, see :func:`fauna.data.crop_rules.ruled_window`.
        size: side of the crop and of the pictures rendered from it, pixels.
    """

    rule: str
    size: int


@dataclass(frozen=True)
class QualitySettings:
    """When something is said about a result.

    Attributes:
        border_share: of the bounding box's circumference on the photograph's border from which an animal counts as cut.
        ambiguous: entropy of the viewpoint hypotheses, relative to that of equal ones, from which the viewpoint is a guess.
        bias: of the logistic model of :func:`fauna.reconstruct.quality.confidence`.
        iou: its weight of the outlines' IoU.
        strangeness: its weight against strangeness.
        distinctness: its weight of distinctness.
        weights: SHA-256 of the weight file that these four numbers were fitted to.
        quadruped: confidence below which the status is ``not_a_quadruped``.
    """

    border_share: float
    ambiguous: float
    bias: float
    iou: float
    strangeness: float
    distinctness: float
    weights: str
    quadruped: float


@dataclass(frozen=True)
class OutputSettings:
    """What is written.

    Attributes:
        formats: of the model, of :data:`FORMATS`.
        resolution: of the lattice the mesh is cut from, in the paper's units; ``None`` is that of the training.
        texture_size: side of the texture, pixels; 0 leaves the texture out.
        texture_source: ``network`` or ``photo``, see :func:`fauna.texture.bake`.
        finetune_iterations: steps by which the texture network is fitted to the photograph; 0 leaves that out.
        refine_steps: steps by which bone angles and camera are fitted to the mask; 0 leaves that out.
        preview_cell: side of a picture of ``preview.png``, pixels.
        viewer: write ``viewer.html``.
        turntable: write the turning animal.
    """

    formats: tuple[str, ...]
    resolution: int | None
    texture_size: int
    texture_source: Literal["network", "photo"]
    finetune_iterations: int
    refine_steps: int
    preview_cell: int
    viewer: bool
    turntable: bool


@dataclass(frozen=True)
class MorphSettings:
    """Of the way from one photograph's animal to another's.

    Attributes:
        keys: steps that are written as GLB, both ends counted.
        texture_size: of these, at most, pixels.
        columns: steps in ``preview.png``.
        cell: side of a picture there, pixels.
        film_size: side of the film, pixels.
    """

    keys: int
    texture_size: int
    columns: int
    cell: int
    film_size: int


@dataclass(frozen=True)
class BankSettings:
    """Of what is said about the bank's answer.

    Attributes:
        slots: of an answer that get a picture, most important first.
        species: species named for each slot.
        pictures: training pictures nearest to the photograph's shape code.
        view: draw ``bank.png``.
        cell: side of a picture there, pixels.
    """

    slots: int
    species: int
    pictures: int
    view: bool
    cell: int


@dataclass(frozen=True)
class Settings:
    """Everything ``conf/reconstruct.yaml`` says."""

    photo: PhotoSettings
    mask: MaskSettings
    crop: CropSettings
    quality: QualitySettings
    output: OutputSettings
    morph: MorphSettings
    bank: BankSettings

    def as_dict(self) -> dict[str, Any]:
        """Plain containers, as ``result.json`` has them."""
        return json.loads(json.dumps(asdict(self)))

    def __post_init__(self) -> None:
        check_choice("crop.rule", self.crop.rule, CROP_RULES)
        check_choice("texture source", self.output.texture_source, ("network", "photo"))
        for name in self.output.formats:
            check_choice("format", name, FORMATS)
        if self.output.resolution is not None:
            check_range("resolution", self.output.resolution, 8, 256)
        check_range("crop size", self.crop.size, 32, 2048)
        check_range("texture-size", self.output.texture_size, 0, 8192)
        check_range("refine", self.output.refine_steps, 0, 10_000)
        check_range("finetune", self.output.finetune_iterations, 0, 10_000)
        check_range("morph.keys", self.morph.keys, 2, 100)
        check_range("morph.columns", self.morph.columns, 2, 100)


def default_settings() -> Settings:
    """The settings of ``conf/reconstruct.yaml``."""
    content = yaml.safe_load((CONF_DIR / "reconstruct.yaml").read_text(encoding="utf-8"))
    return build_group(Settings, content, file="reconstruct.yaml")


def check_choice(name: str, value: str, known: tuple[str, ...]) -> None:
    """Refuse a word that is not among the known ones.

    Raises:
        FaunaError: naming them.
    """
    if value not in known:
        raise FaunaError(f"{name}: expected one of {', '.join(known)}, got {value!r}; e.g. {known[0]}")


def check_range(name: str, value: int, low: int, high: int) -> None:
    """Refuse a number outside of [low, high].

    Raises:
        FaunaError: naming the range.
    """
    if isinstance(value, bool) or not isinstance(value, int) or not low <= value <= high:
        raise FaunaError(f"{name}: expected a whole number from {low} to {high}, got {value!r}; give another number")
