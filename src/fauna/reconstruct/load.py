"""From a name to a :class:`~fauna.reconstruct.reconstructor.Reconstructor`."""

from dataclasses import replace
from pathlib import Path

import torch

from fauna.bank.table import table_beside
from fauna.errors import FaunaError
from fauna.evaluation.weights import file_digest, locate
from fauna.masks.grabcut import GrabCut
from fauna.masks.registry import build_segmenter
from fauna.pretrained.load import load_model
from fauna.pretrained.shipped import PRETRAINED
from fauna.reconstruct.reconstructor import Reconstructor
from fauna.reconstruct.result import Weights
from fauna.reconstruct.settings import Settings, default_settings


def load(
    name_or_path: str | Path | None = None,
    *,
    device: str | torch.device = "cpu",
    settings: Settings | None = None,
    segmenter: str | None = None,
) -> Reconstructor:
    """A trained model that reconstructs photographs: ``fauna.load().reconstruct("dog.jpg").save("out/dog")``.

    Args:
        name_or_path: ``None`` or ``"pretrained"`` is the model that ships with the package; else a weight file, a
            checkpoint or a run's folder.
        device: where the model goes.
        settings: numbers and choices; ``None`` takes those of ``conf/reconstruct.yaml``.
        segmenter: for photographs without a mask, in place of the settings': ``grabcut``, ``sam[:MODEL]``, ``rembg[:MODEL]``.

    Raises:
        FaunaError: when there is no such model or segmenter, an argument is of another kind, or the device cannot be used.
    """
    if not isinstance(settings, Settings | None) or not isinstance(segmenter, str | None):
        name, given = ("segmenter", segmenter) if isinstance(settings, Settings | None) else ("settings", settings)
        wanted = {"settings": "Settings, e.g. default_settings()", "segmenter": "a name, e.g. grabcut"}[name]
        raise FaunaError(f"{name}: expected {wanted} or None, got {type(given).__name__}; leave it out for the usual")
    chosen = default_settings() if settings is None else settings
    if segmenter is not None:
        chosen = replace(chosen, mask=replace(chosen.mask, segmenter=segmenter))
    name = PRETRAINED if name_or_path is None else str(name_or_path)
    model = load_model(name, device=device)
    if chosen.output.resolution is not None:
        model.shape.set_resolution(chosen.output.resolution)
    path = locate(name)
    digest = file_digest(path)
    weights = Weights(PRETRAINED if name == PRETRAINED else path.name, digest, model.encoder.fingerprint)
    table = table_beside(path, digest)
    default = GrabCut(encoder=model.encoder, saliency=chosen.mask.saliency, options=chosen.mask.grabcut)
    return Reconstructor(model, weights, chosen, build_segmenter(chosen.mask.segmenter, default), table)
