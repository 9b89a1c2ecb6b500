"""Encoder features of photos and of their mirror images, computed once and kept on disk.

One file per photo holds both records as float16, each with a checksum. Files appear by renaming a finished temporary file, so several
processes may share a cache without locks: at worst two of them compute the same file, with the same bytes.

Values do not depend on what else is asked for, on the number of threads, or on whether they were cached: a photo is always encoded as
the pair (image, mirror image) on one thread, and always rounded to float16.
"""

import hashlib
import os
import uuid
import warnings
import zlib
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path

import numpy as np
import platformdirs
import torch
from torch import Tensor

from fauna.data.photos import Photo, PhotoSource, resize_image
from fauna.encoder.base import Encoder
from fauna.errors import FaunaError
from fauna.threads import in_background
from fauna.types import Features

MAGIC = b"FAUNAFT1"
HEADER_BYTES = len(MAGIC) + 2 * 4  # magic, checksum of the record, checksum of the mirrored record
PREPROCESSING = "bilinear-uint8-pair-v1"  # how a crop becomes the encoder's input; part of the key
HALF_MAX = float(np.finfo(np.float16).max)


def default_cache_root() -> Path:
    """``$FAUNA_CACHE`` if set, else the user's cache directory; never the working directory."""
    chosen = os.environ.get("FAUNA_CACHE", "").strip()
    return (
        Path(chosen).expanduser().resolve() if chosen else Path(platformdirs.user_cache_dir("fauna", appauthor=False))
    )


