import hashlib
import json

import numpy as np
import pytest
import torch

from fauna.data.feature_map import read_feature_map
from fauna.data.photo_loader import PhotoLoader
from fauna.data.sources import FaunaFolder
from fauna.errors import FaunaError
from fauna.prepare.basis import encode_crop, fit_basis, read_basis
from fauna.prepare.features import FeatureStep
from fauna.prepare.pack import pack_set
from fauna.prepare.settings import prepare_settings
from fauna.prepare.tables import write_table
from tests.prepare.piles import animal, flat, opened, put, through

WORDS = ("mask.segmenter=none", "features.encoder=tiny", "filter.min_sharpness=null")
PATTERN = r"(.+_\d+)_\d+"


@pytest.fixture(scope="module")
def prepared(tmp_path_factory):
    """Rows of six animals of two species, after the filter."""
    folder = tmp_path_factory.mktemp("features")
    for number in range(6):
        put(folder / "in" / ("horse", "zebra")[number % 2], str(number), animal(40 + 5 * number, 30), number)
    rows = sorted(flat(through(folder, *WORDS)), key=lambda row: row.id)
    assert all(row.ok for row in rows)
    return folder, rows


def fitted(folder, rows, *words, parts=1):
    tables = [folder / f"table-{parts}-{number}.parquet" for number in range(parts)]
    for number, table in enumerate(tables):
        write_table(table, rows[number::parts])
    settings, workspace = opened(folder, *WORDS, *words)
    return fit_basis(tables, settings, workspace), settings, workspace


def test_the_basis_does_not_depend_on_shards_and_is_fitted_once(prepared):
    folder, rows = prepared
    path, _, _ = fitted(folder, rows)
    first = path.read_bytes()
    time = path.stat().st_mtime_ns
    fitted(folder, rows)
    assert path.stat().st_mtime_ns == time
    path.unlink()
    fitted(folder, rows, parts=3)
    assert path.read_bytes() == first


def test_the_choice_of_crops_is_seeded_and_reported(prepared):
    folder, rows = prepared
    digests = set()
    for seed in (0, 1, 2):
        path, _, workspace = fitted(folder, rows, "features.fit_photos=2", f"features.seed={seed}")
        digests.add(hashlib.sha256(path.read_bytes()).hexdigest())
    assert len(digests) > 1
    report = json.loads((workspace.report / "features.json").read_text())
    assert report["crops"] == 2
    assert len(report["explained_variance"]) == 16
    assert 0 < report["sum"] <= 1 + 1e-6
    assert (workspace.report / "features.png").is_file()


def test_maps_are_the_quantised_targets_whatever_was_encoded_before(prepared):
    folder, rows = prepared
    path, settings, workspace = fitted(folder, rows)
    step = FeatureStep(settings=settings, workspace=workspace)
    done = {row.id: step((row,))[0] for row in rows}
    other = FeatureStep(settings=settings, workspace=workspace)
    assert {row.id: other((row,))[0] for row in reversed(rows)} == done
    space = read_basis(path, step.encoder, settings.features)
    row = rows[0]
    targets = space.targets(encode_crop(step.encoder, workspace.crop(row.id, "rgb.jpg")))[0]
    stored = read_feature_map(workspace.crop(row.id, "feat16.png"), channels=16, codec="unit")
    assert stored.shape == targets.shape
    assert (stored - targets).abs().max() <= 0.5 / 255 + 1e-6
    content = workspace.crop(row.id, "feat16.png").read_bytes()
    assert done[row.id].feat_sha256 == hashlib.sha256(content).hexdigest()


def test_a_larger_grid_can_be_asked_for_and_a_foreign_basis_is_refused(prepared):
    folder, rows = prepared
    path, settings, workspace = fitted(folder, rows, "features.grid=20")
    step = FeatureStep(settings=settings, workspace=workspace)
    step((rows[0],))
    assert read_feature_map(workspace.crop(rows[0].id, "feat16.png"), channels=16, codec="unit").shape[-1] == 20
    with pytest.raises(FaunaError, match="expects a basis for encoder=tiny, got one of other"):
        read_basis(path, step.encoder, prepare_settings([*WORDS, "features.seed=7"]).features)
    assert step.key != FeatureStep(settings=prepare_settings([*WORDS]), workspace=workspace).key


