"""Photograph in, animals out: the one path that the command line and :func:`fauna.load` share."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Bool
from PIL import Image

from fauna.bank.table import BankTable
from fauna.errors import FaunaError
from fauna.masks.animals import touched_border
from fauna.masks.base import Segmenter
from fauna.model import FaunaModel
from fauna.reconstruct.clock import Clock
from fauna.reconstruct.find import MaskInput, find_animals, find_masks
from fauna.reconstruct.fit import fit_animal
from fauna.reconstruct.mask_files import FoundMasks
from fauna.reconstruct.photograph import Photograph, Source, read_photograph
from fauna.reconstruct.quality import confidence, judge
from fauna.reconstruct.result import InputFacts, Result, Weights
from fauna.reconstruct.settings import MOST_FRAMES, Settings, check_range
from fauna.reconstruct.status import Refused

if TYPE_CHECKING:
    from fauna.bank.samples import BankSamples
    from fauna.reconstruct.morph import Morph
    from fauna.reconstruct.posing import PoseTransfer

PhotoInput = str | Path | Image.Image | np.ndarray
"""A file, a PIL picture, or 8-bit RGB (height, width, 3)."""


@dataclass(frozen=True)
class Reconstructor:
    """A model and everything around it that turns photographs into animals.

    Attributes:
        model: in evaluation mode.
        weights: which model it is.
        settings: numbers and choices.
        segmenter: for photographs without a mask.
        table: what the bank answered to known pictures, ``None`` where nobody asked it.
    """

    model: FaunaModel
    weights: Weights
    settings: Settings
    segmenter: Segmenter
    table: BankTable | None = None

    def reconstruct(self, image: PhotoInput, *, mask: MaskInput | None = None, name: str | None = None) -> Result:
        """The largest animal of a photograph; arguments as in :meth:`reconstruct_all`."""
        return self.reconstruct_all(image, masks=None if mask is None else [mask], name=name)[0]

    def reconstruct_all(
        self,
        image: PhotoInput,
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
        if not isinstance(image, PhotoInput):
            raise FaunaError(
                f"image: expected a file, a PIL picture or a numpy array, got {type(image).__name__}; convert it"
            )
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
                found = find_masks(photograph, masks, self.segmenter, self.settings.mask)
                facts = self._mask_facts(facts, found)
                flags = (*flags, *found.flags)
                animals, said = find_animals(photograph, found, self.settings.mask)
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

    def morph(
        self,
        first: PhotoInput | Result,
        second: PhotoInput | Result,
        *,
        frames: int,
        masks: tuple[MaskInput | None, MaskInput | None] = (None, None),
        name: str | None = None,
    ) -> "Morph":
        """The way from the largest animal of one photograph to that of another.

        Args:
            first: photograph, as for :meth:`reconstruct`, or a result of this model.
            second: likewise.
            frames: steps, both ends counted.
            masks: of the two.
            name: of the whole; ``None``: ``<first>_to_<second>``.

        Raises:
            FaunaError: when ``frames`` is out of range. What is wrong with a photograph is told by the status.
        """
        from fauna.reconstruct.morph import Morph

        check_range("morph", frames, 2, MOST_FRAMES)
        one, other = self._results((first, second), masks)
        return Morph(name=name or f"{one.name}_to_{other.name}", first=one, second=other, frames=frames)

    def transfer_pose(
        self,
        body: PhotoInput | Result,
        pose: PhotoInput | Result,
        *,
        masks: tuple[MaskInput | None, MaskInput | None] = (None, None),
        name: str | None = None,
    ) -> "PoseTransfer":
        """The largest animal of one photograph in the pose of that of another.

        Args:
            body: photograph, as for :meth:`reconstruct`, or a result of this model: gives shape and colours.
            pose: likewise: gives the bone angles.
            masks: of the two.
            name: of the whole; ``None``: ``<body>_posed_as_<pose>``.
        """
        from fauna.reconstruct.posing import PoseTransfer

        one, other = self._results((body, pose), masks)
        return PoseTransfer(name or f"{one.name}_posed_as_{other.name}", one, other)

    def sample_bank(self, *, mixtures: int, seed: int) -> "BankSamples":
        """Bodies that nobody photographed: of every slot alone, and of random mixtures of ten and of all slots.

        Args:
            mixtures: of each kind.
            seed: of their weights.

        Raises:
            FaunaError: for a bank without slots, or a number out of range.
        """
        from fauna.bank.samples import sample_bank

        return sample_bank(self.model, self.weights.sha256, mixtures=mixtures, seed=seed)

    def _results(self, given: Sequence[PhotoInput | Result], masks: Sequence[MaskInput | None]) -> list[Result]:
        if not isinstance(masks, list | tuple) or len(masks) != len(given):
            got = len(masks) if isinstance(masks, list | tuple) else type(masks).__name__
            raise FaunaError(f"masks: expected one for each of {len(given)} photographs, got {got}; e.g. (mask, None)")
        return [
            each if isinstance(each, Result) else self.reconstruct(each, mask=mask)
            for each, mask in zip(given, masks, strict=True)
        ]

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
            fit = fit_animal(self.model, self.table, self.settings, photograph, mask, clock)
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
