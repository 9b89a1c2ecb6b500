"""Every kind of source is told by what lies in it, and becomes the same rows each time."""

import json
import os
import tarfile
import zipfile
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from fauna.errors import FaunaError
from fauna.prepare.settings import prepare_settings
from fauna.prepare.sources.archives import refusal, unpack
from fauna.prepare.sources.detect import open_source
from fauna.prepare.steps import build_step
from fauna.prepare.tables import read_table, write_table
from fauna.prepare.workspace import Workspace
from tests.data.readers.fixtures import ANIMALS, HEIGHT, WIDTH, annotation, coco_content, ellipse, photograph

SIZE = (HEIGHT, WIDTH)


def photo(path: Path, seed: int = 0) -> Path:
    """A small picture of noise."""
    path.parent.mkdir(parents=True, exist_ok=True)
    Image.fromarray(np.random.default_rng(seed).integers(0, 255, (*SIZE, 3), dtype=np.uint8)).save(path)
    return path


def mask(path: Path) -> Path:
    """The mask of the first animal of the fixtures."""
    path.parent.mkdir(parents=True, exist_ok=True)
    Image.fromarray(ellipse(ANIMALS[0]).astype(np.uint8) * np.uint8(255)).save(path)
    return path


def listed(source: Path, *words: str):
    """The source and all of its rows; listing it again gives the same."""
    workspace = Workspace(source, source.parent / "set", source.parent / "set.work")
    settings = prepare_settings(list(words))
    found = open_source(settings, workspace)
    photos = list(found.photos())
    assert photos == list(open_source(settings, workspace).photos())
    rows = [row for each in photos for row in each]
    assert len({row.id for row in rows}) == len(rows)
    for each in photos:
        assert len({(row.photo, row.source, row.group) for row in each}) == 1
        assert [row.instance for row in each] == list(range(len(each)))
    for row in rows:
        assert not row.ok or workspace.photo(row.source).is_file()
    return found, rows


def test_folders_per_species_with_masks_beside(tmp_path):
    photo(tmp_path / "in/Plains Zebra/train/a_rgb.jpg")
    mask(tmp_path / "in/Plains Zebra/train/a_mask.png")
    photo(tmp_path / "in/horse/b.png")
    mask(tmp_path / "in/horse/masks/b-1.png")
    mask(tmp_path / "in/horse/masks/b-2.png")
    photo(tmp_path / "in/horse/.hidden.png")
    (tmp_path / "in/horse/notes.txt").write_text("no photograph")
    source, rows = listed(tmp_path / "in")
    assert source.kind == "folders"
    assert [(row.species, row.source, row.given_mask) for row in rows] == [
        ("plains_zebra", "Plains Zebra/train/a_rgb.jpg", "labels:Plains Zebra/train/a_mask.png"),
        ("horse", "horse/b.png", "labels:horse/masks/b-1.png"),
        ("horse", "horse/b.png", "labels:horse/masks/b-2.png"),
    ]
    assert {row.licence for row in rows} == {"unknown"}


def test_a_flat_folder_takes_its_species_and_licence_from_the_settings(tmp_path):
    photo(tmp_path / "in/a.jpg")
    words = ("source.species=Okapi", "source.licence=CC0", "source.rename=[okapi:forest giraffe]")
    _, (row,) = listed(tmp_path / "in", *words)
    assert (row.species, row.licence) == ("forest_giraffe", "CC0")


@pytest.mark.skipif(os.name != "posix", reason="names are text on this system")
def test_names_that_are_no_utf8_lead_back_to_their_files(tmp_path):
    photo(tmp_path / "in/horse/plain.png")
    odd = os.fsencode(tmp_path / "in/horse") + b"/caf\xe9 50%.png"
    os.rename(tmp_path / "in/horse/plain.png", odd)
    _, (row,) = listed(tmp_path / "in")
    assert row.source == "horse/caf%E9 50%25.png"
    assert row.source.encode("utf-8").decode() == row.source


def lock_secret(monkeypatch):
    """Folders called secret cannot be listed, as for another user."""
    real = os.scandir

    def scandir(path):
        if str(path).endswith("secret"):
            raise PermissionError(13, "Permission denied", str(path))
        return real(path)

    monkeypatch.setattr(os, "scandir", scandir)


