"""Both folder layouts, splits by photograph, and the remembered split file."""

import json
from pathlib import Path

import pytest

from fauna.data.fauna_folder import CategoryPhotos, read_fauna_folder
from fauna.data.photos import FileSource, Photo
from fauna.data.splits import SplitSize, complete_splits
from fauna.errors import FaunaError

PATTERN = r"(.+_\d+)_\d+"


def touch(root: Path, *names: str) -> None:
    for name in names:
        path = root / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.touch()


def read(root: Path) -> dict[str, CategoryPhotos]:
    return read_fauna_folder(root, photograph_pattern=PATTERN)


def names(photos: tuple[Photo, ...]) -> list[str]:
    return [photo.name for photo in photos]


# --- layouts ---------------------------------------------------------------------------------------------------------


def test_flat_layout(tmp_path):
    root = tmp_path / "set"
    touch(
        root,
        "horse/train/2007_000001_3_rgb.jpg",
        "horse/train/2007_000001_3_mask.png",
        "horse/train/2007_000001_3_box.txt",
    )
    touch(root, "horse/train/2007_000001_4_rgb.png", "horse/train/2007_000001_4_feat16.png", "horse/train/b_rgb.jpg")
    touch(
        root,
        "horse/val/c_rgb.jpg",
        "cow/train/2007_000001_9_rgb.jpg",
        "cow/train/rgb.png",
        "keypoint_names.json",
        "empty/train/x.txt",
    )
    found = read(root)
    assert list(found) == ["cow", "horse"]
    horse = found["horse"]
    assert names(horse.train) == ["set/horse/train/2007_000001_3", "set/horse/train/2007_000001_4", "set/horse/train/b"]
    assert names(horse.val) == ["set/horse/val/c"]
    assert horse.test == ()
    first, second, third = horse.train
    assert first.photograph == second.photograph == found["cow"].train[0].photograph == "2007_000001"
    assert third.photograph == "set/horse/b"
    assert first.category == "horse"
    assert first.source == FileSource(
        image=root / "horse/train/2007_000001_3_rgb.jpg",
        mask=root / "horse/train/2007_000001_3_mask.png",
        box=root / "horse/train/2007_000001_3_box.txt",
    )
    assert first.feature_map is None
    assert second.feature_map == root / "horse/train/2007_000001_4_feat16.png"
    assert found["cow"].train[1].source.mask.name == "mask.png"


def test_published_layout(tmp_path):
    touch(
        tmp_path, *(f"large_scale/horse_comb_dinov2_new/train/video_{v}/000{f}_rgb.png" for v in (1, 2) for f in (0, 1))
    )
    touch(
        tmp_path,
        "large_scale/horse_comb_dinov2_new/val/video_3/0000_rgb.png",
        "large_scale/horse_comb_dinov2_new/test/video_4/0_rgb.png",
    )
    touch(
        tmp_path,
        "few_shot_web/lynx/train/001_rgb.png",
        "few_shot_web/horse/train/001_rgb.png",
        "few_shot_animal3d/lynx/train/7_rgb.png",
    )
    touch(tmp_path, "few_shot_web_back/lynx/train/9_rgb.png", "few_shot_animal3d/puma/train/001_rgb.png")
    found = read(tmp_path)
    assert list(found) == ["horse", "horse_few_shot", "lynx", "puma"]
    horse = found["horse"]
    assert [len(split) for split in (horse.train, horse.val, horse.test)] == [4, 1, 1]
    assert len({photo.photograph for photo in horse.train}) == 2
    assert len(found["lynx"].train) == 2
    assert [photo.name.split("/")[-1] for photo in found["lynx"].back_views] == ["9"]
    assert found["lynx"].back_views[0].category == "lynx"
    every = [
        photo.name for photos in found.values() for split in (photos.train, photos.val, photos.test) for photo in split
    ]
    assert len(every) == len(set(every))


def test_missing_or_empty_root_points_to_the_zoo(tmp_path):
    with pytest.raises(FaunaError, match=r"expects a folder of crops at .*nowhere, got nothing there; .*data=zoo"):
        read(tmp_path / "nowhere")
    touch(tmp_path, "horse/train/photo.jpg")
    with pytest.raises(FaunaError, match=r"<name>_rgb.jpg .*got no such file; .*data=zoo"):
        read(tmp_path)


# --- splits ----------------------------------------------------------------------------------------------------------


