"""COCO-like files: several animals on a photograph, splits, videos, Animal-Pose's two forms, and what is left out and why."""

import json

import numpy as np
import pytest

from fauna.data.fauna_folder import CategoryPhotos
from fauna.errors import FaunaError
from tests.data.readers.fixtures import (
    ANIMALS,
    HEIGHT,
    NAMES,
    WIDTH,
    annotation,
    coco,
    coco_content,
    coco_folder,
    compress,
    ellipse,
    keypoints_of,
    photograph,
    runs,
)


def photos(collection) -> list:
    return [photo for each in collection.categories().values() for photo in each.train + each.val + each.test]


def write(folder, name: str = "coco.json", **changes) -> None:
    (folder / name).write_text(json.dumps(coco_content(**changes)))


def test_animals_of_a_photograph_stay_together_and_order_is_fixed(tmp_path):
    folder = coco_folder(tmp_path / "set")
    found = coco(folder).categories()
    assert list(found) == ["argali_sheep"]
    assert isinstance(found["argali_sheep"], CategoryPhotos)
    train = found["argali_sheep"].train
    assert [photo.name for photo in train] == ["set/coco.json/10", "set/coco.json/11", "set/coco.json/12"]
    assert [photo.photograph for photo in train] == ["set/one.png", "set/one.png", "set/two.png"]
    assert coco(folder).categories() == found
    assert coco(folder).keypoint_names == NAMES
    assert coco(folder).left_out == ()
    content = coco_content()
    write(folder, annotations=content["annotations"][::-1], images=content["images"][::-1])
    assert coco(folder).categories() == found


def test_flags_of_keypoints(tmp_path):
    folder = coco_folder(tmp_path)
    flags = {level: photos(coco(folder, min_visibility=level))[0].source.read().keypoints[:, 2] for level in (1.0, 2.0)}
    assert flags[1].tolist() == [1, 1, 0]
    assert flags[2].tolist() == [1, 0, 0]
    raw = photos(coco(folder, crop_size=64))[1].source.read()
    back = raw.keypoints[:2, :2] * raw.box.width / 64 + [raw.box.x0, raw.box.y0]
    np.testing.assert_allclose(back, np.array(keypoints_of(ANIMALS[1]))[:2, :2] + 0.5)


def test_masks_of_all_kinds_give_the_same_crop(tmp_path):
    counts = runs(ellipse(ANIMALS[0]))
    kinds = [{"size": [HEIGHT, WIDTH], "counts": counts}, {"size": [HEIGHT, WIDTH], "counts": compress(counts)}]
    folder = coco_folder(
        tmp_path, annotations=[annotation(n, 1, ANIMALS[0], segmentation=kind) for n, kind in enumerate(kinds)]
    )
    first, second = (photo.source.read() for photo in photos(coco(folder)))
    assert first.mask_source == "annotation"
    assert np.array_equal(first.mask, second.mask)
    assert np.array_equal(first.image, second.image)
    boxed = [annotation(5, 1, ANIMALS[0])]
    write(folder, annotations=boxed)
    assert photos(coco(folder))[0].source.mask_source == "box"


def test_splits_from_files(tmp_path):
    folder = coco_folder(tmp_path)
    write(folder, "test.json", annotations=[annotation(1, 2, ANIMALS[1])])
    found = coco(folder, test_annotations="test.json").categories()["argali_sheep"]
    assert [len(part) for part in (found.train, found.val, found.test)] == [3, 0, 1]
    only = coco(folder, annotations=None, test_annotations="test.json").categories()["argali_sheep"]
    assert (only.train, only.test) == ((), found.test)


def test_species_by_category_or_by_field(tmp_path):
    listed = [annotation(1, 1, ANIMALS[0], animal="Red Fox"), annotation(2, 1, ANIMALS[1])]
    folder = coco_folder(
        tmp_path, annotations=listed, categories=[*coco_content()["categories"], {"id": 8, "name": "cow"}]
    )
    by_field = coco(folder, species_field="animal")
    assert list(by_field.categories()) == ["red_fox"]
    assert by_field.left_out == (
        ("coco.json/2", "names no species: animal is not in the file; see data.source.species_field"),
    )
    assert list(coco(folder, species=["argali_sheep"]).categories()) == ["argali_sheep"]
    with pytest.raises(FaunaError, match=r"data.source.species: expected names among argali_sheep, got \['wolf'\]"):
        coco(folder, species=["wolf"]).categories()