def test_a_folder_that_cannot_be_listed_is_a_row_with_a_reason(tmp_path, monkeypatch):
    photo(tmp_path / "in/horse/a.png")
    (tmp_path / "in/secret").mkdir()
    lock_secret(monkeypatch)
    _, rows = listed(tmp_path / "in")
    assert [(row.source, row.reasons) for row in rows] == [("horse/a.png", ()), ("secret", ("scan:unreadable",))]
    assert "Permission denied" in (rows[1].origin or "")


@pytest.mark.parametrize("kind", ["folders", "pairs"])
def test_ids_of_folders_that_cannot_be_listed_do_not_depend_on_the_place(tmp_path, monkeypatch, kind):
    lock_secret(monkeypatch)
    found = []
    for place in ("here", "there"):
        inner = tmp_path / place / "in" / ("images" if kind == "pairs" else "")
        photo(inner / "horse/a.png")
        (inner / "secret").mkdir()
        if kind == "pairs":
            mask(tmp_path / place / "in/masks/horse/a.png")
        source, rows = listed(tmp_path / place / "in")
        assert source.kind == kind
        found.append([row for row in rows if not row.ok])
    assert len(found[0]) == 1
    assert found[0] == found[1]


def test_table_groups_animals_of_a_photograph_and_names_what_is_missing(tmp_path):
    photo(tmp_path / "in/p/1.png")
    mask(tmp_path / "in/m/1.png")
    (tmp_path / "in/list.csv").write_text(
        "file,category,mask,license,url,left,top,right,bottom\n"
        "p/1.png,Red Deer,m/1.png,CC BY 4.0,https://example.org/1,8,10,28,22\n"
        "p/1.png,Red Deer,,,,35,15,55,35\n"
        "p/2.png,fox,,,,,,,\n"
        "../../etc/passwd,fox,,,,,,,\n"
    )
    source, rows = listed(tmp_path / "in")
    assert source.kind == "csv"
    first, second, missing, outside = rows
    assert (first.species, first.given_mask, first.licence) == ("red_deer", "file:m/1.png", "CC BY 4.0")
    assert first.provenance == "https://example.org/1"
    assert second.box == (35.0, 15.0, 55.0, 35.0)
    assert (second.licence, second.given_mask) == ("unknown", None)
    assert missing.reasons == outside.reasons == ("scan:missing",)
    _, alone = listed(tmp_path / "in/list.csv")
    assert [row.source for row in alone] == [row.source for row in rows]


def table(folder: Path, text: str) -> Path:
    for name in ("1.png", "2.png"):
        photo(folder / name, int(name[0]))
    (folder / "list.csv").write_text(text)
    return folder


def test_table_that_comes_back_to_a_photograph_with_another_animal_is_refused(tmp_path):
    text = "image,species,left,top,right,bottom\n1.png,fox,,,,\n2.png,fox,,,,\n./1.png,fox,1,1,9,9\n"
    with pytest.raises(FaunaError, match="line 4: expected all animals of 1.png in one place"):
        listed(table(tmp_path / "in", text))


@pytest.mark.parametrize(
    "lines", [("1.png", "./1.png", "2.png"), ("1.png", "2.png", "./1.png"), ("2.png", "1.png", "1.png")]
)
def test_a_line_that_says_the_same_again_is_left_out_by_name(tmp_path, lines):
    text = "image,species\n" + "".join(f"{name},fox\n" for name in lines)
    _, rows = listed(table(tmp_path / "in", text))
    assert sorted(row.source for row in rows if row.ok) == ["1.png", "2.png"]
    (again,) = (row for row in rows if not row.ok)
    assert again.reasons == ("scan:annotation",)
    assert "names the same animal as line" in (again.origin or "")


def test_two_spellings_of_a_photograph_are_its_animals(tmp_path):
    text = "image,species,left,top,right,bottom\n1.png,fox,1,1,9,9\n./1.png,fox,20,1,40,9\n2.png,fox,,,,\n"
    _, rows = listed(table(tmp_path / "in", text))
    assert [(row.source, row.instance) for row in rows] == [("1.png", 0), ("1.png", 1), ("2.png", 0)]


