import hashlib
import json
from dataclasses import replace

import numpy as np
import pytest
import torch

from fauna.data.feature_map import read_feature_map
from fauna.data.photo_loader import PhotoLoader
from fauna.data.sources import FaunaFolder
from fauna.errors import FaunaError
from fauna.prepare.basis import encode_crop, fit_basis, read_basis
from fauna.prepare.check import audit_set, check_set
from fauna.prepare.crop import texts_of
from fauna.prepare.features import FeatureStep
from fauna.prepare.pack import pack_set
from fauna.prepare.settings import prepare_settings
from fauna.prepare.tables import read_table, write_table
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
    listed = []
    for number, row in enumerate(rows):
        points = ((61.5, 42.0, 1.0), (0.0, 0.0, 0.0))
        row = replace(step((row,))[0], split=("train", "val")[number == 5], keypoints=points, cluster=row.photo)
        target = root / row.species / str(row.split)
        target.mkdir(parents=True, exist_ok=True)
        for end in ("rgb.jpg", "mask.png", "box.txt", "feat16.png"):
            (target / f"{row.id}_{end}").write_bytes(workspace.crop(row.id, end).read_bytes())
        text = texts_of(row, settings.crop.size)["keypoints.json"]
        (target / f"{row.id}_keypoints.json").write_bytes(text)
        listed.append(row)
    (root / "keypoint_names.json").write_text('{"keypoint_names": ["left_eye", "tailbase"]}')
    write_table(root / "manifest.parquet", listed)
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


def faults(root):
    return {
        name: found.example
        for name, found in audit_set(root, prepare_settings(WORDS)).findings.items()
        if found.faults and found.fatal
    }


def test_packed_sets_are_audited_as_folders_are(crops, capsys):
    out = packed(crops)
    assert faults(crops) == {}
    assert faults(out) == {}
    assert check_set(out, prepare_settings(WORDS))
    assert "sound" in capsys.readouterr().out
    one, two = (audit_set(root, prepare_settings(WORDS)).findings for root in (crops, out))
    assert two.pop("shards").looked_at > 1
    assert {name: found.looked_at for name, found in one.items()} == {
        name: found.looked_at for name, found in two.items()
    }


def test_damage_in_packed_sets_is_found(crops):
    out = packed(crops)
    shard = out / "00000.tar"
    whole = shard.read_bytes()
    place = whole.index(b"\xff\xd8\xff") + 300  # in a photograph
    shard.write_bytes(whole[:place] + bytes([whole[place] ^ 255]) + whole[place + 1 :])
    assert {"shards", "files"} <= set(faults(out))
    assert "00000.tar: changed since it was packed" in faults(out)["shards"]
    shard.unlink()
    assert "00000.tar: is not there" in faults(out)["shards"]
    shard.write_bytes(whole)
    assert faults(out) == {}
    rows = list(read_table(out / "manifest.parquet"))
    write_table(out / "manifest.parquet", rows[1:])
    assert list(faults(out)) == ["no strays"]
    write_table(out / "manifest.parquet", [*rows, replace(rows[0], id=f"{rows[0].photo}_07", cluster="f" * 16)])
    assert "in no shard" in faults(out)["files"]
    (out / "00000.parquet").write_bytes(b"no table")
    assert "expects the index of 00000.tar" in faults(out)["shards"]


def test_packing_again_mends_what_was_damaged(crops):
    out = packed(crops)
    before = {path.name: (path.read_bytes(), path.stat().st_mtime_ns) for path in out.iterdir()}
    packed(crops)
    again = {path.name: (path.read_bytes(), path.stat().st_mtime_ns) for path in out.iterdir()}
    assert again == before
    for name in ("00000.tar", "00000.parquet", "00001.parquet", "manifest.parquet"):
        content = before[name][0]
        (out / name).write_bytes(content[:500] + bytes([content[500] ^ 255]) + content[501:])
    (out / "00002.parquet").write_bytes(b"")
    packed(crops)
    assert {path.name: path.read_bytes() for path in out.iterdir()} == {name: old[0] for name, old in before.items()}


@pytest.mark.parametrize("content", ['{"version": 1, "shards": [{}]}', '{"version": 1, "shards": 5}'])
def test_a_list_of_shards_that_is_none_is_told(crops, content):
    out = packed(crops)
    (out / "packed.json").write_text(content)
    with pytest.raises(FaunaError, match="packed.json expects the list of shards, got .*; pack the set again"):
        audit_set(out, prepare_settings(WORDS))


def test_only_finished_sets_are_packed(crops, tmp_path):
    def refused(root, told):
        with pytest.raises(FaunaError, match=told) as error:
            pack_set(root, tmp_path / "new", prepare_settings([]))
        assert "\n" not in str(error.value)
        assert not (tmp_path / "new").exists()

    mask = sorted(crops.rglob("*_mask.png"))[0]
    content = mask.read_bytes()
    mask.unlink()
    refused(crops, "expected a finished set, got one in which .*_mask.png is missing; run fauna-prepare all")
    mask.write_bytes(content)
    stray = mask.with_name("mine_rgb.jpg")
    stray.write_bytes(b"")
    refused(crops, "horse/train/mine is not in its manifest")
    stray.unlink()
    refused(packed(crops), "which is packed")
    (crops / "manifest.parquet").unlink()
    refused(crops, "expected a set of fauna-prepare with a manifest.parquet, got none")


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
