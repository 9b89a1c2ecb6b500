"""Checkpoints (everything, to resume) and weight files (safetensors, to use); written atomically, read strictly."""

import json
import logging
import os
import zipfile
from pathlib import Path
from typing import Any

import torch
from omegaconf import OmegaConf
from safetensors import safe_open
from safetensors.torch import load_file, save

import fauna
from fauna.errors import FaunaError
from fauna.model import FaunaModel
from fauna.stages import Stage

log = logging.getLogger(__name__)


def checkpoints(folder: Path) -> list[Path]:
    """Checkpoints of a run, newest step first."""
    return sorted(folder.glob("step-*.ckpt"), reverse=True)


def newest_checkpoint(folder: Path) -> Path | None:
    """The newest checkpoint that can be read; a damaged one is reported and passed over.

    Raises:
        FaunaError: when there are checkpoints but none can be read.
    """
    found = checkpoints(folder)
    for path in found:
        try:
            torch.load(path, map_location="cpu", weights_only=True, mmap=True)
            with zipfile.ZipFile(path) as archive:  # torch does not look at the checksums
                damaged = archive.testzip()
            if damaged is not None:
                raise ValueError(f"wrong checksum of {damaged}")
        except Exception as error:  # a torn file raises anything from EOFError to UnpicklingError
            log.warning("checkpoint %s is damaged (%s); falling back to the one before", path, type(error).__name__)
        else:
            return path
    if found:
        raise FaunaError(f"resume expected a readable checkpoint in {folder}, got only damaged ones; start a new out=")
    return None


def save_weights(model: FaunaModel, path: Path, *, config: str, species: list[str], half: bool) -> None:
    """Write the model (encoder excluded) as safetensors; metadata holds config, stage and versions."""
    state = {name: value for name, value in model.state_dict().items() if isinstance(value, torch.Tensor)}
    tensors = {
        name: (value.half() if half and value.is_floating_point() else value).contiguous().clone()
        for name, value in state.items()
    }
    metadata = {
        "config": config,
        "stage": json.dumps(model.stage.state()),
        "turned": json.dumps(model.turned),
        "species": json.dumps(species),
        "fauna": fauna.__version__,
        "encoder": model.encoder.fingerprint,
    }
    partial = path.with_suffix(".partial")
    partial.write_bytes(safetensors_bytes(tensors, metadata))
    os.replace(partial, path)


def safetensors_bytes(tensors: dict[str, torch.Tensor], metadata: dict[str, str]) -> bytes:
    """A safetensors file; equal content gives equal bytes, which the library's own order of texts does not."""
    content = save(tensors, metadata=metadata)
    length = int.from_bytes(content[:8], "little")
    header = json.dumps(json.loads(content[8 : 8 + length]), sort_keys=True, separators=(",", ":")).encode()
    header += b" " * (-len(header) % 8)  # the tensors stay aligned
    return len(header).to_bytes(8, "little") + header + content[8 + length :]


def read_weights(path: Path) -> tuple[dict[str, torch.Tensor], dict[str, Any]]:
    """Tensors (float32) and metadata ``config`` (plain containers), ``stage``, ``turned``, ``encoder``, ``species`` of a weight file or checkpoint.

    Raises:
        FaunaError: when the file is missing or is neither.
    """
    if not path.is_file():
        raise FaunaError(f"expected a weight file or checkpoint, got {path}, which does not exist; check the path")
    try:
        if path.suffix == ".safetensors":
            with safe_open(path, framework="pt") as handle:
                raw = handle.metadata() or {}
            tensors = {name: _full(value) for name, value in load_file(path).items()}
            metadata = {
                "config": OmegaConf.to_container(OmegaConf.create(raw["config"])),
                "stage": Stage.from_state(json.loads(raw["stage"])),
                "turned": json.loads(raw.get("turned", "false")),
                "encoder": raw["encoder"],
                "species": json.loads(raw["species"]),
            }
            return tensors, metadata
        state = torch.load(path, map_location="cpu", weights_only=True, mmap=True)
        prefixed = {key.removeprefix("model."): v for key, v in state["state_dict"].items() if key.startswith("model.")}
        extra = prefixed.pop("_extra_state")
        metadata = {
            "config": OmegaConf.to_container(OmegaConf.create(state["fauna"]["config"])),
            "stage": Stage.from_state(extra["stage"]),
            "turned": extra.get("turned", False),
            "encoder": state["fauna"]["encoder"],
            "species": list(state["fauna"]["species"]),
        }
    except Exception as error:  # a file of another kind raises anything
        raise FaunaError(
            f"expected fauna weights (.safetensors) or a checkpoint (.ckpt), got {path} ({type(error).__name__}); "
            "the file is damaged or of another program"
        ) from error
    return prefixed, metadata


def load_weights(model: FaunaModel, path: Path, components: list[str] | None = None) -> dict[str, Any]:
    """Load all parts of a model, or only some of its ``components``, and take over the file's stage.

    Raises:
        FaunaError: when names or shapes do not fit, naming the first that does not.
    """
    tensors, metadata = read_weights(path)
    if metadata["encoder"] != model.encoder.fingerprint and (components is None or "feature_space" in components):
        raise FaunaError(
            f"expected weights trained with encoder {model.encoder.fingerprint}, got {path} trained with "
            f"{metadata['encoder']}; choose the encoder it was trained with"
        )
    wanted = {name: v for name, v in model.state_dict().items() if isinstance(v, torch.Tensor)}
    if components is not None:
        unknown = [part for part in components if not any(name.startswith(f"{part}.") for name in tensors)]
        if unknown:
            have = sorted({name.split(".")[0] for name in tensors})
            raise FaunaError(f"init_components: expected parts among {have}, got {unknown}; correct the list")
        keep = tuple(f"{part}." for part in components)
        wanted = {name: value for name, value in wanted.items() if name.startswith(keep)}
        tensors = {name: value for name, value in tensors.items() if name.startswith(keep)}
    for name in sorted(wanted.keys() ^ tensors.keys()):
        where = "the model but not in the file" if name in wanted else "the file but not in the model"
        raise FaunaError(f"expected weights of the same model, got {name} in {where}; compose the same experiment")
    for name, value in wanted.items():
        if value.shape != tensors[name].shape:
            raise FaunaError(
                f"expected {name} of shape {tuple(value.shape)}, got {tuple(tensors[name].shape)} in {path}; "
                "compose the same experiment"
            )
    extra = {"stage": metadata["stage"].state(), "turned": metadata["turned"]}
    model.load_state_dict({**tensors, "_extra_state": extra}, strict=components is None)
    return metadata


def _full(value: torch.Tensor) -> torch.Tensor:
    return value.float() if value.dtype == torch.float16 else value