def test_frames_of_a_video_are_one_photograph(tmp_path):
    names = ["D:\\Animals\\AP\\3cat\\v10c1\\f1.png", "D:\\Animals\\AP\\3cat\\v10c2\\f1.png", "3cat/v11C1/f1.png"]
    for name in ("3cat/v10c1/f1.png", "3cat/v10c2/f1.png", "3cat/v11C1/f1.png"):
        photograph(tmp_path / "photos" / name)
    images = [{"id": n, "file_name": name, "width": WIDTH, "height": HEIGHT} for n, name in enumerate(names)]
    write(tmp_path, images=images, annotations=[annotation(n, n, ANIMALS[0]) for n in range(3)])
    pattern = r"(?:.*/)?([^/]+/v\d+)[cC]\d+/[^/]+"
    dataset = tmp_path.name
    found = photos(coco(tmp_path, photograph_pattern=pattern))
    assert [photo.photograph for photo in found] == [
        f"{dataset}/3cat/v10",
        f"{dataset}/3cat/v10",
        f"{dataset}/3cat/v11",
    ]
    assert len({photo.source.image for photo in found}) == 3
    write(
        tmp_path,
        images=[{**each, "video_id": 4} for each in images],
        annotations=[annotation(n, n, ANIMALS[0]) for n in (0, 2)],
    )
    assert {photo.photograph for photo in photos(coco(tmp_path))} == {f"{dataset}/video-4"}


def test_animal_pose_as_published(tmp_path):
    """A map of file names, corners instead of sizes, keypoints in threes."""
    folder = coco_folder(tmp_path)
    listed = [{"image_id": 1, "category_id": 7, "bbox": list(ANIMALS[1]), "keypoints": keypoints_of(ANIMALS[1])}]
    write(folder, images={"1": "one.png"}, annotations=listed)
    (photo,) = photos(coco(folder))
    assert photo.name.endswith("coco.json/0")
    assert photo.source.box == ANIMALS[1]
    write(folder, annotations=[annotation(0, 1, ANIMALS[1])])
    (plain,) = photos(coco(folder))
    assert plain.source.box == photo.source.box
    assert plain.source.keypoints == photo.source.keypoints


def test_items_with_masks(tmp_path):
    from PIL import Image

    folder = coco_folder(tmp_path)
    Image.fromarray(ellipse(ANIMALS[0])).save(folder / "mask.png")
    item = {"image": "one.png", "mask": "mask.png", "category": "dog", "bbox_xyxy": list(ANIMALS[0])}
    item |= {
        "keypoints": [[x, y, int(v > 0)] for x, y, v in keypoints_of(ANIMALS[0])],
        "width": WIDTH,
        "height": HEIGHT,
    }
    (folder / "items.json").write_text(json.dumps({"keypoint_names": list(NAMES), "items": [item]}))
    collection = coco(folder, annotations="items.json")
    (photo,) = photos(collection)
    assert collection.keypoint_names == NAMES
    assert photo.category == "dog"
    raw = photo.source.read()
    assert raw.mask_source == "annotation"
    assert raw.keypoints[:, 2].tolist() == [1, 1, 0]
    (folder / "items.json").write_text(json.dumps({"keypoint_names": list(NAMES), "items": [{"image": "one.png"}]}))
    with pytest.raises(FaunaError, match=r"items.json item 0 expects the keys image, category, got no category"):
        coco(folder, annotations="items.json").categories()


