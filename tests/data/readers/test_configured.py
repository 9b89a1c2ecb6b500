"""Every reader from its YAML file to a batch; without masks nothing is trained."""

import json

import pytest
from PIL import Image

from fauna.build import build_encoder
from fauna.configuration import validate
from fauna.data.photos import load_photo
from fauna.data.sources import FaunaFolder
from fauna.errors import FaunaError
from tests.data.readers.fixtures import (
    ANIMALS,
    animal3d_folder,
    annotation,
    coco_folder,
    ellipse,
    pascal_folder,
    photograph,
    runs,
    stanfordextra_folder,
)
from tests.runs import composed

TINY = (
    "encoder=tiny",
    "data.image_size=32",
    "data.source.crop_size=64",
    "data.cache_features=false",
    "data.batch_size=1",
)


def with_masks(folder):
    masked = {"size": list(ellipse(ANIMALS[0]).shape), "counts": runs(ellipse(ANIMALS[0]))}
    return coco_folder(folder, annotations=[annotation(n, n, ANIMALS[0], segmentation=masked) for n in (1, 2)])


CASES = {
    "coco": (with_masks, ("data.source.annotations=coco.json", "data.source.images=photos"), "train"),
    "animal3d": (animal3d_folder, (), "train"),
    "pascal": (pascal_folder, ("data.source.species=[horse,cow]",), "val"),
    "stanfordextra": (stanfordextra_folder, ("data.source.test_indices=test.npy",), "train"),
}


def module(name: str, folder, *overrides: str):
    from hydra.utils import instantiate

    cfg = composed(f"data={name}", f"data.root={folder}", f"data.split_file={folder}/split.json", *TINY, *overrides)
    validate(cfg)
    return instantiate(cfg.data, _convert_="all", _partial_=True)(encoder=build_encoder(cfg))


@pytest.mark.parametrize("name", CASES)
def test_from_yaml_to_a_batch(name, tmp_path):
    make, overrides, split = CASES[name]
    data = module(name, make(tmp_path / "set"), *overrides)
    lines: list[str] = []
    data.prepare(seed=0, report=lines.append)
    photos = data.photos(split)
    assert photos, lines
    assert len(lines) == 1
    batch = data.single(photos[0])
    assert batch.images.shape == (1, 3, 32, 32)
    assert 0.1 < batch.masks.mean() < 0.6
    loaded = load_photo(photos[0], size=32, valid_margin=0.02)
    assert loaded.keypoints is not None
    assert len(loaded.keypoints) == len(data.source.keypoint_names)
    known = loaded.keypoints[:, 2] > 0
    assert (loaded.keypoints[known, :2].abs() < 1).all()
    if split == "train":
        data.check_trainable()


def test_boxes_are_not_trained_on_but_can_be_evaluated(tmp_path):
    folder = coco_folder(tmp_path / "set")
    given = ("data.source.images=photos", "data.source.test_annotations=coco.json", "data.split=test")
    data = module("coco", folder, *given)
    data.prepare(seed=0, report=lambda line: None)
    assert len(data.photos("test")) == 3
    assert {photo.source.mask_source for photo in data.photos("test")} == {"box"}
    with pytest.raises(FaunaError, match="expected at least one species with training photos"):
        data.check_trainable()
    data = module("coco", folder, "data.source.images=photos", "data.source.annotations=coco.json")
    data.prepare(seed=0, report=lambda line: None)
    with pytest.raises(FaunaError, match=r"expected masks to train on, got only boxes for 3 of 3 photos .*fauna-eval"):
        data.check_trainable()


def test_training_refuses_boxes(tmp_path):
    from tests.runs import run

    folder = coco_folder(tmp_path / "set")
    given = ("data.source.images=photos", "data.source.annotations=coco.json")
    with pytest.raises(FaunaError, match="expected masks to train on"):
        run(tmp_path / "run", "+experiment=tiny", "data=coco", f"data.root={folder}", *TINY[1:], *given)


def test_what_is_left_out_is_reported(tmp_path):
    folder = with_masks(tmp_path / "set")
    (folder / "photos" / "two.png").unlink()
    data = module("coco", folder, "data.source.images=photos", "data.source.annotations=coco.json")
    lines: list[str] = []
    data.prepare(seed=0, report=lines.append)
    assert "left out 1 annotations, first set/coco.json/2: photograph two.png is missing" in lines[0]


# --- the fauna layout with keypoints ---------------------------------------------------------------------------------


def fauna_folder(root, names: object, points: list) -> FaunaFolder:
    train = root / "horse" / "train"
    photograph(train / "a_rgb.png")
    with Image.open(train / "a_rgb.png") as picture:
        picture.crop((0, 0, 40, 40)).save(train / "a_rgb.png")
    Image.fromarray(ellipse(ANIMALS[0])[:, :40]).save(train / "a_mask.png")
    (train / "a_keypoints.json").write_text(json.dumps({"keypoints": points}))
    if names is not None:
        (root / "keypoint_names.json").write_text(names if isinstance(names, str) else json.dumps(names))
    return FaunaFolder(root=str(root), photograph_pattern=r"(.+_\d+)_\d+")


@pytest.mark.parametrize("wrap", [lambda names: {"keypoint_names": names, "note": "x"}, lambda names: names])
def test_fauna_folder_names_its_keypoints(tmp_path, wrap):
    collection = fauna_folder(tmp_path, wrap(["L_Eye", "R_Eye"]), [[1, 2, 1], [3, 4, 0]])
    assert collection.keypoint_names == ("left_eye", "right_eye")
    raw = collection.categories()["horse"].train[0].source.read()
    assert raw.keypoints.tolist() == [[1, 2, 1], [3, 4, 0]]


def test_fauna_folder_without_names_takes_any_keypoints(tmp_path):
    collection = fauna_folder(tmp_path, None, [[1, 2, 1]])
    assert collection.keypoint_names is None
    assert len(collection.categories()["horse"].train[0].source.read().keypoints) == 1


def test_fauna_folder_names_and_keypoints_must_agree(tmp_path):
    collection = fauna_folder(tmp_path, ["a", "b"], [[1, 2, 1]])
    with pytest.raises(
        FaunaError, match=r"a_keypoints.json expects 2 keypoints, as keypoint_names.json names them, got 1"
    ):
        collection.categories()["horse"].train[0].source.read()


@pytest.mark.parametrize("names", ["{", {"names": ["a"]}, ["a", "a"], [1]])
def test_broken_names_are_refused_in_one_line(tmp_path, names):
    collection = fauna_folder(tmp_path, names, [[1, 2, 1]])
    with pytest.raises(FaunaError, match=r"keypoint_names.json expects .* mend or remove it$") as error:
        _ = collection.keypoint_names
    assert "\n" not in str(error.value)
