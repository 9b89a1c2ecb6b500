"""From a weight file to a model that can be asked."""

from pathlib import Path

import torch

from fauna.build import build_encoder, build_model, stored_config
from fauna.errors import FaunaError
from fauna.evaluation.weights import locate
from fauna.io.checkpoint import load_weights, read_weights
from fauna.model import FaunaModel
from fauna.pretrained.shipped import PRETRAINED


def load_model(name_or_path: str | Path | None, *, device: str | torch.device) -> FaunaModel:
    """The model of a weight file, a checkpoint or a run folder, in evaluation mode and in the stage it was trained in.

    The architecture comes from the configuration stored with the weights. The rasteriser is no part of it: it is the
    compiled one on a CPU and the one written in torch elsewhere.

    Args:
        name_or_path: ``None`` or ``"pretrained"`` is the model that ships with the package.
        device: where the model goes.

    Raises:
        FaunaError: when there is no such file, it is damaged, its encoder cannot be had, or the device cannot be used.
    """
    wanted = _device(device)
    path = locate(PRETRAINED if name_or_path is None else str(name_or_path))
    cfg = stored_config(read_weights(path)[1]["config"])
    backend = "numba_backend.NumbaRenderer" if wanted.type == "cpu" else "torch_backend.TorchRenderer"
    cfg.renderer = {"_target_": f"fauna.renderer.{backend}"}
    model = build_model(cfg, build_encoder(cfg))
    load_weights(model, path)
    return model.eval().to(wanted)


def _device(device: str | torch.device) -> torch.device:
    try:
        wanted = torch.device(device)
        torch.empty(0, device=wanted)
    except (RuntimeError, AssertionError, TypeError) as error:  # a build of torch without CUDA asserts
        reason = str(error).splitlines()[0].split(". ")[0]
        raise FaunaError(f"device: expected one that torch can use here, got {device} ({reason}); use cpu") from error
    return wanted
