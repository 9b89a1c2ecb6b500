"""Photograph in, animals out: the one path that the command line and :func:`fauna.load` share."""

import contextlib
import hashlib
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Bool
from PIL import Image

from fauna.data.crop_box import CropBox
from fauna.data.crop_rules import ruled_window
from fauna.data.cut import cut
from fauna.data.photos import RawPhoto
from fauna.data.single import crop_batch
from fauna.errors import FaunaError
from fauna.masks.animals import extent, split_animals, touched_border
from fauna.masks.base import Segmenter
from fauna.model import FaunaModel
from fauna.reconstruct.clock import Clock
from fauna.reconstruct.mask_files import FoundMasks, alpha_mask, array_masks, masks_beside, read_masks
from fauna.reconstruct.photograph import Photograph, Source, read_photograph
from fauna.reconstruct.quality import confidence, judge, measure
from fauna.reconstruct.result import Fit, InputFacts, Result, Weights
from fauna.reconstruct.settings import Settings
from fauna.reconstruct.status import Refused
from fauna.types import Batch, Reconstruction

MaskInput = str | Path | Image.Image | np.ndarray


@dataclass(frozen=True)
class Reconstructor:
    """A model and everything around it that turns photographs into animals.

    Attributes:
        model: in evaluation mode.
        weights: which model it is.
        settings: numbers and choices.
        segmenter: for photographs without a mask.
    """

    model: FaunaModel
    weights: Weights
    settings: Settings
    segmenter: Segmenter

    def reconstruct(
        self, image: str | Path | Image.Image | np.ndarray, *, mask: MaskInput | None = None, name: str | None = None
    ) -> Result:
        """The largest animal of a photograph; arguments as in :meth:`reconstruct_all`."""
        return self.reconstruct_all(image, masks=None if mask is None else [mask], name=name)[0]

    def reconstruct_all(
        self,
        image: str | Path | Image.Image | np.ndarray,
        *,
        masks: Sequence[MaskInput] | None = None,
        name: str | None = None,
    ) -> list[Result]:
        """Every animal of a photograph, largest first; at least one result, which says why if there is no animal.

        Args:
            image: a file, a PIL picture, or 8-bit RGB (height, width, 3).
            masks: picture files or arrays of the photograph's size; ``None``: the alpha channel, a mask beside the
                file, or the segmenter's.
            name: of the animals; ``None`` takes the file's.

        Raises:
            FaunaError: for a mistake of the program, e.g. masks given partly as files. What is wrong with the photograph
                is told by the result's status.
        """
        clock = Clock()
        source: Source = Path(image).expanduser() if isinstance(image, str | Path) else image
        title = name or (source.stem if isinstance(source, Path) else "photo")
        facts = InputFacts(file=source.name if isinstance(source, Path) else None)
        flags: tuple[str, ...] = ()
        try:
            with clock.stage("read"):
                photograph = read_photograph(source, self.settings.photo)
            flags = photograph.flags
            facts = _photo_facts(photograph)
            with clock.stage("mask"):
                found = self._masks(photograph, masks)
                facts = self._mask_facts(facts, found)
                flags = (*flags, *found.flags)
                animals, said = self._animals(photograph, found)
        except Refused as refusal:
            return [self._refusal(title, refusal, flags, facts, clock)]
        return [
            self._animal(
                title if index == 0 else f"{title}_{index + 1}",
                photograph,
                animal,
                (*flags, *said),
                facts,
                clock.copy(),
            )
            for index, animal in enumerate(animals)
        ]

    def _masks(self, photograph: Photograph, given: Sequence[MaskInput] | None) -> FoundMasks:
        """In this order: given ones, files beside the photograph, the alpha channel, the segmenter's."""
        if given is not None:
            files = [Path(each).expanduser() for each in given if isinstance(each, str | Path)]
            arrays = [
                np.array(each.convert("L")) if isinstance(each, Image.Image) else each
                for each in given
                if not isinstance(each, str | Path)
            ]
            if files and arrays:
                raise FaunaError("masks: expected files or arrays, got both; give one kind")
            limits = self.settings.mask
            return array_masks(arrays, photograph) if arrays else read_masks(files, photograph, "given", limits)
        beside = masks_beside(photograph.path) if photograph.path is not None else []
        if beside:
            return read_masks(beside, photograph, "beside", self.settings.mask)
        flags: tuple[str, ...] = ()
        if photograph.alpha is not None:
            found = alpha_mask(photograph, self.settings.mask)
            if found is not None:
                return found
            flags = ("alpha_ignored",)
        mask = self.segmenter.segment(photograph.image)
        return FoundMasks((mask,), "segmenter", _digest(mask), (*flags, *self.segmenter.flags))

    def _animals(
        self, photograph: Photograph, found: FoundMasks
    ) -> tuple[list[Bool[np.ndarray, "height width"]], tuple[str, ...]]:
        """Each animal's mask, largest first, and flags."""
        limits = self.settings.mask
        parts = {"animal_share": limits.animal_share, "speck_share": limits.speck_share, "same_gap": limits.same_gap}
        animals = [animal for mask in found.masks for animal in split_animals(mask, **parts)]
        if not animals:
            what = "nothing that stands out" if found.source == "segmenter" else "an empty mask"
            raise Refused("no_animal", f"{photograph.name}: expected an animal, got {what}; give a mask of the animal")
        animals.sort(key=lambda animal: -int(animal.sum()))
        large = [animal for animal in animals if extent(animal) * photograph.scale >= limits.min_extent]
        if not large:
            raise Refused(
                "too_small",
                f"{photograph.name}: expected an animal of at least {limits.min_extent} pixels, got "
                f"{extent(animals[0]) * photograph.scale:.0f}; use a larger photograph",
            )
        flags = ("several_animals",) if len(large) > 1 else ()
        return large[: limits.max_animals], flags + (("more_animals",) if len(large) > limits.max_animals else ())

    def _animal(
        self,
        name: str,
        photograph: Photograph,
        mask: Bool[np.ndarray, "height width"],
        flags: tuple[str, ...],
        facts: InputFacts,
        clock: Clock,
    ) -> Result:
        """Crop, reconstruct and judge one animal."""
        if touched_border(mask) > self.settings.quality.border_share:
            flags = (*flags, "cut_by_border")
        try:
            fit = self._fit(photograph, mask, clock)
        except FaunaError as error:
            return self._refusal(name, Refused("failed", str(error)), flags, facts, clock)
        if fit.measures.ambiguity >= self.settings.quality.ambiguous:
            flags = (*flags, "ambiguous_viewpoint")
        flags += ("confidence_not_calibrated",) if self.weights.sha256 != self.settings.quality.weights else ()
        flags += ("refined",) if fit.refined_iou is not None else ()
        flags += ("texture_finetuned",) if fit.model is not self.model else ()
        status, reason = judge(fit.measures, self.settings.quality)
        return Result(
            name=name,
            status=status,
            reason=reason,
            flags=flags,
            confidence=confidence(fit.measures, self.settings.quality),
            source=facts,
            weights=self.weights,
            settings=self.settings,
            fit=fit,
            seconds=clock.seconds,
        )

    def _fit(self, photograph: Photograph, mask: Bool[np.ndarray, "height width"], clock: Clock) -> Fit:
        """The model's answer, refined and fine-tuned as the settings say."""
        settings = self.settings
        with clock.stage("crop"):
            place = ruled_window(mask, settings.crop.rule)
            crop, small, box = cut(Image.fromarray(photograph.image), mask, place, settings.crop.size)
            raw = RawPhoto(crop, small, box, None)
            batch = crop_batch(self.model.encoder, raw, size=settings.crop.size).to(self.model.device)
        with clock.stage("features"):
            batch = self.model.with_features(batch)
        with clock.stage("geometry"), torch.no_grad():
            out = self.model(batch)
        if not bool(torch.isfinite(out.posed.verts).all()) or not len(out.posed.faces):
            raise FaunaError(f"{photograph.name}: expected a mesh, got none from this mask; give another mask")
        measures = measure(self.model, batch, out)
        out, refined_iou = self._refined(batch, out, clock)
        model = self._finetuned(batch, out, clock)
        window = _scaled(box, photograph.scale)
        return Fit(model, batch, out, window, crop, small, measures, refined_iou)

    def _refined(self, batch: Batch, out: Reconstruction, clock: Clock) -> tuple[Reconstruction, float | None]:
        """With camera and bone angles fitted to the mask, and the IoU after that."""
        if not self.settings.output.refine_steps:
            return out, None
        from fauna.texture import refine

        with clock.stage("refine"):
            refined = refine(self.model, batch, out, steps=self.settings.output.refine_steps)
        return refined.out, refined.iou_after[0]

    def _finetuned(self, batch: Batch, out: Reconstruction, clock: Clock) -> FaunaModel:
        """With the texture network fitted to the photograph; the model itself where outline and mask have nothing in common."""
        output = self.settings.output
        if not (output.texture_size and output.finetune_iterations):
            return self.model
        from fauna.texture import finetune

        with clock.stage("finetune"), contextlib.suppress(FaunaError):
            return finetune(self.model, batch, out, iterations=output.finetune_iterations)
        return self.model

    def _mask_facts(self, facts: InputFacts, found: FoundMasks) -> InputFacts:
        segmenter = self.segmenter.name if found.source == "segmenter" else None
        return replace(facts, mask_source=found.source, mask_sha256=found.sha256, segmenter=segmenter)

    def _refusal(self, name: str, refusal: Refused, flags: tuple[str, ...], facts: InputFacts, clock: Clock) -> Result:
        return Result(
            name=name,
            status=refusal.status,
            reason=str(refusal),
            flags=flags,
            confidence=0.0,
            source=facts,
            weights=self.weights,
            settings=self.settings,
            seconds=clock.seconds,
        )


def _photo_facts(photograph: Photograph) -> InputFacts:
    return InputFacts(
        file=None if photograph.path is None else photograph.path.name,
        sha256=photograph.sha256,
        format=photograph.format,
        size=photograph.size,
        orientation=photograph.orientation,
    )


def _scaled(box: CropBox, scale: float) -> CropBox:
    """A place in the working picture as one in the photograph."""
    return CropBox(*(getattr(box, name) * scale for name in CropBox.__dataclass_fields__))


def _digest(mask: Bool[np.ndarray, "height width"]) -> str:
    return hashlib.sha256(mask.tobytes()).hexdigest()