def category(name: str, photographs: int, crops: int = 1, shared: int = 0) -> CategoryPhotos:
    photos = tuple(
        Photo(
            f"{name}/{p}_{c}",
            name,
            f"shared/{p}" if p < shared else f"{name}/{p}",
            FileSource(Path(f"{name}{p}{c}"), Path("m")),
        )
        for p in range(photographs)
        for c in range(crops)
    )
    return CategoryPhotos(name, photos)


def split(categories, path=None, *, seed=0, val=(0.2, 100), test=(0.1, 100), held_out=()):
    by_name = {photos.category: photos for photos in categories}
    return complete_splits(
        by_name, path=path, seed=seed, val=SplitSize(*val), test=SplitSize(*test), held_out=list(held_out)
    )


def parts(photos: CategoryPhotos) -> list[set[str]]:
    return [{photo.photograph for photo in part} for part in (photos.train, photos.val, photos.test)]


def test_sizes_and_no_photo_lost():
    before = category("dog", 50)
    after = split([before])["dog"]
    assert [len(part) for part in (after.train, after.val, after.test)] == [35, 10, 5]
    assert sorted(names(after.train + after.val + after.test)) == sorted(names(before.train))
    few = split([before], val=(0.2, 5), test=(0.0, 0))["dog"]
    assert [len(part) for part in (few.train, few.val, few.test)] == [45, 5, 0]


def test_crops_of_a_photograph_stay_together_across_categories():
    after = split([category("cat", 30, crops=3, shared=15), category("dog", 30, crops=2, shared=15)])
    train, val, test = (set.union(*groups) for groups in zip(*map(parts, after.values()), strict=True))
    assert not train & val
    assert not train & test
    assert not val & test
    assert len(after["cat"].val) >= 18
    assert len(after["dog"].val) >= 12


def test_seed_decides_and_order_does_not():
    categories = [category("cat", 30), category("dog", 30)]
    assert split(categories) == split(categories[::-1])
    assert split(categories) != split(categories, seed=1)


def test_own_validation_photos_are_kept():
    whole = category("dog", 20)
    given = CategoryPhotos("dog", whole.train[:15], val=whole.train[15:])
    after = split([given], test=(0.0, 0))["dog"]
    assert after == given


def test_tiny_categories_keep_a_training_photo():
    for count in (1, 2, 3):
        assert len(split([category("dog", count)], val=(0.9, 9), test=(0.9, 9))["dog"].train) >= 1


def test_held_out_species_are_only_tested():
    after = split([category("cat", 10), category("dog", 10)], held_out=["cat"])
    assert after["cat"].train == after["cat"].val == ()
    assert len(after["cat"].test) == 10
    assert len(after["dog"].train) == 7
    with pytest.raises(FaunaError, match=r"held-out species expects names among \['dog'\], got \['lynx'\]"):
        split([category("dog", 10)], held_out=["lynx"])


def test_file_is_reused_and_grows_without_moving_known_photos(tmp_path):
    path = tmp_path / "split.json"
    first = split([category("dog", 20)], path)
    stored = path.read_bytes()
    assert split([category("dog", 20)], path) == first
    assert path.read_bytes() == stored

    more = split([category("dog", 40)], path)["dog"]
    assert parts(more)[1:] == parts(first["dog"])[1:]
    assert len(more.train) == len(first["dog"].train) + 20

    wider = split([category("cat", 20), category("dog", 20)], path)
    assert wider["dog"] == first["dog"]
    assert len(wider["cat"].val) == 4
    assert set(json.loads(path.read_text())["val"]) == {"cat", "dog"}
    assert [file.name for file in tmp_path.iterdir()] == ["split.json"]


def test_new_category_does_not_take_known_training_photographs(tmp_path):
    path = tmp_path / "split.json"
    first = split([category("dog", 20, shared=20)], path)
    wider = split([category("cat", 20, shared=20), category("dog", 20, shared=20)], path)
    assert wider["dog"] == first["dog"]
    assert parts(wider["cat"]) == parts(first["dog"])


@pytest.mark.parametrize(
    "text",
    [
        "",
        "{}",
        '{"format": 9, "settings": {}, "val": {}, "test": {}}',
        '{"format": 1, "settings": {}, "val": [], "test": {}}',
    ],
)
def test_broken_split_file(tmp_path, text):
    path = tmp_path / "split.json"
    path.write_text(text)
    with pytest.raises(FaunaError, match=r"split.json expects a split file of format 1, got .*delete it"):
        split([category("dog", 20)], path)


def test_other_settings_are_refused(tmp_path):
    path = tmp_path / "split.json"
    split([category("dog", 20)], path)
    with pytest.raises(FaunaError, match="expects the settings it was made with"):
        split([category("dog", 20)], path, seed=3)
