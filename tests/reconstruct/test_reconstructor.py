import json
from dataclasses import replace

import numpy as np
import pytest
from PIL import Image

from fauna.errors import FaunaError
from fauna.masks.base import Segmenter
from fauna.reconstruct.report import report


class Fixed(Segmenter):
    name = "fixed"
    flags = ("mask_from_saliency",)

    def __init__(self, mask):
        self.mask = mask

    def segment(self, image):
        assert image.shape[:2] == self.mask.shape
        return self.mask


def test_an_animal_from_arrays(loaded, drawn):
    image, mask = drawn
    result = loaded.reconstruct(image, mask=mask, name="horse")
    assert (result.status, result.reason, result.name) == ("ok", "", "horse")
    assert result.ok
    assert result.fit is not None
    assert result.fit.measures.iou > 0.6
    assert result.source.mask_source == "given"
    assert {"read", "mask", "crop", "features", "geometry"} <= set(result.seconds)
    again = loaded.reconstruct(image, mask=mask)
    assert again.fit is not None
    assert (again.fit.out.posed.verts == result.fit.out.posed.verts).all()


def test_file_picture_and_array_give_the_same(loaded, drawn, tmp_path):
    image, mask = drawn
    Image.fromarray(image).save(tmp_path / "x.png")
    Image.fromarray(mask.astype(np.uint8) * np.uint8(255)).save(tmp_path / "x_mask.png")
    results = [
        loaded.reconstruct(tmp_path / "x.png"),
        loaded.reconstruct(str(tmp_path / "x.png"), mask=mask),
        loaded.reconstruct(Image.fromarray(image), mask=tmp_path / "x_mask.png"),
        loaded.reconstruct(Image.fromarray(np.dstack([image, mask.astype(np.uint8) * np.uint8(255)]))),
    ]
    assert [each.source.mask_source for each in results] == ["beside", "given", "given", "alpha"]
    first = results[0].fit
    assert first is not None
    for each in results[:3]:
        assert each.fit is not None
        assert (each.fit.out.posed.verts == first.out.posed.verts).all()
    assert results[3].ok  # its background is gone, so the numbers differ


def test_the_segmenter_is_asked_last_and_its_weakness_is_told(loaded, drawn):
    image, mask = drawn
    result = replace(loaded, segmenter=Fixed(mask)).reconstruct(image)
    assert result.ok
    assert "mask_from_saliency" in result.flags
    assert (result.source.mask_source, result.source.segmenter) == ("segmenter", "fixed")


def test_two_animals(loaded, drawn):
    image, mask = np.pad(drawn[0], ((0, 0), (60, 60), (0, 0)), mode="edge"), np.pad(drawn[1], ((0, 0), (60, 60)))
    both, masks = np.concatenate([image, image[:, ::-1]], 1), np.concatenate([mask, mask[:, ::-1] * False], 1)
    other = np.concatenate([mask * False, mask[:, ::-1]], 1)
    results = loaded.reconstruct_all(both, masks=[masks | other], name="x")
    assert [each.name for each in results] == ["x", "x_2"]
    assert all("several_animals" in each.flags for each in results)
    places = [each.fit.window.x0 for each in results]
    assert abs(places[0] - places[1]) > 100
    same = loaded.reconstruct_all(both, masks=[masks, other], name="x")
    assert len(same) == 2


def test_the_window_is_in_pixels_of_the_photograph(loaded, drawn):
    image, mask = drawn
    plain = loaded.reconstruct(image, mask=mask).fit.window
    small = replace(loaded.settings, photo=replace(loaded.settings.photo, work_side=128))
    reduced = replace(loaded, settings=small).reconstruct(image, mask=mask).fit.window
    assert (reduced.photo_width, reduced.photo_height) == (256, 256)
    assert reduced.width == pytest.approx(plain.width, rel=0.05)
    assert reduced.x0 == pytest.approx(plain.x0, abs=8)


