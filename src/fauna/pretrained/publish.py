"""``python -m fauna.pretrained.publish``: from a run and its reports to the folder of a model that ships with the package."""

import argparse
import json
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import torch
import yaml

import fauna
from fauna.cli import one_line_errors
from fauna.data.feature_cache import write_atomically
from fauna.errors import FaunaError
from fauna.evaluation.weights import facts, locate
from fauna.io.checkpoint import read_weights, safetensors_bytes
from fauna.pretrained.card import card, data_section, metrics_of, metrics_section
from fauna.pretrained.load import load_model
from fauna.pretrained.provenance import Provenance, provenance
from fauna.pretrained.reports import head_is_at_minus_z, read_report
from fauna.pretrained.scrub import refuse_paths, without_machine
from fauna.pretrained.shipped import CARD, CONFIG, INDEX, MAX_BYTES, METRICS, MODEL, WEIGHTS, sha256

TURNED = (
    " The run had settled with its head at -z, as nothing in the training prefers an end; it was turned by 180 degrees\nabout "
    "the vertical for publication, which changes no picture."
)


def main() -> None:
    """Parse the command line and publish."""
    parser = argparse.ArgumentParser(description="Make the folder of a model that ships with the package.")
    parser.add_argument("--checkpoint", required=True, help="weight file, checkpoint or folder of a run")
    parser.add_argument(
        "--report", required=True, action="append", type=Path, help="folder of a fauna-eval report of it; repeatable"
    )
    parser.add_argument("--out", required=True, type=Path, help=f"e.g. src/fauna/pretrained/{MODEL}")
    parser.add_argument("--hours", required=True, type=float, help="what the training took")
    parser.add_argument("--machine", required=True, help="what it was trained on, in words")
    parser.add_argument("--limits", required=True, type=Path, help="text file: limits and known failures, Markdown")
    given = parser.parse_args()

    with one_line_errors("python -m fauna.pretrained.publish"):
        publish(
            checkpoint=given.checkpoint,
            reports=given.report,
            out=given.out,
            hours=given.hours,
            machine=given.machine,
            limits=given.limits,
        )


def publish(
    *, checkpoint: str, reports: Sequence[Path], out: Path, hours: float, machine: str, limits: Path
) -> dict[str, str]:
    """Write weights, configuration, metrics, model card and an index of their digests; equal inputs give equal bytes.

    Optimiser and discriminator stay behind, the numbers of the weights stay exactly as they are, and nothing that ships
    names a place on the machine that trained them. What ships has its head at +z: a run that settled with the head at -z,
    as its reports found, is turned (:mod:`fauna.geometry.half_turn`).

    Args:
        checkpoint: weight file, checkpoint or folder of a run.
        reports: folders of ``fauna-eval`` reports of exactly this file, one at least of a dataset with truth.
        out: folder to write.
        hours: of training.
        machine: that trained it, in words.
        limits: file with limits and known failures, Markdown.

    Returns:
        SHA-256 by file name, as in the index.

    Raises:
        FaunaError: when hours or machine are missing, the weights are too large, learned from what may not be passed on, are not those of a report, or
            a text holds an absolute path; when no report can tell where the head is.
    """
    if not 0 < hours < math.inf or not machine.strip():
        raise FaunaError(
            f"hours, machine: expected what the training took and on what, got {hours:g} and {machine!r}; give both"
        )
    described = {"machine": machine, "limits": _read_text(limits)}
    for name, text in described.items():
        refuse_paths(name, text)
    path = locate(checkpoint)
    tensors, metadata = read_weights(path)
    about = facts(path, metadata)
    measured = [read_report(folder, about["sha256"]) for folder in reports]
    turned = metadata["turned"] != head_is_at_minus_z(measured)
    original = metadata["config"]
    learned_from = provenance(original)
    metadata = {**metadata, "config": without_machine(metadata["config"]), "turned": turned}
    half = all(torch.equal(value, value.half().float()) for value in tensors.values() if value.is_floating_point())
    weights = _weight_file(tensors, metadata, half=half)
    metrics = metrics_of(measured)
    described |= {
        "parameters": f"{sum(each.numel() for each in load_model(path, device='cpu').parameters()):,}",
        "megabytes": f"{len(weights) / 1e6:.1f}",
        "dtype": "16-bit floats" if half else "32-bit floats",
        "sha256": sha256(weights),
        "hours": f"{hours:g}",
        "metrics": metrics_section(metrics),
        **_training_facts(metadata, original, about["step"], learned_from),
    }
    texts = {
        CONFIG: yaml.safe_dump(metadata["config"], sort_keys=False),
        METRICS: _json({"run": about["run"], "step": about["step"], "measured": about["sha256"], "reports": metrics}),
        CARD: card(model=MODEL, version=fauna.__version__, **described),
    }
    return _write(out, weights, texts)