def test_a_photograph_named_by_an_absolute_path_through_a_link(tmp_path):
    folder = table(tmp_path / "in", "")
    (tmp_path / "link").symlink_to(folder)
    (folder / "list.csv").write_text(f"image,species,mask\n{tmp_path / 'link'}/1.png,fox,{tmp_path / 'link'}/2.png\n")
    _, (row,) = listed(folder)
    assert (row.source, row.given_mask) == ("1.png", "file:2.png")


@pytest.mark.parametrize("box", ["nan,1,9,9", "9,1,1,9", "1,1,inf,9", "-1e308,1,1e308,9", "a,1,9,9", "1,,,"])
def test_a_box_that_is_none_leaves_out_its_line(tmp_path, box):
    text = f"image,species,left,top,right,bottom\n1.png,fox,{box}\n2.png,fox,1,1,9,9\n"
    _, rows = listed(table(tmp_path / "in", text))
    assert [(row.source, row.ok) for row in rows] == [("list.csv line 2", False), ("2.png", True)]
    assert "expected left,top,right,bottom as numbers" in (rows[0].origin or "")


@pytest.mark.parametrize("name", ["n" * 300 + ".png", "../outside.png", "a/" * 3000 + "1.png"])
def test_names_that_no_file_can_have_leave_out_their_line(tmp_path, name):
    photo(tmp_path / "outside.png")
    _, rows = listed(table(tmp_path / "in", f"image,species,mask\n{name},fox,\n1.png,fox,{name}\n2.png,fox,\n"))
    assert [row.reasons for row in rows if not row.ok][0] == ("scan:missing",)
    assert [row.source for row in rows if row.ok][-1] == "2.png"


def test_tables_in_archives_are_read(tmp_path):
    path = zipped(
        tmp_path / "pile.zip",
        {"list.csv": b"image,species\na.png,fox\n", "a.png": photo(tmp_path / "1.png").read_bytes()},
    )
    source, (row,) = listed(path)
    assert (source.kind, row.ok, row.source) == ("csv", True, "work:unpacked/archive/a.png")


def test_species_with_names_that_no_folder_can_have_are_left_out_by_name(tmp_path):
    _, rows = listed(table(tmp_path / "in", f"image,species\n1.png,{'x' * 300}\n2.png,{'x' * 200}\n"))
    assert [row.ok for row in rows] == [False, True]
    assert len(rows[0].species) == 40
    assert "its species has a name of 300 letters" in (rows[0].origin or "")


def coco(folder: Path, **changes) -> Path:
    for name in ("one.png", "two.png"):
        photograph(folder / "photos" / name)
    content = coco_content(**changes)
    (folder / "annotations").mkdir(parents=True, exist_ok=True)
    (folder / "annotations/all.json").write_text(json.dumps(content))
    return folder


def test_coco_finds_its_photographs_licences_and_animals(tmp_path):
    licences = [{"id": 3, "name": "CC BY-SA", "url": "https://example.org"}]
    content = coco_content()
    content["images"][0]["license"] = 3
    coco(
        tmp_path / "in",
        images=content["images"],
        licenses=licences,
        info={"description": "Ours", "url": "https://example.org/set"},
    )
    source, rows = listed(tmp_path / "in")
    assert source.kind == "coco"
    assert source.keypoint_names == ("left_eye", "right_eye", "tail")
    by_source = {(row.source, row.instance): row for row in rows}
    assert set(by_source) == {("photos/two.png", 0), ("photos/one.png", 0), ("photos/one.png", 1)}
    row = by_source["photos/one.png", 1]
    assert row.box == tuple(float(side) for side in ANIMALS[1])
    assert (row.licence, row.species, row.annotated_size) == ("CC BY-SA https://example.org", "argali_sheep", (60, 40))
    assert by_source["photos/two.png", 0].licence == "unknown"
    assert row.provenance == "Ours, https://example.org/set"
    assert row.keypoints is not None
    assert row.keypoints[2] == (0.0, 0.0, 0.0)