def test_the_rule_of_the_paper_cuts_what_the_other_keeps(loaded):
    image, mask = np.zeros((100, 300, 3), np.uint8), np.zeros((100, 300), bool)
    mask[40:60, 20:280] = True
    plain = replace(loaded.settings, crop=replace(loaded.settings.crop, rule="fauna"))
    widths = [
        replace(loaded, settings=settings).reconstruct(image, mask=mask).fit.window.width
        for settings in (loaded.settings, plain)
    ]
    assert widths[0] >= 260
    assert widths[1] == np.ceil(2 * np.sqrt(20 * 260))


@pytest.mark.parametrize(
    ("mask", "status"),
    [
        (np.zeros((256, 256), bool), "no_animal"),
        (np.pad(np.ones((20, 20), bool), ((0, 236), (0, 236))), "too_small"),
        (np.zeros((10, 10), bool), "bad_mask"),
    ],
)
def test_refusals_have_a_status_and_one_line(loaded, drawn, mask, status, tmp_path, stand_ins):
    result = loaded.reconstruct(drawn[0], mask=mask)
    assert (result.status, result.fit, result.confidence) == (status, None, 0.0)
    assert result.reason
    assert "\n" not in result.reason
    with pytest.raises(FaunaError, match=status):
        result.rigged()
    result.save(tmp_path / "x")
    assert [each.name for each in (tmp_path / "x").iterdir()] == ["result.json"]
    assert stand_ins == []


def test_an_animal_at_the_border_is_flagged(loaded, drawn):
    image, mask = drawn
    rows = np.flatnonzero(mask.any(1))
    cut = slice(0, int(rows[0] + 0.7 * np.ptp(rows)))
    assert "cut_by_border" in loaded.reconstruct(image[cut], mask=mask[cut]).flags
    assert "cut_by_border" not in loaded.reconstruct(image, mask=mask).flags


def test_saving_writes_what_was_asked_for(loaded, drawn, tmp_path, stand_ins):
    image, mask = drawn
    output = replace(loaded.settings.output, formats=("glb", "ply"), refine_steps=2, finetune_iterations=3)
    asked = replace(loaded, settings=replace(loaded.settings, output=output))
    result = asked.reconstruct(image, mask=mask, name="horse")
    folder = result.save(tmp_path / "horse")
    assert stand_ins == ["refine", "finetune", "bake", "rig", "glb", "ply", "viewer", "turntable"]
    names = {"model.glb", "model.ply", "viewer.html", "turntable.webp", "preview.png", "result.json"}
    assert {each.name for each in folder.iterdir()} == names
    content = json.loads((folder / "result.json").read_text())
    assert set(content["files"]) == names
    assert {"refined", "texture_finetuned"} <= set(content["flags"])
    assert {"texture", "rig", "export", "viewer", "turntable", "preview"} <= set(content["seconds"])
    with Image.open(folder / "preview.png") as picture:
        assert picture.size[0] == 6 * output.preview_cell
        assert len(np.unique(np.array(picture).reshape(-1, 3), axis=0)) > 500


def test_a_report_holds_what_the_model_said(loaded, drawn, stand_ins):
    image, mask = drawn
    result = loaded.reconstruct(image, mask=mask)
    content = report(result, seconds=result.seconds, files=())
    out, animal = result.fit.out, content["animal"]
    assert json.loads(json.dumps(content)) == content
    assert animal["camera"]["camera_from_world"] == pytest.approx(out.camera.camera_from_world[0].numpy(), abs=1e-5)
    assert list(animal["bone_angles"]) == [f"bone_{index}" for index in range(20)]
    assert animal["bone_angles"]["bone_9"] == pytest.approx(out.pose.angles[0, 9].tolist(), abs=1e-5)
    assert sum(animal["hypotheses"]["probabilities"]) == pytest.approx(1.0, abs=1e-4)
    assert sum(map(abs, animal["bank"]["weights"])) == pytest.approx(1.0, abs=1e-4)
    assert content["weights"]["name"] == "pretrained"
    assert len(content["input"]["sha256"]) == len(content["weights"]["sha256"]) == 64
    assert content["settings"]["crop"] == {"rule": "widen", "size": 256}


def test_masks_of_two_kinds_are_a_mistake(loaded, drawn, tmp_path):
    with pytest.raises(FaunaError, match="files or arrays"):
        loaded.reconstruct_all(drawn[0], masks=[drawn[1], tmp_path / "m.png"])
