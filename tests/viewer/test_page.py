"""The page as text: what is inside, what is escaped, what is refused."""

import base64
import hashlib
import io
import re
from html.parser import HTMLParser
from importlib import resources

import pytest
from PIL import Image

from fauna.errors import FaunaError
from fauna.viewer import ViewerFrame, viewer_html, write_viewer
from tests.models3d.glb_writer import Writer

ASSETS = resources.files("fauna.viewer") / "assets"
SOURCES = ("controls.js", "scene.js", "viewer.js")
FACTS = {"Looks most like": "wolf 34 %, fox 21 %", "Flags": "<cut> & small"}


@pytest.fixture
def glb():
    return Writer().bytes()


class _Parts(HTMLParser):
    """Text of elements by tag and id; attributes by tag."""

    def __init__(self, page):
        super().__init__()
        self.texts, self.attributes, self.open = {}, [], None
        self.feed(page)

    def handle_starttag(self, tag, attrs):
        self.attributes.append((tag, dict(attrs)))
        self.open = (tag, dict(attrs).get("id"))

    def handle_endtag(self, tag):
        self.open = None

    def handle_data(self, data):
        self.texts[self.open] = self.texts.get(self.open, "") + data


def _png():
    target = io.BytesIO()
    Image.new("RGB", (4, 4), (9, 8, 7)).save(target, "PNG")
    return target.getvalue()


def test_the_model_comes_back_byte_for_byte(glb):
    texts = _Parts(viewer_html(glb, title="A", facts={})).texts
    assert base64.b64decode(texts["script", "glb"]) == glb


def test_title_and_facts_are_text_not_html(glb):
    parts = _Parts(viewer_html(glb, title='</title><script>"x"', facts=FACTS))
    assert parts.texts["title", None].strip() == '</title><script>"x"'
    assert parts.texts["dd", None] == "wolf 34 %, fox 21 %<cut> & small"
    assert sum(tag == "script" for tag, _ in parts.attributes) == 2
    assert '"x"' in dict(parts.attributes)["canvas"]["aria-label"]


def test_the_policy_allows_this_script_and_this_style_and_no_request(glb):
    parts = _Parts(viewer_html(glb, title="A", facts=FACTS))
    policy = next(each["content"] for tag, each in parts.attributes if "http-equiv" in each)
    rules = dict(rule.split(" ", 1) for rule in policy.split("; "))

    def digest(text):
        return f"'sha256-{base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()}'"

    assert rules["default-src"] == "'none'"
    assert rules["script-src"] == digest(parts.texts["script", None])
    assert rules["style-src"] == digest(parts.texts["style", None])
    assert rules["connect-src"] == "blob:"


def test_nothing_is_fetched(glb):
    attributes = _Parts(viewer_html(glb, title="A", facts=FACTS, poster=_png())).attributes
    addresses = [value for _, each in attributes for key, value in each.items() if key in ("src", "href")]
    assert addresses
    assert all(address.startswith("data:image/png;base64,") for address in addresses)


@pytest.mark.parametrize("form", ["PNG", "JPEG"])
def test_the_photograph_is_carried(glb, form):
    target = io.BytesIO()
    Image.new("RGB", (4, 4)).save(target, form)
    sources = [
        each["src"]
        for tag, each in _Parts(viewer_html(glb, title="A", facts={}, poster=target.getvalue())).attributes
        if tag == "img"
    ]
    assert [base64.b64decode(source.split(",")[1]) for source in sources] == [target.getvalue()]
    assert "<img" not in viewer_html(glb, title="A", facts={})


def test_no_panel_without_facts(glb):
    assert "<details" not in viewer_html(glb, title="A", facts={})


@pytest.mark.parametrize(
    ("broken", "message"),
    [
        (lambda glb: b"", "expected the bytes 'glTF'"),
        (lambda glb: b"PK" + glb[2:], "expected the bytes 'glTF'"),
        (lambda glb: glb[:-1], "bytes, as its header says"),
        (lambda glb: glb[:4] + b"\1" + glb[5:], "got version 1"),
    ],
)
def test_refuses_what_is_no_glb(glb, broken, message):
    with pytest.raises(FaunaError, match=message):
        viewer_html(broken(glb), title="A", facts={})


def test_refuses_another_picture(glb):
    with pytest.raises(FaunaError, match="poster: expected the bytes of a PNG or JPEG"):
        viewer_html(glb, title="A", facts={}, poster=b"GIF89a")


def test_writes_the_same_bytes_every_time_and_nothing_beside(glb, tmp_path):
    write_viewer(glb, tmp_path / "new" / "a.html", title="A", facts=FACTS)
    write_viewer(glb, tmp_path / "new" / "b.html", title="A", facts=FACTS)
    first, second = sorted((tmp_path / "new").iterdir())
    assert first.read_bytes() == second.read_bytes()
    assert first.read_text(encoding="utf-8") == viewer_html(glb, title="A", facts=FACTS)


def test_the_bundle_was_made_from_the_sources_beside_it():
    bundle = (ASSETS / "viewer.min.js").read_text(encoding="utf-8")
    digest = hashlib.sha256(b"".join((ASSETS / name).read_bytes() for name in SOURCES)).hexdigest()
    assert digest in bundle.splitlines()[0], "a source changed: build viewer.min.js again, see assets/README.md"
    assert "</script" not in bundle
    assert "\r" not in bundle
    version = re.search(r'"three": "([\d.]+)"', (ASSETS / "package.json").read_text(encoding="utf-8"))
    assert version is not None
    assert f"three.js {version[1]}, MIT" in bundle.splitlines()[0]
    assert "Permission is hereby granted" in (ASSETS / "LICENSE-three.txt").read_text(encoding="utf-8")


def test_a_frame_carries_the_page_and_shuts_it_off(glb):
    page = viewer_html(glb, title='A "quoted" one', facts=FACTS)
    frame = ViewerFrame(page, 300)
    ((tag, attributes),) = _Parts(frame._repr_html_()).attributes
    assert tag == "iframe"
    assert attributes["srcdoc"] == page
    assert attributes["sandbox"].split() == ["allow-scripts", "allow-downloads"]
    assert "height:300px" in attributes["style"]
    assert len(repr(frame)) < 100