def test_annotations_that_cannot_be_used_are_rows_with_reasons(tmp_path):
    crowd = annotation(13, 1, ANIMALS[0], iscrowd=1)
    lost = annotation(14, 99, ANIMALS[0])
    images = [*coco_content()["images"], {"id": 5, "file_name": "gone.png"}]
    annotations = [*coco_content()["annotations"], crowd, lost, annotation(15, 5, ANIMALS[0])]
    coco(tmp_path / "in", images=images, annotations=annotations)
    _, rows = listed(tmp_path / "in")
    assert sorted(row.reasons[0] for row in rows if not row.ok) == [
        "scan:annotation",
        "scan:annotation",
        "scan:missing",
    ]
    assert sum(row.ok for row in rows) == 3


BROKEN = {
    "polygon": {"segmentation": ["a", "b"]},
    "number": {"segmentation": 7},
    "box": {"bbox": [float("nan"), 1, 9, 9]},
    "short box": {"bbox": [1, 2]},
    "empty box": {"bbox": [9, 9, -4, 0], "segmentation": None},
    "keypoints": {"keypoints": [1, 2]},
    "fewer keypoints": {"keypoints": [1, 2, 1]},
    "far keypoint": {"keypoints": [1e308, 2, 1, 3, 4, 1, 5, 6, 1]},
    "far box": {"bbox": [1e308, 1, 1e308, 9]},
    "image": {"image_id": None},
    "no image": {"image_id": 77},
    "category": {"category_id": [1]},
}


@pytest.mark.parametrize("kind", BROKEN)
def test_a_broken_annotation_leaves_out_itself_alone(tmp_path, kind):
    content = coco_content()["annotations"]
    broken = {**content[0], "id": 99, **BROKEN[kind]}
    coco(tmp_path / "in", annotations=[broken, *content])
    _, rows = listed(tmp_path / "in")
    assert [row.reasons for row in rows if not row.ok] == [("scan:annotation",)]
    assert sum(row.ok for row in rows) == len(content)


@pytest.mark.parametrize(
    "name", [None, 5, "", "a\0b.png", "n" * 300 + ".png", "\ud800.png", "../../../../etc/hostname"]
)
def test_a_file_name_that_is_none_leaves_out_its_photograph(tmp_path, name):
    content = coco_content()
    images = [*content["images"], {"id": 50, "file_name": name}, {"id": 51}, "no object"]
    more = [annotation(40 + image, image, ANIMALS[0]) for image in (50, 51)]
    coco(tmp_path / "in", images=images, annotations=[*content["annotations"], *more, "no object", {}])
    _, rows = listed(tmp_path / "in")
    assert sum(row.ok for row in rows) == 3
    assert sum(not row.ok for row in rows) == 4
    write_table(tmp_path / "table.parquet", rows)
    assert list(read_table(tmp_path / "table.parquet")) == rows
    settings, workspace = prepare_settings([]), Workspace(tmp_path / "in", tmp_path / "set", tmp_path / "set.work")
    steps = [build_step(name, settings, workspace) for name in ("scan", "mask")]
    for row in rows:
        assert [step.stamp((row,)) for step in steps]


def test_an_impossible_size_leaves_out_its_photograph(tmp_path):
    images = coco_content()["images"]
    images[0] = {**images[0], "width": 10**30, "height": 40}
    coco(tmp_path / "in", images=images)
    _, rows = listed(tmp_path / "in")
    assert 0 < sum(row.ok for row in rows) < 3
    write_table(tmp_path / "table.parquet", rows)


def test_odd_licences_are_no_licences(tmp_path):
    images = [{**image, "license": [3]} for image in coco_content()["images"]]
    coco(tmp_path / "in", images=images, licenses=[{"id": {}, "name": "mine"}])
    _, rows = listed(tmp_path / "in")
    assert {row.licence for row in rows} == {"unknown"}


CATEGORY = {"id": 1, "name": "cow"}


@pytest.mark.parametrize(
    "changes",
    [
        {"categories": [{**CATEGORY, "keypoints": 5}]},
        {"categories": [{**CATEGORY, "keypoints": "ab"}]},
        {"categories": [{**CATEGORY, "keypoints": ["tail", "nose", "tail"]}]},
        {"categories": None},
        {"images": None},
        {"items": [], "keypoint_names": 3},
        {"items": [], "keypoint_names": ["tail", "tail"]},
    ],
)
def test_lists_that_are_none_are_told_in_one_line(tmp_path, changes):
    coco(tmp_path / "in", **changes)
    with pytest.raises(FaunaError, match="expects") as error:
        listed(tmp_path / "in")
    assert "\n" not in str(error.value)


