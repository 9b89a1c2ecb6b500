"""Screening: bad photos are named, good ones are read once, changed ones again."""

import os

import pytest

from fauna.data import screening
from fauna.data.screening import screen_photos
from fauna.errors import FaunaError
from tests.data.test_photos import break_photo, write_photo

SETTINGS = {"size": 8, "valid_margin": 0.02, "index": None, "workers": 2}


@pytest.fixture
def photos(tmp_path):
    good = [write_photo(tmp_path / str(i), seed=i)[0] for i in range(3)]
    bad = [break_photo(tmp_path / how, how) for how in ("cut image", "empty mask")]
    return [good[0], bad[0], good[1], bad[1], good[2]]


@pytest.fixture
def reads(monkeypatch):
    """Names of the folders of the photos that were read."""
    found = []

    def counted(photo, **settings):
        found.append(photo.source.image.parent.name)
        return original(photo, **settings)

    original = screening.load_photo
    monkeypatch.setattr(screening, "load_photo", counted)
    return found


@pytest.mark.parametrize("workers", [1, 3])
def test_screening_skips_and_counts_or_raises(photos, workers):
    settings = SETTINGS | {"workers": workers}
    with pytest.warns(UserWarning, match="skipped 2 of 5 photos") as caught:
        found = screen_photos(photos, **settings, on_bad="skip")
    assert len(caught) == 1
    assert found.photos == (photos[0], photos[2], photos[4])
    assert [name for name, _ in found.rejected] == ["a", "a"]
    with pytest.raises(FaunaError, match="readable image"):
        screen_photos(photos, **settings, on_bad="error")
    with pytest.raises(FaunaError, match="at least one usable photo of 2, got none"):
        screen_photos([photos[1], photos[3]], **settings, on_bad="skip")


@pytest.mark.filterwarnings("ignore:skipped")
def test_second_start_reads_only_what_changed(photos, tmp_path, reads):
    settings = SETTINGS | {"index": tmp_path / "index" / "blobs.txt"}
    first = screen_photos(photos, **settings, on_bad="skip")
    refused = sorted(photo.source.image.parent.name for photo in photos if photo not in first.photos)
    assert len(reads) == 5
    reads.clear()
    again = screen_photos(photos, **settings, on_bad="skip")
    assert sorted(reads) == refused  # they may have been mended
    assert again == first
    reads.clear()
    mask = photos[2].source.mask
    os.utime(mask, ns=(1, 1))
    write_photo(tmp_path / "empty mask", seed=7)  # repaired
    mended = screen_photos(photos, **settings, on_bad="skip")
    assert sorted(reads) == sorted({"1", *refused})
    assert mended.photos == (photos[0], photos[2], photos[3], photos[4])
    photos[4].source.mask.unlink()
    with pytest.warns(UserWarning, match="skipped 2 of 5"):
        screen_photos(photos, **settings, on_bad="skip")


@pytest.mark.filterwarnings("ignore:skipped")
def test_other_sizes_and_a_damaged_index_read_again(photos, tmp_path, reads):
    index = tmp_path / "blobs.txt"
    counts = []
    for size in (8, 16, 8):
        screening_of = screen_photos(photos, **SETTINGS | {"index": index, "size": size}, on_bad="skip")
        counts.append(len(reads))
    assert counts == [5, 10, 10 + len(screening_of.rejected)]
    index.write_bytes(b"\xff\xfe\x00broken")
    screen_photos(photos, **SETTINGS | {"index": index}, on_bad="skip")
    assert len(reads) == counts[-1] + 5


def test_interrupted_screening_goes_on_where_it_was(photos, tmp_path, monkeypatch, reads):
    good = [photo for photo in photos if photo.source.image.parent.name in "012"]
    settings = SETTINGS | {"index": tmp_path / "blobs.txt", "workers": 1}
    counted = screening.load_photo

    def stop_at_last(photo, **sizes):
        if photo is good[2]:
            raise KeyboardInterrupt
        return counted(photo, **sizes)

    with monkeypatch.context() as patch:
        patch.setattr(screening, "load_photo", stop_at_last)
        with pytest.raises(KeyboardInterrupt):
            screen_photos(good, **settings, on_bad="skip")
    assert reads == ["0", "1"]
    assert screen_photos(good, **settings, on_bad="skip").photos == tuple(good)
    assert reads == ["0", "1", "2"]
