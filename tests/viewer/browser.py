"""Opens pages in a headless Chromium, when there is one: FAUNA_TEST_CHROMIUM or ``chromium`` on the path."""

import json
import os
import re
import shutil
import subprocess
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

CHROMIUM = os.environ.get("FAUNA_TEST_CHROMIUM") or shutil.which("chromium") or shutil.which("chromium-browser")
FLAGS = [
    "--headless",
    "--no-sandbox",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--enable-logging=stderr",
    "--virtual-time-budget=3000",
]
SOFTWARE_GL = ["--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
NO_GL = ["--disable-gpu", "--disable-3d-apis"]

needs_chromium = pytest.mark.skipif(CHROMIUM is None, reason="needs Chromium (FAUNA_TEST_CHROMIUM)")


@dataclass(frozen=True)
class Seen:
    """What became of a page.

    Attributes:
        document: the page's HTML after its scripts ran.
        console: lines that it or the browser wrote to the console, also refusals by its security policy.
        requests: addresses that the page asked a network for, whether or not it answered.
        picture: (height, width, 3) screenshot.
    """

    document: str
    console: list[str]
    requests: list[str]
    picture: np.ndarray

    def attribute(self, name: str) -> str | None:
        """An attribute of the root element."""
        found = re.search(rf'<html[^>]*\b{name}="([^"]*)"', self.document)
        return found and found[1]


def look_at(page: Path | str, folder: Path, *, fragment: str = "", graphics: list[str] | None = None) -> Seen:
    """Open a page and wait until its scripts have come to rest.

    Args:
        page: HTML file, or an address.
        folder: where browser profile, network log and screenshot go.
        fragment: what follows the # of its address.
        graphics: flags for WebGL; by default it is drawn in software.
    """
    assert CHROMIUM is not None
    address = (page if isinstance(page, str) else page.resolve().as_uri()) + ("#" + fragment if fragment else "")
    picture, network = folder / "seen.png", folder / "network.json"
    common = [
        CHROMIUM,
        *FLAGS,
        *(SOFTWARE_GL if graphics is None else graphics),
        f"--user-data-dir={folder / 'profile'}",
    ]
    shown = ["--window-size=640,480", f"--screenshot={picture}", f"--log-net-log={network}"]
    done = subprocess.run(
        [*common, *shown, "--dump-dom", address], capture_output=True, text=True, timeout=90, check=True
    )
    console = [line for line in done.stderr.splitlines() if ":CONSOLE" in line]
    return Seen(done.stdout, console, _requests(network), np.asarray(Image.open(picture).convert("RGB")))


def _requests(network: Path) -> list[str]:
    """Addresses that a page asked for; the browser's own requests have no page as their origin."""
    events = json.loads(network.read_text(encoding="utf-8", errors="replace"))["events"]
    asked = [event["params"] for event in events if "url" in event.get("params", {})]
    by_page = [each["url"] for each in asked if each.get("initiator", "not an origin") != "not an origin"]
    return [url for url in by_page if url.startswith(("http", "ws"))]