def test_items_whose_names_of_keypoints_are_null_have_none(tmp_path):
    photo(tmp_path / "in/1.jpg")
    content = {"keypoint_names": None, "items": [{"image": "1.jpg", "category": "cow", "bbox_xyxy": [1, 2, 9, 9]}]}
    (tmp_path / "in/annotations.json").write_text(json.dumps(content))
    source, rows = listed(tmp_path / "in")
    assert not source.keypoint_names
    assert [row.ok for row in rows] == [True]


def test_items_and_other_lists_with_broken_entries(tmp_path):
    photo(tmp_path / "in/1.jpg")
    good = {"image": "1.jpg", "category": "cow", "bbox_xyxy": [1, 2, 9, 9], "keypoints": [[3, 4, 1], [0, 0, 0]]}
    bad = [
        7,
        {"category": "cow"},
        {**good, "width": "wide", "height": 3},
        {**good, "keypoints": [[1, 2, 1]]},
        {**good, "mask": "../../x.png"},
    ]
    content = {"keypoint_names": ["left_eye", "nose"], "items": [*bad, good]}
    (tmp_path / "in/annotations.json").write_text(json.dumps(content))
    _, rows = listed(tmp_path / "in")
    assert [row.ok for row in rows] == [True] + [False] * len(bad)
    assert {row.reasons for row in rows[1:]} == {("scan:annotation",)}


def test_several_annotation_files_share_one_order_of_keypoints(tmp_path):
    coco(tmp_path / "in/first")
    other = {"id": 7, "name": "dog", "keypoints": ["tail", "chin", "left_eye"]}
    coco(tmp_path / "in/second", categories=[other])
    source, rows = listed(tmp_path / "in")
    assert source.keypoint_names == ("left_eye", "right_eye", "tail", "chin")
    assert {len(row.keypoints or ()) for row in rows} == {4}
    dog = next(row for row in rows if row.species == "dog")
    sheep = next(row for row in rows if row.species == "argali_sheep")
    assert dog.keypoints is not None
    assert sheep.keypoints is not None
    assert dog.keypoints[2] == sheep.keypoints[0]  # the first point of both files: a tail here, an eye there
    assert dog.keypoints[1] == (0.0, 0.0, 0.0)


def test_items_with_masks_of_one_animal_each(tmp_path):
    photo(tmp_path / "in/images/1.jpg")
    mask(tmp_path / "in/masks/1_a.png")
    item = {"image": "images/1.jpg", "mask": "masks/1_a.png", "category": "cow", "keypoints": [[3, 4, 1], [0, 0, 0]]}
    content = {
        "keypoint_names": ["left_eye", "nose"],
        "items": [item, {**item, "mask": None, "bbox_xyxy": [1, 2, 9, 9]}],
    }
    (tmp_path / "in/annotations.json").write_text(json.dumps(content))
    source, rows = listed(tmp_path / "in")
    assert source.keypoint_names == ("left_eye", "nose")
    assert [row.given_mask for row in rows] == ["file:masks/1_a.png", None]
    assert rows[0].keypoints == ((3.5, 4.5, 1.0), (0.0, 0.0, 0.0))


def test_apt36k_keeps_clips_together(tmp_path):
    from fauna.data.readers.keypoints import KEYPOINT_SETS

    names = list(KEYPOINT_SETS["ap10k"].names)
    files = [f"cat/v1c{clip}/frame{frame}.png" for clip in (1, 2) for frame in (1, 2)]
    for number, name in enumerate(files):
        photo(tmp_path / "in/data" / name, number)
    images = [{"id": number, "file_name": "D:\\set\\" + name.replace("/", "\\")} for number, name in enumerate(files)]
    flat = [5.0, 6.0, 2.0] * len(names)
    annotations = [
        {"id": n, "image_id": n, "category_id": 1, "bbox": [2, 2, 20, 20], "keypoints": flat} for n in range(4)
    ]
    content = {
        "images": images,
        "annotations": annotations,
        "categories": [{"id": 1, "name": "cat", "keypoints": names}],
    }
    (tmp_path / "in/apt36k_annotations.json").write_text(json.dumps(content))
    source, rows = listed(tmp_path / "in")
    assert source.kind == "apt36k"
    assert len({row.group for row in rows}) == 1
    assert len(rows) == 4


