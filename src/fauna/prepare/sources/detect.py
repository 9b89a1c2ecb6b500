"""What SOURCE is, told by what lies in it."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

from fauna.errors import FaunaError
from fauna.prepare.record import Record, Rows
from fauna.prepare.settings import Settings
from fauna.prepare.shard import parse_shard
from fauna.prepare.sources.annotation_files import ANNOTATION_KINDS, open_annotations
from fauna.prepare.sources.archives import is_archive, unpack
from fauna.prepare.sources.base import Source
from fauna.prepare.sources.folders import FolderSource, PairedSource, find_pairs, is_awa2, is_sequences
from fauna.prepare.sources.naming import PROVENANCE, Naming, dataset_name
from fauna.prepare.sources.table import TableSource, column
from fauna.prepare.sources.videos import VideoSource, is_video
from fauna.prepare.sources.walking import is_photo, subfolders, walk
from fauna.prepare.workspace import Workspace
from fauna.reconstruct.settings import check_choice

KINDS = ("auto", "folders", "csv", "videos", "pairs", "weizmann", "davis", "awa2", "dove", *ANNOTATION_KINDS)


def open_source(settings: Settings, workspace: Workspace) -> Source:
    """The source of the workspace's SOURCE.

    Args:
        settings: ``source.kind`` says what it is, or ``auto``.
        workspace: folders.

    Raises:
        FaunaError: when nothing fits, or what fits is damaged.
    """
    check_choice("source.kind", settings.source.kind, KINDS)
    root = workspace.source
    naming = Naming(settings.source, workspace, dataset_name(settings.source, workspace))
    if not root.exists():
        raise FaunaError(f"{root}: expected a folder of photographs, an archive, a CSV or JSON file, got nothing there")
    if is_archive(root):
        folder = workspace.unpacked / "archive"
        refused = unpack(root, folder, max_bytes=settings.source.max_archive_bytes)
        return _with_refused(_open(folder, settings, naming), naming, refused)
    return _open(root, settings, naming)


def _open(root: Path, settings: Settings, naming: Naming) -> Source:
    """The first kind that fits ``root``, or the only folder in it, as archives have one."""
    kind = settings.source.kind
    tried = [(each, folder) for folder in _nested(root) for each in (open_annotations, _table, _trees)]
    tried += [(_videos, root), (_folders, root)]
    opened = (source for each, folder in tried if (source := each(folder, kind, settings, naming)) is not None)
    found = next(opened, None)
    if found is None:
        raise FaunaError(
            f"{root}: expected photographs in folders per species, a CSV or COCO file, or videos"
            f"{'' if kind == 'auto' else f' that fit source.kind={kind}'}, got nothing of that; see docs/prepare.md"
        )
    return found


def _table(root: Path, kind: str, settings: Settings, naming: Naming) -> Source | None:
    if kind not in ("auto", "csv"):
        return None
    if root.is_file():
        return TableSource(root, _below(root.parent, settings), naming) if root.suffix.lower() == ".csv" else None
    files = sorted(root.glob("*.csv"))
    named = [file for file in files if _names_images(file)]
    if len(named) > 1 and kind == "csv":
        raise FaunaError(f"{root}: expected one CSV file that names images, got {len(named)}; give the file as SOURCE")
    return TableSource(named[0], _below(root, settings), naming) if len(named) == 1 else None


def _names_images(file: Path) -> bool:
    try:
        with file.open(encoding="utf-8-sig") as handle:
            return {"image", "species"} <= {column(name) for name in handle.readline(10_000).split(",")}
    except (OSError, UnicodeDecodeError):
        return False


def _trees(root: Path, kind: str, settings: Settings, naming: Naming) -> Source | None:
    """Photographs and masks in parallel trees, AwA2's folders, DOVE's videos."""
    if not root.is_dir():
        return None
    pair = find_pairs(root) if kind in ("auto", "pairs", "weizmann", "davis") else None
    if pair is not None and (kind in ("auto", pair[0])):
        known = PROVENANCE.get(pair[0], naming.provenance)
        species = "horse" if pair[0] == "weizmann" else naming.species
        return PairedSource(*pair, replace(naming, species=species, provenance=known), sequences=pair[0] == "davis")
    if kind == "awa2" or (kind == "auto" and is_awa2(root)):
        named = replace(naming, provenance=PROVENANCE["awa2"])
        images = root / "JPEGImages"
        return FolderSource(images if images.is_dir() else root, named, kind="awa2")
    if kind == "dove" or (kind == "auto" and is_sequences(root)):
        return FolderSource(root, replace(naming, provenance=PROVENANCE["dove"]), kind="dove", sequences=True)
    return None


def _videos(root: Path, kind: str, settings: Settings, naming: Naming) -> Source | None:
    if kind not in ("auto", "videos"):
        return None
    found = any(isinstance(path, Path) and is_video(path) for path in ([root] if root.is_file() else walk(root)))
    shard = None if settings.shard is None else parse_shard(settings.shard)
    return VideoSource(root, naming, shard) if found else None


def _folders(root: Path, kind: str, settings: Settings, naming: Naming) -> Source | None:
    if kind not in ("auto", "folders") or not root.is_dir():
        return None
    found = any(isinstance(path, Path) and is_photo(path) for path in walk(root, avoid=naming.results))
    return FolderSource(root, naming) if found else None


def _nested(root: Path) -> Iterator[Path]:
    """The root, and the folder in it as long as there is but one."""
    yield root
    while root.is_dir() and len(folders := subfolders(root)) == 1:
        root = folders[0]
        yield root


def _below(root: Path, settings: Settings) -> Path:
    return root if settings.source.images is None else root / settings.source.images


@dataclass(frozen=True)
class _WithRefused(Source):
    """A source, and what of its archive was refused."""

    kind: str
    keypoint_names: tuple[str, ...] | None
    source: Source
    refused: tuple[Record, ...]

    def photos(self) -> Iterator[Rows]:
        """Those of the source, then the refused names."""
        yield from self.source.photos()
        yield from ((row,) for row in self.refused)


def _with_refused(source: Source, naming: Naming, refused: tuple[tuple[str, str], ...]) -> Source:
    rows = tuple(naming.unusable(f"archive/{name}", reason, "refused") for name, reason in refused)
    return _WithRefused(source.kind, source.keypoint_names, source, rows) if rows else source
