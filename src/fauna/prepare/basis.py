"""The basis of the feature maps: principal components of the foreground of a seeded choice of crops, the same for all species."""

import hashlib
import heapq
import json
from collections.abc import Iterator, Sequence
from pathlib import Path

import torch
from jaxtyping import Float
from safetensors import safe_open
from safetensors.torch import save
from torch import Tensor

from fauna.data.feature_cache import one_thread
from fauna.data.photo_files import decode_image
from fauna.data.photos import MASK_THRESHOLD, resize_image
from fauna.encoder.base import Encoder
from fauna.encoder.feature_space import FeatureSpace
from fauna.errors import FaunaError
from fauna.prepare.encoders import encoder_by_name
from fauna.prepare.settings import FeatureSettings, Settings
from fauna.prepare.tables import read_columns
from fauna.prepare.workspace import Workspace, write_file
from fauna.types import Features

FILE = "basis.safetensors"
FACTS = "fitted_on"
TARGET_SIGMAS = 5.0
"""Width of the range [0, 1] in deviations of the first component, as in ``conf/feature_space``."""
FOREGROUND = 0.7
"""Share of a cell that the mask must cover, likewise."""

Chosen = tuple[str, str, str]
"""Id, species and digest of a crop."""


def fit_basis(tables: Sequence[Path], settings: Settings, workspace: Workspace) -> Path:
    """Fit the basis and store it with what it was fitted on; nothing is done where that was done before.

    Crops are chosen by least digest of seed and id, and summed in the order of their ids in double precision: the result depends
    neither on shards nor on the order of tables.

    Args:
        tables: of all shards after the filter.
        settings: group ``features``.
        workspace: folders.

    Returns:
        The file.

    Raises:
        FaunaError: when there are fewer foreground cells than components, or no crop.
    """
    own = settings.features
    chosen = choose(tables, own)
    if not chosen:
        raise FaunaError(
            f"features: expected crops to fit a basis to, got none in {workspace.work}; look at its report"
        )
    encoder = encoder_by_name(own.encoder or "")
    path = workspace.work / FILE
    facts = {"encoder": encoder.fingerprint, "settings": repr(own), "crops": _digest(chosen), "count": str(len(chosen))}
    if stored_facts(path) == facts:
        return path
    space = new_space(encoder, own)
    with one_thread():
        space.fit(_samples(chosen, encoder, workspace))
    tensors = {name: value.contiguous() for name, value in space.state_dict().items()}
    write_file(
        path, save(tensors, metadata={FACTS: json.dumps(facts, sort_keys=True)})
    )  # one entry: they have no order
    from fauna.prepare.feature_pictures import draw_maps, draw_variance

    variance = [float(value) for value in space.explained_variance]
    report = {
        "crops": len(chosen),
        "encoder": encoder.fingerprint,
        "explained_variance": variance,
        "sum": sum(variance),
    }
    write_file(workspace.report / "features.json", (json.dumps(report, indent=1) + "\n").encode())
    write_file(workspace.report / "explained_variance.png", draw_variance(variance))
    write_file(workspace.report / "features.png", draw_maps(chosen, encoder, space, settings, workspace))
    return path


def choose(tables: Sequence[Path], settings: FeatureSettings) -> list[Chosen]:
    """The crops that the basis is fitted to, in the order of their ids."""

    def ranked() -> Iterator[tuple[bytes, Chosen]]:
        for table in tables:
            for part in read_columns(table, ["id", "species", "rgb_sha256", "status"]):
                for row, species, rgb, status in zip(*part.values(), strict=True):
                    if status == "ok":
                        rank = hashlib.blake2b(f"{settings.seed}\0{row}".encode(), digest_size=16).digest()
                        yield rank, (row, species, rgb)

    return sorted(chosen for _, chosen in heapq.nsmallest(settings.fit_photos, ranked()))


def new_space(encoder: Encoder, settings: FeatureSettings) -> FeatureSpace:
    """An unfitted feature space for the encoder."""
    return FeatureSpace(
        global_dim=encoder.global_dim, token_dim=encoder.token_dim, num_components=settings.channels, target_source="tokens",
        target_sigmas=TARGET_SIGMAS, foreground_threshold=FOREGROUND, standardize_global=False, standardize_tokens=False,
        max_images=settings.fit_photos, whitening=0.0,
    )  # fmt: skip


def read_basis(path: Path, encoder: Encoder, settings: FeatureSettings) -> FeatureSpace:
    """The fitted feature space of a file.

    Raises:
        FaunaError: when it is missing, damaged, or of other weights or settings.
    """
    facts = stored_facts(path)
    if facts is None or facts["encoder"] != encoder.fingerprint or facts["settings"] != repr(settings):
        got = "none" if facts is None else "one of other weights or settings"
        raise FaunaError(f"{path} expects a basis for encoder={encoder.name}, got {got}; run fauna-prepare features")
    space = new_space(encoder, settings)
    with safe_open(path, "pt") as file:
        space.load_state_dict({name: file.get_tensor(name) for name in file.keys()})  # noqa: SIM118
    return space


def stored_facts(path: Path) -> dict[str, str] | None:
    """What a basis was fitted on, ``None`` without an intact file."""
    try:
        with safe_open(path, "pt") as file:
            return json.loads(file.metadata()[FACTS])
    except Exception:  # of a missing or damaged file: safetensors has an error of its own
        return None


def encode_crop(encoder: Encoder, path: Path) -> Features:
    """Features of one crop, on one thread: what else is encoded, and where, cannot change a bit of them.

    Raises:
        FaunaError: for a crop that cannot be read.
    """
    image = resize_image(decode_image(path, "RGB"), encoder.input_size)
    with one_thread():
        return encoder.encode_together(image[None])


def read_small_mask(path: Path) -> Float[Tensor, "1 side side"]:
    """Mask of a crop, 0 or 1."""
    return torch.from_numpy(decode_image(path, "L") > MASK_THRESHOLD)[None].float()


def _samples(chosen: Sequence[Chosen], encoder: Encoder, workspace: Workspace) -> Iterator[tuple[Features, Tensor]]:
    for row, _, _ in chosen:
        features = encode_crop(encoder, workspace.crop(row, "rgb.jpg"))
        yield features, read_small_mask(workspace.crop(row, "mask.png"))


def _digest(chosen: Sequence[Chosen]) -> str:
    text = "\n".join(f"{row} {rgb}" for row, _, rgb in chosen)
    return hashlib.blake2b(text.encode(), digest_size=16).hexdigest()