def test_animal3d_and_stanfordextra(tmp_path):
    photo(tmp_path / "in/images/n01_1_zebra.jpg")
    mask(tmp_path / "in/masks/n01_1_zebra.png")
    data = {"img_path": "images/n01_1_zebra.jpg", "mask_path": "masks/n01_1_zebra.png", "keypoint_2d": [[1, 2, 1]] * 26}
    (tmp_path / "in/train.json").write_text(json.dumps({"data": [data]}))
    source, (row,) = listed(tmp_path / "in")
    assert (source.kind, row.species, row.given_mask) == ("animal3d", "zebra", "file:masks/n01_1_zebra.png")
    assert source.keypoint_names is not None
    assert len(source.keypoint_names) == 26
    photo(tmp_path / "dogs/Images/n1-pug/n1_1.png")
    entry = {
        "img_path": "n1-pug/n1_1.png", "img_width": WIDTH, "img_height": HEIGHT, "img_bbox": [8, 10, 20, 12],
        "joints": [[9.0, 12.0, 1.0]] * 24, "seg": {"size": [HEIGHT, WIDTH], "counts": [0, HEIGHT * WIDTH]}, "is_multiple_dogs": False,
    }  # fmt: skip
    (tmp_path / "dogs/StanfordExtra.json").write_text(json.dumps([entry]))
    source, (row,) = listed(tmp_path / "dogs")
    assert (source.kind, row.species, row.source) == ("stanfordextra", "dog", "Images/n1-pug/n1_1.png")
    assert (row.given_mask or "").startswith("rle:")


def test_parallel_trees_of_weizmann_and_davis(tmp_path):
    photo(tmp_path / "w/rgb/horse1.jpg")
    mask(tmp_path / "w/figure_ground/horse1.jpg")
    source, (row,) = listed(tmp_path / "w")
    assert (source.kind, row.species, row.given_mask) == ("weizmann", "horse", "labels:figure_ground/horse1.jpg")
    for frame in (0, 10):
        photo(tmp_path / f"d/JPEGImages/goat/{frame:05d}.jpg")
        mask(tmp_path / f"d/Annotations/goat/{frame:05d}.png")
    source, rows = listed(tmp_path / "d")
    assert source.kind == "davis"
    assert [(row.group, row.frame, row.species) for row in rows] == [
        ("JPEGImages/goat", 0, "goat"),
        ("JPEGImages/goat", 10, "goat"),
    ]


def test_dove_videos_and_awa2(tmp_path):
    for video in ("a", "b"):
        for frame in (0, 1):
            photo(tmp_path / f"v/horse/train/{video}/{frame:07d}_rgb.png")
            mask(tmp_path / f"v/horse/train/{video}/{frame:07d}_mask.png")
    source, rows = listed(tmp_path / "v")
    assert source.kind == "dove"
    assert {row.species for row in rows} == {"horse"}
    assert [(row.group, row.frame) for row in rows[:3]] == [
        ("horse/train/a", 0),
        ("horse/train/a", 1),
        ("horse/train/b", 0),
    ]
    photo(tmp_path / "w/JPEGImages/antelope/antelope_10001.jpg")
    (tmp_path / "w/JPEGLicenses/antelope").mkdir(parents=True)
    (tmp_path / "w/JPEGLicenses/antelope/antelope_10001.txt").write_text("CC BY 2.0\nmore")
    source, (row,) = listed(tmp_path / "w")
    assert (source.kind, row.species, row.licence) == ("awa2", "antelope", "CC BY 2.0")


def test_a_container_folder_is_opened(tmp_path):
    photo(tmp_path / "in/download/JPEGImages/antelope/antelope_10001.jpg")
    assert listed(tmp_path / "in")[0].kind == "awa2"


