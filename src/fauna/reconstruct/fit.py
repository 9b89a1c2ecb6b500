"""From a mask to an animal: crop, features, the model's answer, and what is fitted to the photograph afterwards."""

import contextlib

import numpy as np
import torch
from jaxtyping import Bool
from PIL import Image
from torch import Tensor

from fauna.bank.table import BankTable
from fauna.bank.view import BankView, view_of
from fauna.data.crop_box import CropBox
from fauna.data.crop_rules import ruled_window
from fauna.data.cut import cut
from fauna.data.photos import RawPhoto
from fauna.data.single import crop_batch
from fauna.errors import FaunaError
from fauna.model import FaunaModel
from fauna.reconstruct.clock import Clock
from fauna.reconstruct.photograph import Photograph
from fauna.reconstruct.quality import measure
from fauna.reconstruct.result import Fit
from fauna.reconstruct.settings import BankSettings, OutputSettings, Settings
from fauna.types import Batch, Reconstruction


def fit_animal(
    model: FaunaModel,
    table: BankTable | None,
    settings: Settings,
    photograph: Photograph,
    mask: Bool[np.ndarray, "height width"],
    clock: Clock,
) -> Fit:
    """The model's answer, refined and fine-tuned as the settings say.

    Args:
        model: in evaluation mode.
        table: of its bank.
        settings: numbers and choices.
        photograph: upright.
        mask: of the animal, at the photograph's working size.
        clock: told how long each stage takes.

    Raises:
        FaunaError: when the model gives no usable mesh.
    """
    with clock.stage("crop"):
        place = ruled_window(mask, settings.crop.rule)
        crop, small, box = cut(Image.fromarray(photograph.image), mask, place, settings.crop.size)
        raw = RawPhoto(crop, small, box, None)
        batch = crop_batch(model.encoder, raw, size=settings.crop.size).to(model.device)
    with clock.stage("features"):
        batch = model.with_features(batch)
    with clock.stage("geometry"), torch.no_grad():
        out = model(batch)
    if not bool(torch.isfinite(out.posed.verts).all()) or not len(out.posed.faces):
        raise FaunaError(f"{photograph.name}: expected a mesh, got none from this mask; give another mask")
    measures = measure(model, batch, out)
    out, refined_iou = _refined(model, batch, out, settings.output, clock)
    fitted = _finetuned(model, batch, out, settings.output, clock)
    window = _scaled(box, photograph.scale)
    return Fit(fitted, batch, out, window, crop, small, measures, refined_iou, _view(model, table, out, settings.bank))


def _refined(
    model: FaunaModel, batch: Batch, out: Reconstruction, output: OutputSettings, clock: Clock
) -> tuple[Reconstruction, float | None]:
    """With camera and bone angles fitted to the mask, and the IoU after that."""
    if not output.refine_steps:
        return out, None
    from fauna.texture import refine

    with clock.stage("refine"):
        refined = refine(model, batch, out, steps=output.refine_steps)
    return refined.out, refined.iou_after[0]


def _finetuned(
    model: FaunaModel, batch: Batch, out: Reconstruction, output: OutputSettings, clock: Clock
) -> FaunaModel:
    """With the texture network fitted to the photograph; the model itself where outline and mask have nothing in common."""
    if not (output.texture_size and output.finetune_iterations):
        return model
    from fauna.texture import finetune

    with clock.stage("finetune"), contextlib.suppress(FaunaError):
        return finetune(model, batch, out, iterations=output.finetune_iterations)
    return model


def _view(model: FaunaModel, table: BankTable | None, out: Reconstruction, settings: BankSettings) -> BankView | None:
    """What the bank saw; ``None`` for banks without slots."""
    if out.readout.slots is None:
        return None
    values: Tensor = model.bank.get_parameter("values")
    return view_of(out.readout, values, table, species=settings.species, pictures=settings.pictures)


def _scaled(box: CropBox, scale: float) -> CropBox:
    """A place in the working picture as one in the photograph."""
    return CropBox(*(getattr(box, name) * scale for name in CropBox.__dataclass_fields__))