@pytest.fixture
def crops(prepared, tmp_path):
    """A folder in the layout of data=fauna, with everything a crop may have."""
    folder, rows = prepared
    _, settings, workspace = fitted(folder, rows)
    step = FeatureStep(settings=settings, workspace=workspace)
    root = tmp_path / "set"
    for number, row in enumerate(rows):
        step((row,))
        target = root / row.species / ("train", "val")[number == 5]
        target.mkdir(parents=True, exist_ok=True)
        for end in ("rgb.jpg", "mask.png", "box.txt", "feat16.png"):
            (target / f"{row.id}_{end}").write_bytes(workspace.crop(row.id, end).read_bytes())
        (target / f"{row.id}_keypoints.json").write_text('{"keypoints": [[1, 2, 1], [3, 4, 0]]}')
    (root / "keypoint_names.json").write_text('{"keypoint_names": ["left_eye", "tailbase"]}')
    return root


def source(root):
    return FaunaFolder(root=str(root), photograph_pattern=PATTERN)


def packed(root, size=30_000):
    out = root.with_name("packed")
    pack_set(root, out, prepare_settings([f"pack.shard_bytes={size}"]))
    return out


def test_a_batch_of_a_packed_set_equals_that_of_the_folder_bit_for_bit(crops, monkeypatch, tmp_path):
    from fauna.prepare.encoders import encoder_by_name

    monkeypatch.setenv("FAUNA_CACHE", str(tmp_path / "cache"))
    out = packed(crops)
    assert len(list(out.glob("*.tar"))) > 1
    folder, shards = source(crops), source(out)
    assert shards.keypoint_names == folder.keypoint_names
    loader = PhotoLoader(
        encoder=encoder_by_name("tiny"), image_size=48, valid_margin=0.02, cache_features=True, memory_megabytes=10
    )
    listed, again = folder.categories(), shards.categories()
    assert list(listed) == list(again)
    for species in listed:
        for which in ("train", "val", "test"):
            first, second = getattr(listed[species], which), getattr(again[species], which)
            assert [(p.name, p.photograph) for p in first] == [(p.name, p.photograph) for p in second]
            assert [p.source.content_key() for p in first] == [p.source.content_key() for p in second]
            assert [p.source.annotation_key() for p in first] == [p.source.annotation_key() for p in second]
            if not first:
                continue
            flips = [number % 2 == 1 for number in range(len(first))]
            one, two = loader.batch(first, flips, 0), loader.batch(second, flips, 0)
            assert one.names == two.names
            for name in ("images", "masks", "distance_inside", "distance_outside", "valid", "feature_targets"):
                assert torch.equal(getattr(one, name), getattr(two, name)), name
            assert one.features is not None
            assert two.features is not None
            assert torch.equal(one.features.tokens, two.features.tokens)
            points = [p.source.read().keypoints for p in (first[0], second[0])]
            assert np.array_equal(*points)


def test_packing_again_changes_no_byte_and_smaller_sets_leave_nothing_behind(crops):
    out = packed(crops)
    before = {path.name: path.read_bytes() for path in out.iterdir()}
    times = {path: path.stat().st_mtime_ns for path in out.glob("*.tar")}
    packed(crops)
    assert {path.name: path.read_bytes() for path in out.iterdir()} == before
    assert {path: path.stat().st_mtime_ns for path in out.glob("*.tar")} == times
    for path in out.glob(".*.stamp"):
        path.unlink()
    packed(crops)
    assert {path.name: path.read_bytes() for path in out.iterdir()} == before
    packed(crops, size=10_000_000)
    assert [path.name for path in out.glob("*.tar")] == ["00000.tar"]
    assert sum(len(photos.train) + len(photos.val) for photos in source(out).categories().values()) == 6


def test_members_are_named_so_that_the_files_of_a_crop_are_one_sample(crops):
    import tarfile

    with tarfile.open(packed(crops, size=10_000_000) / "00000.tar") as tar:
        names = tar.getnames()
        assert {info.mtime for info in tar} == {0}
    samples = {name.split(".")[0] for name in names}
    assert len(samples) == 6
    assert len(names) == 30
    assert {name.split(".", 1)[1] for name in names} == {
        "rgb.jpg",
        "mask.png",
        "box.txt",
        "keypoints.json",
        "feat16.png",
    }


def test_cut_shards_and_damaged_indexes_are_told(crops):
    out = packed(crops, size=10_000_000)
    shard = out / "00000.tar"
    whole = shard.read_bytes()
    shard.write_bytes(whole[:-1024])
    with pytest.raises(FaunaError, match=r"00000.tar expects \d+ bytes, got \d+; copy the shard again"):
        source(out).categories()
    shard.write_bytes(whole)
    (out / "00000.parquet").write_bytes(b"no table")
    with pytest.raises(FaunaError, match="expects the index of 00000.tar"):
        source(out).categories()
    (out / "packed.json").write_text("{}")
    with pytest.raises(FaunaError, match="expects the list of shards"):
        source(out).categories()
    with pytest.raises(FaunaError, match="expected a new folder for the shards"):
        pack_set(crops, crops, prepare_settings([]))