@pytest.mark.parametrize("content", ["", "{", "[]", '{"images": 3}'])
def test_json_of_another_kind_is_passed_over(tmp_path, content):
    photo(tmp_path / "in/horse/a.jpg")
    (tmp_path / "in/other.json").write_text(content)
    assert listed(tmp_path / "in")[0].kind == "folders"


def test_nothing_to_find_is_told_in_one_line(tmp_path):
    (tmp_path / "in").mkdir()
    with pytest.raises(FaunaError, match=r"expected photographs in folders per species.*got nothing of that"):
        listed(tmp_path / "in")
    with pytest.raises(FaunaError, match="source.kind: expected one of auto"):
        listed(tmp_path / "in", "source.kind=pile")
    photo(tmp_path / "in/horse/a.jpg")
    with pytest.raises(FaunaError, match="that fit source.kind=weizmann"):
        listed(tmp_path / "in", "source.kind=weizmann")


@pytest.mark.parametrize("kind", ["zip", "tar.gz"])
def test_archives_are_unpacked_without_what_leads_outside(tmp_path, kind):
    good = photo(tmp_path / "a.png")
    path = tmp_path / f"pile.{kind}"
    names = ["horse/a.png", "../escaped.png", "/absolute.png"]
    if kind == "zip":
        with zipfile.ZipFile(path, "w") as archive:
            for name in names:
                archive.writestr(zipfile.ZipInfo(name), good.read_bytes())
            link = zipfile.ZipInfo("horse/link.png")
            link.external_attr = 0o120777 << 16
            archive.writestr(link, "/etc/passwd")
    else:
        with tarfile.open(path, "w:gz") as archive:
            for name in names:
                info = tarfile.TarInfo(name)
                info.size = good.stat().st_size
                archive.addfile(info, good.open("rb"))
            info = tarfile.TarInfo("horse/link.png")
            info.type, info.linkname = tarfile.SYMTYPE, "/etc/passwd"
            archive.addfile(info)
    _, rows = listed(path)
    assert [row.reasons for row in rows] == [(), *[("scan:refused",)] * 3]
    assert rows[0].source == "work:unpacked/archive/horse/a.png"
    assert not (tmp_path / "set.work/unpacked/escaped.png").exists()
    assert not (tmp_path / "set.work/escaped.png").exists()


def test_archives_larger_than_allowed_or_damaged_are_refused(tmp_path):
    path = tmp_path / "pile.zip"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("horse/zeros.png", bytes(1 << 20))
    with pytest.raises(FaunaError, match="expects at most 1,000 bytes"):
        unpack(path, tmp_path / "out", max_bytes=1000)
    path.write_bytes(path.read_bytes()[:200])
    with pytest.raises(FaunaError, match="expects a whole archive"):
        unpack(path, tmp_path / "out", max_bytes=1 << 30)
    assert refusal("a/../../b") is not None


def zipped(path: Path, names: dict[str, bytes]) -> Path:
    with zipfile.ZipFile(path, "w") as archive:
        for name, content in names.items():
            archive.writestr(zipfile.ZipInfo(name), content)
    return path


def test_an_archive_that_changed_is_unpacked_anew(tmp_path):
    pictures = [photo(tmp_path / f"{seed}.png", seed).read_bytes() for seed in range(3)]
    assert len({len(each) for each in pictures}) == 1
    path = zipped(tmp_path / "pile.zip", {"horse/a.png": pictures[0], "horse/b.png": pictures[1]})
    before = path.stat()
    listed(path)
    folder = tmp_path / "set.work/unpacked/archive"
    times = {each: each.stat().st_mtime_ns for each in folder.rglob("*")}
    listed(path)
    assert {each: each.stat().st_mtime_ns for each in folder.rglob("*")} == times
    zipped(path, {"horse/a.png": pictures[0], "horse/c.png": pictures[2]})
    os.utime(path, ns=(before.st_atime_ns, before.st_mtime_ns + 1))
    assert path.stat().st_size == before.st_size
    _, rows = listed(path)
    assert [Path(row.source).name for row in rows] == ["a.png", "c.png"]
    assert (folder / "horse/c.png").read_bytes() == pictures[2]


