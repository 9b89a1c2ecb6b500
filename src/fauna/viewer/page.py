"""One HTML file that shows an animated model in 3D, with everything inside: no network, no server, no installation.

The script is three.js with our few lines on top, bundled once (``assets/README.md``). The page's content security policy allows that
script by its hash and forbids every request, so a model cannot make the page load anything either.
"""

import base64
import hashlib
import html
import struct
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cache
from importlib import resources
from pathlib import Path
from string import Template

from fauna.errors import FaunaError

PICTURES = {b"\x89PNG\r\n\x1a\n": "image/png", b"\xff\xd8\xff": "image/jpeg"}
"""First bytes of the pictures a page may carry, and their types."""


def write_viewer(glb: bytes, path: Path, *, title: str, facts: Mapping[str, str], poster: bytes | None = None) -> None:
    """Write the page of :func:`viewer_html`; the file appears when it is complete.

    Raises:
        FaunaError: when ``glb`` or ``poster`` are of another format.
    """
    page = viewer_html(glb, title=title, facts=facts, poster=poster)
    path.parent.mkdir(parents=True, exist_ok=True)
    partial = path.with_name(path.name + ".partial")
    partial.write_text(page, encoding="utf-8", newline="\n")
    partial.replace(path)


def viewer_html(glb: bytes, *, title: str, facts: Mapping[str, str], poster: bytes | None = None) -> str:
    """The page as text: it can be turned and zoomed, plays the model's clips and shows its skeleton.

    Args:
        glb: binary glTF 2.0 that refers to nothing outside itself; it may have skins, clips and textures.
        title: of the page, plain text.
        facts: what is said about the animal, in order: name to value, plain text. Empty: no panel.
        poster: PNG or JPEG of the photograph, shown in a corner.

    Raises:
        FaunaError: when ``glb`` or ``poster`` are of another format.
    """
    _check_glb(glb)
    style, script = _asset("viewer.css"), _asset("viewer.min.js")
    return Template(_asset("viewer.html")).substitute(
        title=html.escape(title),
        policy=_policy(style, script),
        style=style,
        script=script,
        poster="" if poster is None else _poster(poster),
        facts=_facts(facts) if facts else "",
        glb=base64.b64encode(glb).decode(),
    )


@dataclass(frozen=True)
class ViewerFrame:
    """A page of :func:`viewer_html` inside another page: shown by Jupyter when it is the last value of a cell.

    It is shut off from the page around it.

    Attributes:
        page: the page.
        height: in pixels.
    """

    page: str = field(repr=False)
    height: int = 480

    def html(self) -> str:
        """An element for any page."""
        return (
            '<iframe title="3D model" sandbox="allow-scripts allow-downloads" '
            f'style="width:100%;height:{self.height}px;border:0;border-radius:8px;display:block" srcdoc="{html.escape(self.page)}"></iframe>'
        )

    def _repr_html_(self) -> str:
        return self.html()


@cache
def _asset(name: str) -> str:
    return (resources.files("fauna.viewer") / "assets" / name).read_text(encoding="utf-8")


@cache
def _policy(style: str, script: str) -> str:
    """Our script and style by their hashes, pictures from within the page, nothing else."""
    rules = {
        "default-src": "'none'",
        "script-src": _hash(script),
        "style-src": _hash(style),
        "img-src": "data: blob:",
        "connect-src": "blob:",  # textures of the model, unpacked in memory
        "base-uri": "'none'",
        "form-action": "'none'",
    }
    return "; ".join(f"{name} {value}" for name, value in rules.items())


def _hash(text: str) -> str:
    return f"'sha256-{base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()}'"


def _poster(picture: bytes) -> str:
    kind = next((kind for start, kind in PICTURES.items() if picture.startswith(start)), None)
    if kind is None:
        raise FaunaError(
            f"poster: expected the bytes of a PNG or JPEG, got {picture[:8]!r}; save the picture as PNG first"
        )
    source = f"data:{kind};base64,{base64.b64encode(picture).decode()}"
    return (
        f'<figure class="photo"><img alt="The photograph" src="{source}"><figcaption>photograph</figcaption></figure>'
    )


def _facts(facts: Mapping[str, str]) -> str:
    entries = "".join(f"<dt>{html.escape(name)}</dt><dd>{html.escape(value)}</dd>" for name, value in facts.items())
    return f'<details class="facts" id="facts"><summary>About this model</summary><dl>{entries}</dl></details>'


def _check_glb(glb: bytes) -> None:
    remedy = "give the bytes of a binary glTF 2.0 file (.glb)"
    if len(glb) < 20 or glb[:4] != b"glTF":
        raise FaunaError(f"model: expected the bytes 'glTF' at its start, got {glb[:4]!r}; {remedy}")
    version, length = struct.unpack_from("<II", glb, 4)
    if version != 2 or length != len(glb):
        raise FaunaError(
            f"model: expected version 2 and {length} bytes, as its header says, got version {version} and {len(glb)} bytes; {remedy}"
        )
