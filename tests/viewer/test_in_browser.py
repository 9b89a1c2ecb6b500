"""The page in a browser: it draws the animal, says nothing on the console and asks nothing of the network."""

import numpy as np
import pytest

from fauna.viewer import write_viewer
from tests.models3d.glb_writer import Writer, write_quadruped
from tests.viewer.browser import NO_GL, look_at, needs_chromium

pytestmark = needs_chromium


@pytest.fixture(scope="module")
def page(tmp_path_factory):
    folder = tmp_path_factory.mktemp("viewer")
    glb = write_quadruped(folder / "horse.glb").read_bytes()
    write_viewer(glb, folder / "horse.html", title="A horse", facts={"Looks most like": "horse"})
    return folder / "horse.html"


@pytest.fixture(scope="module")
def seen(page, tmp_path_factory):
    return look_at(page, tmp_path_factory.mktemp("plain"))


def _colours(picture):
    """Distinct colours in the middle of the window, where the animal stands."""
    middle = picture[120:360, 160:480].reshape(-1, 3)
    return len(np.unique(middle, axis=0))


def test_the_animal_is_drawn(seen):
    assert seen.attribute("data-status") == "ready"
    assert 0.05 < float(seen.attribute("data-coverage")) < 0.8
    assert _colours(seen.picture) > 200


def test_console_and_network_stay_silent(seen):
    assert seen.console == []
    assert seen.requests == []


def test_clips_can_be_picked(seen):
    for name in ("rest pose", "Walk", "Death", "Spin"):
        assert f">{name}</option>" in seen.document
    assert 'id="play" type="button" title="Space"' in seen.document


def test_buttons_change_the_picture(page, seen, tmp_path):
    shown = look_at(page, tmp_path, fragment="clip=rest%20pose,skeleton,wires,clay,paused")
    assert shown.console == []
    for name in ("skeleton", "wires", "clay"):
        assert f'<button id="{name}" type="button" aria-pressed="true"' in shown.document
    orange = (
        (shown.picture[..., 0] > 230)
        & (abs(shown.picture[..., 1].astype(int) - 122) < 40)
        & (shown.picture[..., 2] < 90)
    )
    assert orange.sum() > 100  # joints and bones
    assert abs(shown.picture.astype(int) - seen.picture).mean() > 1


def test_without_webgl_it_says_so(page, tmp_path):
    shown = look_at(page, tmp_path, graphics=NO_GL)
    assert shown.attribute("data-status") == "failed"
    assert "This browser cannot draw in 3D here" in shown.document


def test_a_model_without_surface_is_named(tmp_path):
    writer = Writer()
    writer.document |= {"nodes": [{"name": "empty"}]}
    write_viewer(writer.bytes(), tmp_path / "empty.html", title="Nothing", facts={})
    shown = look_at(tmp_path / "empty.html", tmp_path)
    assert shown.attribute("data-status") == "failed"
    assert "the model has no surface" in shown.document


def test_requests_and_messages_would_be_noticed(tmp_path):
    page = tmp_path / "talks.html"
    page.write_text(
        '<!doctype html><html><img src="http://127.0.0.1:9/a.png"><script>console.error("oh")</script></html>'
    )
    shown = look_at(page, tmp_path)
    assert shown.requests == ["http://127.0.0.1:9/a.png"]
    assert any("oh" in line for line in shown.console)