def test_unpacking_that_was_interrupted_goes_on(tmp_path, monkeypatch):
    from fauna.prepare.sources import archives

    pictures = {f"horse/{seed}.png": photo(tmp_path / f"{seed}.png", seed).read_bytes() for seed in range(3)}
    path, left = zipped(tmp_path / "pile.zip", pictures), [2]
    write = archives.write_file

    def full(target, content):
        left[0] -= 1
        if left[0] < 0:
            raise OSError(28, "No space left on device")
        write(target, content)

    with monkeypatch.context() as patched:
        patched.setattr(archives, "write_file", full)
        with pytest.raises(OSError, match="No space left"):
            unpack(path, tmp_path / "out/archive", max_bytes=1 << 30)
    time = (tmp_path / "out/archive/horse/0.png").stat().st_mtime_ns
    assert unpack(path, tmp_path / "out/archive", max_bytes=1 << 30) == ()
    assert (tmp_path / "out/archive/horse/0.png").stat().st_mtime_ns == time
    assert len(list((tmp_path / "out/archive").rglob("*.png"))) == 3


@pytest.mark.parametrize(
    "names", [("a.jpg", "a.jpg/x.jpg"), ("a.jpg/x.jpg", "a.jpg"), ("/".join(["d" * 250] * 20), "b.jpg")]
)
def test_names_that_no_file_can_have_are_refused_by_name(tmp_path, names):
    path = zipped(
        tmp_path / "pile.zip", {**dict.fromkeys(names, b"1"), "horse/good.png": photo(tmp_path / "1.png").read_bytes()}
    )
    refused = unpack(path, tmp_path / "out/archive", max_bytes=1 << 30)
    assert len(refused) == 1
    assert refused[0][0] in names
    assert (tmp_path / "out/archive/horse/good.png").is_file()
    _, rows = listed(path)
    assert [row.reasons for row in rows if not row.ok] == [("scan:refused",)]


def test_names_of_255_bytes_are_unpacked(tmp_path):
    path = zipped(tmp_path / "pile.zip", {"horse/" + "n" * 251 + ".png": photo(tmp_path / "1.png").read_bytes()})
    _, (row,) = listed(path)
    assert row.ok


def test_videos_become_frames_of_one_group(tmp_path):
    av = pytest.importorskip("av")
    path = tmp_path / "in/fox/run.mp4"
    path.parent.mkdir(parents=True)
    with av.open(str(path), "w") as container:
        stream = container.add_stream("mpeg4", rate=10)
        stream.width, stream.height, stream.pix_fmt = 64, 48, "yuv420p"
        for number in range(20):
            pixels = np.full((48, 64, 3), 10 * number, np.uint8)
            container.mux(stream.encode(av.VideoFrame.from_ndarray(pixels, "rgb24")))
        container.mux(stream.encode(None))
    (tmp_path / "in/fox/broken.mp4").write_bytes(b"no video")
    source, rows = listed(tmp_path / "in", "source.frames_per_second=2.0")
    assert source.kind == "videos"
    bad, *frames = rows
    assert bad.reasons == ("scan:unreadable",)
    assert [row.frame for row in frames] == [0, 5, 10, 15]
    assert {(row.species, row.group) for row in frames} == {("fox", "fox/run.mp4")}
    brightness = [
        np.array(Image.open(tmp_path / "set.work" / row.source.removeprefix("work:"))).mean() for row in frames
    ]
    assert brightness == sorted(brightness)


def test_raw_folders_are_recognised():
    root = os.environ.get("FAUNA_TEST_DATA")
    if root is None or not (Path(root) / "raw").is_dir():
        pytest.skip("needs FAUNA_TEST_DATA")
    counts = {"animalpose": ("animalpose", 100), "davis": ("davis", 22), "stanfordextra": ("stanfordextra", 25)}
    counts |= {"weizmann_horses": ("weizmann", 243), "format_samples": ("several", 13)}
    for name, (kind, number) in counts.items():
        workspace = Workspace(Path(root) / "raw" / name, Path("set"), Path("set.work"))
        source = open_source(prepare_settings([]), workspace)
        rows = [row for rows in source.photos() for row in rows]
        assert (source.kind, len(rows)) == (kind, number)
        assert all(row.ok for row in rows)
