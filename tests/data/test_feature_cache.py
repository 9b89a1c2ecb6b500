"""The feature cache: same values cached or not, true mirror images, damage, several processes, speed."""

import multiprocessing
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
import torch

from fauna.data.feature_cache import FeatureCache, default_cache_root, write_atomically
from fauna.data.photos import Photo, PhotoSource, RawPhoto, resize_image
from fauna.encoder.tiny import TinyEncoder
from fauna.errors import FaunaError


@dataclass(frozen=True)
class NoiseSource(PhotoSource):
    seed: int

    def read(self) -> RawPhoto:
        image = np.random.default_rng(self.seed).integers(0, 256, (24, 24, 3), dtype=np.uint8)
        return RawPhoto(image, np.ones((24, 24), dtype=bool), None, None)

    def content_key(self) -> str:
        return f"{self.seed:032x}"


def photo(seed: int) -> Photo:
    return Photo(f"noise/{seed}", "noise", str(seed), NoiseSource(seed))


PHOTOS = [photo(seed) for seed in range(6)]


class CountingEncoder(TinyEncoder):
    def __init__(self, seed: int = 0, keys_are_tokens: bool = True):
        super().__init__(input_size=32, stride=8, token_dim=5, seed=seed)
        self.keys_are_tokens = keys_are_tokens
        self.calls = 0

    def _encode(self, images):
        self.calls += 1
        features = super()._encode(images)
        if self.keys_are_tokens:
            return features
        return type(features)(features.global_, features.tokens, features.tokens * 2)


def cache(root: Path, encoder: TinyEncoder | None = None) -> FeatureCache:
    return FeatureCache(encoder=encoder or CountingEncoder(), root=root)


def test_values_are_the_encoders_rounded_to_half(tmp_path):
    encoder = CountingEncoder()
    image = resize_image(PHOTOS[0].source.read().image, 32)
    features = cache(tmp_path, encoder).get_many([PHOTOS[0], PHOTOS[0]], [False, True])
    direct = encoder.encode_together(torch.stack([image, image.flip(-1)]))
    assert torch.equal(features.tokens, direct.tokens.half().float())
    assert torch.equal(features.global_, direct.global_.half().float())
    assert features.keys is features.tokens
    assert not torch.equal(features.tokens[1], features.tokens[0].flip(-1))  # the true mirror image, not a mirrored map


def test_separate_keys_are_stored(tmp_path):
    features = cache(tmp_path, CountingEncoder(keys_are_tokens=False)).get_many(PHOTOS[:2], [False, True])
    assert torch.equal(features.keys, features.tokens * 2)
    assert features.keys.abs().sum() > 0


def test_caching_and_company_do_not_change_values(tmp_path):
    flips = [index % 2 == 1 for index in range(6)]
    first = cache(tmp_path / "a")
    fresh, again = first.get_many(PHOTOS, flips), first.get_many(PHOTOS, flips)
    alone = cache(tmp_path / "b")
    for row in reversed(range(6)):
        single = alone.get_many([PHOTOS[row]], [flips[row]])
        for name in ("global_", "tokens", "keys"):
            assert torch.equal(getattr(fresh, name)[row], getattr(again, name)[row])
            assert torch.equal(getattr(fresh, name)[row], getattr(single, name)[0])


def test_each_picture_is_encoded_once(tmp_path):
    encoder = CountingEncoder()
    cache(tmp_path, encoder).get_many([*PHOTOS, *PHOTOS], [False] * 6 + [True] * 6)
    assert encoder.calls == 6
    twin = Photo("another name", "noise", "x", NoiseSource(3))
    cache(tmp_path, encoder).get_many([twin], [True])
    assert encoder.calls == 6


def test_encoders_do_not_share_entries(tmp_path):
    a = cache(tmp_path, CountingEncoder(seed=0)).get_many(PHOTOS[:1], [False])
    b = cache(tmp_path, CountingEncoder(seed=1)).get_many(PHOTOS[:1], [False])
    assert not torch.equal(a.tokens, b.tokens)


@pytest.mark.parametrize("workers", [1, 3])
def test_fill_computes_what_is_missing_whatever_the_workers(tmp_path, workers):
    encoder = CountingEncoder()
    store = cache(tmp_path, encoder)
    store.get_many(PHOTOS[:2], [False, False])
    threads = torch.get_num_threads()
    assert list(store.fill(PHOTOS, workers=workers)) == PHOTOS[2:]
    assert torch.get_num_threads() == threads
    assert encoder.calls == 6
    assert store.missing(PHOTOS) == []
    other = cache(tmp_path / "other").get_many(PHOTOS, [True] * 6)
    assert torch.equal(store.get_many(PHOTOS, [True] * 6).tokens, other.tokens)


