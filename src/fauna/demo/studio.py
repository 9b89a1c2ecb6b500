"""One photograph for the page: everything it shows, and the file it offers."""

import html
import io
import re
import threading
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import torch
from jaxtyping import UInt8
from PIL import Image

import fauna
from fauna.errors import FaunaError
from fauna.reconstruct.outputs import facts
from fauna.reconstruct.preview import preview
from fauna.reconstruct.reconstructor import Reconstructor
from fauna.reconstruct.result import Fit, Result
from fauna.reconstruct.status import FLAGS, MEANINGS
from fauna.viewer import ViewerFrame, viewer_html

HEIGHT = 560
"""Of the 3D view, pixels."""


@dataclass(frozen=True)
class Shown:
    """What the page shows of a photograph.

    Attributes:
        pictures: input with its mask, overlay, mesh, texture, side, skeleton; ``None`` without an animal.
        viewer: HTML of the 3D view, empty without an animal.
        bank: share of each of the bank's slots in the shape, by its name.
        message: Markdown: what happened, and what is doubtful.
        glb: the file to take away.
    """

    pictures: UInt8[np.ndarray, "height width 3"] | None
    viewer: str
    bank: dict[str, float]
    message: str
    glb: Path | None


class Studio:
    """A model that works on one photograph at a time.

    Args:
        reconstructor: model and settings.
    """

    def __init__(self, *, reconstructor: Reconstructor) -> None:
        self.reconstructor = reconstructor
        self._one_at_a_time = threading.Lock()

    @staticmethod
    def load(checkpoint: str | None, *, device: str, segmenter: str | None) -> "Studio":
        """With the model of a checkpoint, or the one in the package.

        Raises:
            FaunaError: when there is no such model, device or segmenter.
        """
        return Studio(reconstructor=fauna.load(checkpoint, device=device, segmenter=segmenter))

    def show(self, photo: Path, folder: Path, *, fit_colours: bool) -> Shown:
        """Reconstruct the largest animal of a photograph.

        Args:
            photo: picture file.
            folder: an empty one, for the file to take away.
            fit_colours: fit the texture to the photograph, which takes longer.
        """
        settings = self.reconstructor.settings
        if not fit_colours:
            settings = replace(settings, output=replace(settings.output, finetune_iterations=0))
        name = re.sub(r"[^\w-]+", "_", photo.stem)[:60].strip("_") or "animal"
        with self._one_at_a_time:
            result = replace(self.reconstructor, settings=settings).reconstruct(photo, name=name)
            if result.fit is None:
                return Shown(None, "", {}, told(result), None)
            return self._shown(result, result.fit, folder)

    def _shown(self, result: Result, fit: Fit, folder: Path) -> Shown:
        from fauna.export import glb_bytes

        try:
            glb = glb_bytes(result.rigged())
        except FaunaError as error:
            return Shown(None, "", {}, f"**failed**: {plain(str(error))}", None)
        path = folder / f"{result.name}.glb"
        path.write_bytes(glb)
        poster = io.BytesIO()
        Image.fromarray(fit.crop).save(poster, "PNG")
        page = viewer_html(glb, title=result.name, facts=facts(result), poster=poster.getvalue())
        pictures = np.asarray(preview(result, cell=result.settings.output.preview_cell).convert("RGB"))
        return Shown(pictures, ViewerFrame(page, HEIGHT).html(), slots(fit), told(result), path)


def slots(fit: Fit) -> dict[str, float]:
    """Share of each slot that was mixed into the shape; shares are absolute values, of which one is the sum."""
    readout = fit.out.readout
    if readout.slots is None or readout.weights is None:
        return {}
    pairs = zip(readout.slots[0].tolist(), readout.weights[0].abs().tolist(), strict=True)
    return {f"slot {slot}": float(weight) for slot, weight in sorted(pairs, key=lambda pair: -pair[1])}


def told(result: Result) -> str:
    """Status, reason and flags in words, Markdown."""
    lines = [f"**{result.status.replace('_', ' ')}**: {plain(result.reason) or MEANINGS[result.status]}"]
    if result.fit is not None:
        lines.append(
            f"Confidence {100 * result.confidence:.0f} %, outline {100 * result.fit.measures.iou:.0f} % alike."
        )
    lines += [f"- {FLAGS.get(flag, flag)}" for flag in result.flags]
    return "\n\n".join(lines[:2]) + "\n\n" + "\n".join(lines[2:])


def plain(text: str) -> str:
    """Text that Markdown and HTML leave as it is."""
    return html.escape(re.sub(r"([\\`*_{}\[\]()#+!|~-])", r"\\\1", text))


def warm_up(studio: Studio) -> None:
    """Reconstruct a blank square once, so that compiled loops are ready for the first visitor."""
    image, mask = np.full((64, 64, 3), 128, np.uint8), np.zeros((64, 64), np.uint8)
    mask[16:48, 8:56] = 255
    with torch.no_grad():
        studio.reconstructor.model.reconstruct(image, mask)
