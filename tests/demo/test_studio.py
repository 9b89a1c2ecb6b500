"""From a photograph to what the page shows, with the model of the package."""

import re
from dataclasses import replace

import numpy as np
import pytest
from PIL import Image

import fauna
from fauna.demo.studio import Studio, plain
from fauna.reconstruct.settings import default_settings


@pytest.fixture(scope="module")
def studio():
    settings = default_settings()
    small = replace(settings.output, texture_size=64, preview_cell=64, finetune_iterations=1)
    return Studio(reconstructor=fauna.load(settings=replace(settings, output=small)))


@pytest.fixture(scope="module")
def photo(tmp_path_factory):
    """A drawn animal; its mask is the alpha channel."""
    path = tmp_path_factory.mktemp("photo") / "my <b>dog.png"
    picture = np.full((120, 160, 4), 90, np.uint8)
    picture[..., 3] = 0
    picture[40:80, 30:130] = (150, 100, 60, 255)
    for left in (34, 50, 104, 120):
        picture[80:110, left : left + 7] = (120, 80, 50, 255)
    picture[20:60, 116:146] = (160, 110, 70, 255)
    Image.fromarray(picture).save(path)
    return path


def test_everything_is_shown(studio, photo, tmp_path):
    shown = studio.show(photo, tmp_path, fit_colours=False)
    assert shown.glb is not None
    assert shown.glb.parent == tmp_path
    assert re.fullmatch(r"[\w-]+\.glb", shown.glb.name)
    assert shown.glb.read_bytes()[:4] == b"glTF"
    assert shown.viewer.startswith("<iframe")
    assert 'sandbox="allow-scripts allow-downloads"' in shown.viewer
    assert "<b>" not in shown.viewer.split("srcdoc=")[0]
    assert shown.viewer.count('"') == 8  # the page inside is escaped: it cannot end its attribute
    assert shown.pictures is not None
    assert sum(shown.bank.values()) == pytest.approx(1, abs=1e-4)
    assert list(shown.bank.values()) == sorted(shown.bank.values(), reverse=True)
    assert shown.message.startswith("**ok**") or shown.message.startswith("**not a quadruped**")


def test_what_is_no_picture_is_told(studio, tmp_path):
    (tmp_path / "a.png").write_bytes(b"no picture")
    shown = studio.show(tmp_path / "a.png", tmp_path, fit_colours=True)
    assert shown.glb is None
    assert shown.viewer == ""
    assert shown.message.startswith("**unreadable**")
    assert str(tmp_path) not in shown.message


def test_reasons_are_no_markup():
    assert plain("<img src=x> [a](javascript:b) **c**") == "&lt;img src=x&gt; \\[a\\]\\(javascript:b\\) \\*\\*c\\*\\*"