def _training_facts(
    metadata: Mapping[str, Any], original: Mapping[str, Any], step: int | None, learned_from: Provenance
) -> dict[str, str]:
    """What the card says about the training, by the names of its template; ``original`` is the configuration with its paths."""
    config = metadata["config"]
    held_out = list(config["data"]["held_out"])
    held_out += [f"{each.species} ({each.name})" for each in learned_from.held_out if each.species not in held_out]
    return {
        "encoder": metadata["encoder"],
        "data": data_section(learned_from),
        "species": ", ".join(metadata["species"]),
        "held_out": ", ".join(held_out) or "none",
        "run": str(config["name"]),
        "seed": str(config["seed"]),
        "steps": f"{step or config['trainer']['max_steps']:,}",
        "batch": str(config["data"]["batch_size"] * config["data"]["accumulate"]),
        "image_size": str(config["data"]["image_size"]),
        "turned": TURNED if metadata["turned"] else "",
        "started": _started(original),
    }


def _started(config: Mapping[str, Any]) -> str:
    """A sentence on the run that these weights went on from."""
    if config.get("init_from") is None:
        return ""
    before = read_weights(locate(str(config["init_from"])))[1]["config"]
    parts = " and ".join(f"`{part}`" for part in config.get("init_components") or ["all parts"])
    steps = f"{before['trainer']['max_steps']:,}"
    return f" It began with {parts} of a run of {steps} steps on the same photographs; the hours count both."


def _weight_file(tensors: Mapping[str, torch.Tensor], metadata: Mapping[str, Any], *, half: bool) -> bytes:
    """The weight file; ``half`` stores 16 bits, for tensors that lose nothing by it."""
    stored = {
        name: (value.half() if half and value.is_floating_point() else value).contiguous().clone()
        for name, value in tensors.items()
    }
    texts = {
        "config": yaml.safe_dump(metadata["config"], sort_keys=False),
        "stage": json.dumps(metadata["stage"].state()),
        "turned": json.dumps(metadata["turned"]),
        "species": json.dumps(metadata["species"]),
        "fauna": fauna.__version__,
        "encoder": metadata["encoder"],
    }
    content = safetensors_bytes(stored, texts)
    if len(content) > MAX_BYTES:
        raise FaunaError(
            f"checkpoint: expected weights of at most {MAX_BYTES / 1e6:g} MB, got {len(content) / 1e6:.1f} MB; publish the "
            "weights.safetensors of a run (16 bits) or train a smaller model"
        )
    return content


def _write(out: Path, weights: bytes, texts: Mapping[str, str]) -> dict[str, str]:
    """Check the texts, then write everything, the index last: with it the model is whole, and without it there is none. Returns the digests."""
    for name, text in texts.items():
        refuse_paths(name, text)
    contents = {WEIGHTS: weights, **{name: text.encode() for name, text in texts.items()}}
    digests = {name: sha256(content) for name, content in sorted(contents.items())}
    index = _json({"format": 1, "fauna": fauna.__version__, "files": digests})
    (out / INDEX).unlink(missing_ok=True)
    for name, content in {**contents, INDEX: index.encode()}.items():
        write_atomically(out / name, content)
    print(f"model: {out} ({len(weights) / 1e6:.1f} MB, SHA-256 {digests[WEIGHTS][:16]})")
    return digests


def _read_text(path: Path) -> str:
    try:
        text = path.read_text(encoding="utf-8").strip()
    except (OSError, UnicodeDecodeError) as error:
        raise FaunaError(
            f"limits: expected a text file, got {path} ({type(error).__name__}); check the path"
        ) from error
    if not text:
        raise FaunaError(f"limits: expected the known failures, got an empty file {path}; every model has some")
    return text


def _json(content: Any) -> str:
    return json.dumps(content, indent=1) + "\n"


if __name__ == "__main__":
    main()