@pytest.mark.parametrize("damage", ["cut", "empty", "flipped bit", "other file"])
def test_damaged_files_are_found_and_replaced(tmp_path, damage):
    store = cache(tmp_path)
    expected = store.get_many(PHOTOS[:1], [True])
    (path,) = tmp_path.rglob("*.feat")
    content = bytearray(path.read_bytes())
    if damage == "flipped bit":
        content[-3] ^= 4
    replaced = {"cut": content[:-10], "empty": b"", "flipped bit": content, "other file": bytes(len(content))}[damage]
    path.write_bytes(bytes(replaced))
    if damage == "empty":
        found = store.get_many(PHOTOS[:1], [True])
    else:
        with pytest.warns(UserWarning, match="is damaged and is computed anew"):
            found = store.get_many(PHOTOS[:1], [True])
    assert torch.equal(found.tokens, expected.tokens)
    assert torch.equal(cache(tmp_path).get_many(PHOTOS[:1], [True]).tokens, expected.tokens)


def test_interrupted_writer_leaves_nothing_visible(tmp_path, monkeypatch):
    store = cache(tmp_path)

    def crash(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr(Path, "replace", crash)
    with pytest.raises(KeyboardInterrupt):
        store.get_many(PHOTOS[:1], [False])
    assert not [path for path in tmp_path.rglob("*") if path.is_file()]
    monkeypatch.undo()
    assert store.missing(PHOTOS[:1]) == PHOTOS[:1]
    store.get_many(PHOTOS[:1], [False])


def _worker(root: str, queue) -> None:
    torch.set_num_threads(1)
    features = cache(Path(root)).get_many(PHOTOS, [False] * 6)
    queue.put(features.tokens.numpy())


def test_processes_share_a_cache(tmp_path):
    context = multiprocessing.get_context("spawn")
    queue = context.Queue()
    workers = [context.Process(target=_worker, args=(str(tmp_path), queue)) for _ in range(2)]
    for worker in workers:
        worker.start()
    results = [queue.get(timeout=60) for _ in workers]
    for worker in workers:
        worker.join(timeout=60)
        assert worker.exitcode == 0
    np.testing.assert_array_equal(results[0], results[1])
    encoder = CountingEncoder()
    assert np.array_equal(cache(tmp_path, encoder).get_many(PHOTOS, [False] * 6).tokens.numpy(), results[0])
    assert encoder.calls == 0


def test_looking_up_a_dozen_photos_is_quick(tmp_path):
    encoder = TinyEncoder(
        input_size=128, stride=8, token_dim=192, seed=0
    )  # 16 x 16 x 192, as large as EfficientNet-Lite0's
    store, photos = cache(tmp_path, encoder), [photo(seed) for seed in range(12)]
    store.get_many(photos, [False] * 12)
    times = []
    for _ in range(7):
        start = time.perf_counter()
        store.get_many(photos, [True] * 12)
        times.append(time.perf_counter() - start)
    assert min(times) < 0.02  # about 2 ms; generous for a busy machine


def test_root_comes_from_the_environment(monkeypatch, tmp_path):
    monkeypatch.setenv("FAUNA_CACHE", str(tmp_path / "here"))
    assert default_cache_root() == tmp_path / "here"
    monkeypatch.delenv("FAUNA_CACHE")
    assert default_cache_root().is_absolute()
    assert "fauna" in default_cache_root().parts
    assert Path.cwd() not in (default_cache_root(), *default_cache_root().parents)


def test_unwritable_root_names_the_variable(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(FaunaError, match="set FAUNA_CACHE to another directory"):
        cache(tmp_path / "file")
    with pytest.raises(FaunaError, match="writable place"):
        write_atomically(tmp_path / "file" / "x.json", b"")


def test_non_finite_features_are_refused(tmp_path):
    class Broken(CountingEncoder):
        def _encode(self, images):
            features = super()._encode(images)
            features.tokens[0, 0, 0, 0] = torch.nan
            return features

    with pytest.raises(FaunaError, match="photo noise/0 expects finite features, got nan from encoder=tiny"):
        cache(tmp_path, Broken()).get_many(PHOTOS[:1], [False])
    assert not list(tmp_path.rglob("*.feat"))
