"""``fauna-demo`` on the command line, without starting a server."""

import os
import socket
import subprocess
import sys

import pytest

from fauna.demo.command import Options, _listen, check, parse
from fauna.errors import FaunaError

GIVEN = {
    "host": "127.0.0.1",
    "port": 0,
    "max_upload_mb": 20,
    "max_waiting": 16,
    "checkpoint": None,
    "segmenter": None,
    "device": "cpu",
}


def _run(*arguments, path=None):
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([*(path or []), *sys.path])}
    return subprocess.run(
        [sys.executable, "-m", "fauna.demo.command", *arguments],
        env=environment,
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )


def test_only_this_computer_by_default():
    assert parse([]).host == "127.0.0.1"


def test_help_says_what_it_does_and_imports_nothing_heavy(tmp_path):
    for name in ("torch", "gradio", "numpy"):
        (tmp_path / f"{name}.py").write_text("raise ImportError('heavy')")
    done = _run("--help", path=[str(tmp_path)])
    assert done.returncode == 0, done.stderr
    assert "sends nothing anywhere" in done.stdout


def test_without_gradio_one_line_says_how_to_get_it(monkeypatch):
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    with pytest.raises(
        FaunaError,
        match=r"^fauna-demo: expected the package gradio, got none; pip install -e '\.\[demo\]' in the checkout$",
    ):
        check(Options(**GIVEN))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"port": 70000}, "--port: expected"),
        ({"max_upload_mb": 0}, "--max-upload-mb: expected"),
        ({"max_waiting": 0}, "--max-waiting"),
    ],
)
def test_refuses_numbers_out_of_range(change, message):
    with pytest.raises(FaunaError, match=message):
        check(Options(**{**GIVEN, **change}))


def test_a_port_in_use_is_one_line():
    with socket.socket() as other:
        other.bind(("127.0.0.1", 0))
        other.listen()
        with pytest.raises(
            FaunaError, match=r"expected an address to listen on, got 127.0.0.1 \d+ \(Address already in use\)"
        ):
            _listen("127.0.0.1", other.getsockname()[1])
    with pytest.raises(FaunaError, match="got no.such.host.invalid 1 "):
        _listen("no.such.host.invalid", 1)


def test_a_bad_argument_is_one_line():
    done = _run("--port", "many")
    assert done.returncode == 2
    assert done.stderr == "fauna: error: argument --port: invalid int value: 'many'; see fauna-demo --help\n"