def test_nothing_is_dropped_silently(tmp_path):
    listed = [
        annotation(0, 1, ANIMALS[0]),
        annotation(1, 9, ANIMALS[0]),
        annotation(2, 1, ANIMALS[0], iscrowd=1),
        annotation(3, 1, ANIMALS[0], category_id=1),
        annotation(4, 1, ANIMALS[0], bbox=[70, 0, 5, 5]),
        annotation(5, 1, ANIMALS[0], keypoints=[0] * 9),
        annotation(6, 3, ANIMALS[0]),
        annotation(7, 1, ANIMALS[0], bbox=[-5, 10, 30, 12]),
    ]
    images = [*coco_content()["images"], {"id": 3, "file_name": "gone.png", "width": WIDTH, "height": HEIGHT}]
    collection = coco(coco_folder(tmp_path, annotations=listed, images=images))
    kept = photos(collection)
    assert [photo.name.split("/")[-1] for photo in kept] == ["0", "7"]
    assert collection.clipped == (kept[1].name,)
    reasons = {name.split("/")[-1]: reason for name, reason in collection.left_out}
    assert len(kept) + len(reasons) == len(listed)
    assert reasons == {
        "1": "names image 9, which the file does not list",
        "2": "is a crowd, not one animal",
        "3": "names no species: category 1 is not in the file; see data.source.species_field",
        "4": "its box (70.0, 0.0, 75.0, 5.0) is empty or outside the 60x40 photograph",
        "5": "has neither a mask nor a box with annotated keypoints",
        "6": "photograph gone.png is missing",
    }


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"images": 3}, "images expects a list, got int; choose the reader of this format"),
        ({"images": [{"id": 1}]}, "images 0 expects the keys id, file_name, got no file_name"),
        ({"annotations": [{"id": 1}]}, "annotation 0 expects the keys image_id, got no image_id"),
        (
            {"annotations": [annotation(1, 1, ANIMALS[0], bbox=[1, 2])]},
            r"coco.json/1 expects a box of four numbers, got \[1, 2\]",
        ),
        (
            {"annotations": [annotation(1, 1, ANIMALS[0], keypoints=[1, 2])]},
            r"coco.json/1 expects keypoints as x, y, flag",
        ),
        (
            {"annotations": [annotation(1, 1, ANIMALS[0], keypoints=[1, 2, 2])]},
            "coco.json/1 expects 3 keypoints, one per name, got 1",
        ),
        (
            {"annotations": [annotation(1, 1, ANIMALS[0])] * 2},
            "expects different annotation names, got .*coco.json/1 twice",
        ),
        ({"annotations": []}, "expects annotated animals, got none; check data.source.annotations"),
        (
            {"categories": [{"id": 7, "name": "cow"}]},
            "expects keypoint names in its categories, got none; choose data.source.keypoint_set",
        ),
        (
            {"categories": [{"id": n, "name": str(n), "keypoints": [f"k{n}"]} for n in (7, 8)]},
            "expects one list of keypoint names, got 2 different ones",
        ),
    ],
)
def test_broken_files_end_in_one_line(tmp_path, changes, message):
    with pytest.raises(FaunaError, match=message) as error:
        coco(coco_folder(tmp_path, **changes)).categories()
    assert "\n" not in str(error.value)


def test_missing_things_end_in_one_line(tmp_path):
    folder = coco_folder(tmp_path)
    with pytest.raises(FaunaError, match=r"gone.json expects an annotation file, got nothing there; check data.root"):
        coco(folder, annotations="gone.json").categories()
    (folder / "broken.json").write_text("{")
    with pytest.raises(FaunaError, match=r"broken.json expects a JSON file, got .*; download it again"):
        coco(folder, annotations="broken.json").categories()
    (folder / "other.json").write_text('{"data": []}')
    with pytest.raises(FaunaError, match=r"got no images, annotations, categories; choose the reader of this format"):
        coco(folder, annotations="other.json").categories()
    with pytest.raises(
        FaunaError, match=r"with photographs in .*elsewhere, got none of 3 .*check data.root and data.source.images"
    ):
        coco(folder, images="elsewhere").categories()
    for key, value in {
        "annotations": None,
        "keypoint_set": "cats",
        "crop_size": 0,
        "box_fill": 0.0,
        "box_margin": -1.0,
        "root": None,
    }.items():
        expected = "data.root" if key == "root" else f"data.source.{key}"
        with pytest.raises(FaunaError, match=f"^{expected}: expected"):
            coco(folder, **{key: value})


def test_a_set_names_the_keypoints_of_a_file_that_does_not(tmp_path):
    folder = coco_folder(
        tmp_path,
        categories=[{"id": 7, "name": "zebra"}],
        annotations=[annotation(1, 1, ANIMALS[0], keypoints=[20, 15, 2] * 9)],
    )
    collection = coco(folder, keypoint_set="zebra")
    assert collection.keypoint_names[:2] == ("nose", "head")
    assert len(photos(collection)) == 1


def test_files_without_keypoints_can_be_trained_on(tmp_path):
    ring = [[10.0, 12.0, 26.0, 12.0, 26.0, 20.0, 10.0, 20.0]]
    bare = {"id": 1, "image_id": 1, "category_id": 7, "segmentation": ring}
    folder = coco_folder(tmp_path, annotations=[bare], categories=[{"id": 7, "name": "cow"}])
    collection = coco(folder)
    assert collection.keypoint_names is None
    raw = photos(collection)[0].source.read()
    assert raw.keypoints is None
    assert raw.mask_source == "annotation"


def test_identity_tells_annotations_apart(tmp_path):
    folder = coco_folder(tmp_path)
    names = {
        coco(folder, **changes).identity
        for changes in ({}, {"annotations": "b.json"}, {"species": ["cow"]}, {"crop_size": 8})
    }
    assert len(names) == 3  # the side of a crop does not matter for splits
