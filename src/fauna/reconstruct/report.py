"""The content of ``result.json``; its keys are documented in ``docs/reconstruct.md`` and ``result.schema.json``."""

import platform
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from importlib.metadata import PackageNotFoundError, version
from typing import Any

import numpy as np
import torch

import fauna
from fauna.bank.view import BankView
from fauna.reconstruct.result import Fit, Result

SCHEMA = "fauna-result-1"
PACKAGES = ("torch", "numpy", "pillow", "numba", "opencv-python-headless")


def report(result: Result, *, seconds: Mapping[str, float], files: Sequence[str]) -> dict[str, Any]:
    """Plain containers.

    Args:
        result: with or without an animal.
        seconds: by stage.
        files: what lies beside it.
    """
    return {
        "schema": SCHEMA,
        "name": result.name,
        "status": result.status,
        "reason": result.reason,
        "flags": list(result.flags),
        "confidence": round(result.confidence, 4),
        "input": {**asdict(result.source), "size": result.source.size and list(result.source.size)},
        "weights": asdict(result.weights),
        "animal": None if result.fit is None else _animal(result.fit),
        "files": list(files),
        "seconds": {name: round(value, 3) for name, value in seconds.items()},
        "settings": result.settings.as_dict(),
        "versions": versions(),
    }


def versions() -> dict[str, str]:
    """Of this package and those that results depend on."""
    found = {"fauna": fauna.__version__, "python": platform.python_version()}
    for name in PACKAGES:
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            found[name] = "none"
    return found


def _animal(fit: Fit) -> dict[str, Any]:
    out = fit.out
    camera = fit.model.camera
    chosen = int(out.selection.hypothesis[0])
    return {
        "measures": {name: _rounded(value) for name, value in asdict(fit.measures).items()},
        "refined_iou": _rounded(fit.refined_iou),
        "crop": {name: _rounded(value) for name, value in asdict(fit.window).items()},
        "camera": {
            "camera_from_world": _plain(out.camera.camera_from_world[0]),
            "clip_from_world": _plain(out.camera.clip_from_world[0]),
            "fov_deg": camera["fov_deg"],
            "distance": camera["distance"],
        },
        "hypotheses": {
            "probabilities": _plain(out.hypotheses.probabilities[0]),
            "predicted_losses": _plain(out.hypotheses.predicted_losses[0]),
            "chosen": chosen,
        },
        "bone_angles": None if out.pose is None else angles(out.pose.angles[0]),
        "bank": _bank(fit.bank),
        "mesh": {"vertices": out.posed.verts.shape[1], "faces": out.posed.faces.shape[0]},
        "light": {
            "direction": _plain(out.light.direction[0]),
            "ambient": _rounded(float(out.light.ambient[0])),
            "diffuse": _rounded(float(out.light.diffuse[0])),
        },
    }


def angles(pose: torch.Tensor) -> dict[str, list[float]]:
    """Swing, sideways and twist of each bone by its name, radians."""
    from fauna.export.joints import JOINT_NAMES, JOINT_OF_BONE

    return {JOINT_NAMES[JOINT_OF_BONE[bone]]: _plain(each) for bone, each in enumerate(pose)}


def _bank(view: BankView | None) -> dict[str, Any] | None:
    """The slots that were mixed, most important first, and what they and the whole answer resemble."""
    if view is None:
        return None
    return {
        "slots": [each.slot for each in view.slots],
        "weights": [round(each.weight, 6) for each in view.slots],
        "slot_species": [_shares(each.species) for each in view.slots],
        "species": None if view.species is None else _shares(view.species),
        "pictures": None
        if view.pictures is None
        else [{"name": each.name, "similarity": round(each.similarity, 4)} for each in view.pictures],
    }


def _shares(named: Sequence[tuple[str, float]]) -> dict[str, float]:
    return {name: round(value, 4) for name, value in named}


def _plain(values: torch.Tensor) -> Any:
    return np.round(values.detach().cpu().double().numpy(), 6).tolist()


def _rounded(value: float | None) -> float | None:
    return None if value is None else round(float(value), 4)