class FeatureCache:
    """Looks features up by the content of a picture, and computes what is missing.

    Args:
        encoder: the frozen encoder; its fingerprint is part of the key.
        root: cache directory; ``None`` for :func:`default_cache_root`.

    Raises:
        FaunaError: if the directory cannot be made.
    """

    def __init__(self, *, encoder: Encoder, root: Path | None):
        self.encoder = encoder
        identity = f"{encoder.fingerprint}|{PREPROCESSING}|float16"
        digest = hashlib.blake2b(identity.encode(), digest_size=6).hexdigest()
        self.folder = (root or default_cache_root()) / "features" / f"{encoder.name}-{encoder.input_size}-{digest}"
        maps = 1 if encoder.keys_are_tokens else 2
        self._map_shape = (encoder.token_dim, encoder.grid_size, encoder.grid_size)
        self._record_values = encoder.global_dim + maps * int(np.prod(self._map_shape))
        self._keys: dict[PhotoSource, str] = {}
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise _unwritable(self.folder, error) from error

    @property
    def bytes_per_photo(self) -> int:
        """Size of one file: two records and the header."""
        return HEADER_BYTES + 4 * self._record_values

    def get_many(self, photos: Sequence[Photo], flips: Sequence[bool]) -> Features:
        """Features of photos or their mirror images; missing ones are computed and stored first.

        Args:
            photos: one or more photos.
            flips: for each photo whether the features of the mirrored picture are wanted.

        Returns:
            float32 features on the CPU, exactly representable in float16.

        Raises:
            FaunaError: if a missing photo cannot be read or the cache not be written.
        """
        records = np.empty((len(photos), self._record_values), dtype=np.float16)
        for row, (photo, flip) in enumerate(zip(photos, flips, strict=True)):
            record = self._read(self._path(photo), flip)
            if record is None:
                self._compute(photo)
                record = self._read(self._path(photo), flip)
            if record is None:
                raise FaunaError(
                    f"feature cache {self.folder} expects files to last, got one removed while in use; do not clear it now"
                )
            records[row] = record
        return self._unpack(torch.from_numpy(records).float())

    def missing(self, photos: Sequence[Photo]) -> list[Photo]:
        """The photos without a file of the right size (its checksum is verified when it is read)."""
        return [photo for photo in photos if not self._complete(self._path(photo))]

    def fill(self, photos: Sequence[Photo], *, workers: int) -> Iterator[Photo]:
        """Compute what is missing, yielding each photo once its file exists (for a progress bar); run it to the end.

        Args:
            photos: photos to have in the cache.
            workers: threads that encode side by side; the values do not depend on it.
        """
        todo = self.missing(photos)
        ahead = 4 * workers if workers > 1 else 0
        for photo, _ in zip(todo, in_background(self._compute, todo, workers=workers, ahead=ahead), strict=True):
            yield photo

    def _path(self, photo: Photo) -> Path:
        key = self._keys.get(photo.source)
        if key is None:
            key = self._keys[photo.source] = photo.source.content_key()
        return self.folder / key[:2] / f"{key}.feat"

    def _complete(self, path: Path) -> bool:
        try:
            return path.stat().st_size == self.bytes_per_photo
        except OSError:
            return False

    def _read(self, path: Path, flip: bool) -> np.ndarray | None:
        """One record, or ``None`` if there is no intact one."""
        try:
            content = np.memmap(path, dtype=np.uint8, mode="r")
        except (OSError, ValueError):
            return None
        if content.size == self.bytes_per_photo and content[: len(MAGIC)].tobytes() == MAGIC:
            checksum = int(content[len(MAGIC) : HEADER_BYTES].view("<u4")[int(flip)])
            start = HEADER_BYTES + int(flip) * 2 * self._record_values
            record = content[start : start + 2 * self._record_values]
            if zlib.crc32(record.data) == checksum:
                return record.view("<f2")
        warnings.warn(f"feature cache file {path.name} is damaged and is computed anew", UserWarning, stacklevel=3)
        return None

    def _compute(self, photo: Photo) -> None:
        """Encode a photo and its mirror image and store both records."""
        image = resize_image(photo.source.read().image, self.encoder.input_size)
        with one_thread():
            features = self.encoder.encode_together(torch.stack([image, image.flip(-1)]))
        parts = [features.global_, features.tokens.flatten(1)]
        if not self.encoder.keys_are_tokens:
            parts.append(features.keys.flatten(1))
        packed = torch.cat(parts, dim=1).clamp(-HALF_MAX, HALF_MAX).half().cpu().numpy().astype("<f2")
        if not np.isfinite(packed).all():
            raise FaunaError(
                f"photo {photo.name} expects finite features, got nan from encoder={self.encoder.name}; leave the photo out"
            )
        records = [record.tobytes() for record in packed]
        checksums = np.array([zlib.crc32(record) for record in records], dtype="<u4").tobytes()
        write_atomically(self._path(photo), b"".join([MAGIC, checksums, *records]))

    def _unpack(self, records: Tensor) -> Features:
        values = int(np.prod(self._map_shape))
        start = self.encoder.global_dim
        tokens = records[:, start : start + values].reshape(-1, *self._map_shape)
        keys = tokens if self.encoder.keys_are_tokens else records[:, start + values :].reshape(-1, *self._map_shape)
        return Features(records[:, :start], tokens, keys)


def write_atomically(path: Path, content: bytes) -> None:
    """Write a file that is either complete or absent, also after a crash and beside other writers.

    Raises:
        FaunaError: if it cannot be written.
    """
    temporary = path.with_name(f".{path.stem}-{os.getpid()}-{uuid.uuid4().hex}.part")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with temporary.open("wb") as file:
            file.write(content)
            file.flush()
            os.fsync(file.fileno())
        temporary.replace(path)
    except OSError as error:
        raise _unwritable(path, error) from error
    finally:
        with suppress(OSError):  # gone after the renaming
            temporary.unlink()


@contextmanager
def one_thread() -> Iterator[None]:
    """Run torch on one thread: its convolutions round differently with another number of threads.

    The number belongs to the calling thread; others keep theirs.
    """
    before = torch.get_num_threads()
    if before == 1:
        yield
        return
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(before)


def _unwritable(path: Path, error: OSError) -> FaunaError:
    return FaunaError(
        f"{path} expects a writable place with free space, got {error.strerror}; set FAUNA_CACHE to another directory"
    )
