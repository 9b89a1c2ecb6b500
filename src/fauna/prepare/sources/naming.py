"""How files and animals of a source are named in rows."""

import contextlib
import hashlib
import os
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from fauna.data.readers.collection import species_name
from fauna.errors import FaunaError
from fauna.prepare.record import Record, photo_id, row_id
from fauna.prepare.settings import SourceSettings
from fauna.prepare.workspace import Workspace, text_of_path

UNKNOWN = "unknown"
FARTHEST = 1e7
"""Pixels from the corner of a photograph: what is annotated beyond is no place in it."""
LONGEST_NAME, LONGEST_SHOWN = 200, 40
"""Bytes of a species' name, which is that of a folder; letters of one that is longer."""
PROVENANCE = {
    "weizmann": "Weizmann Horse Database",
    "davis": "DAVIS: Densely Annotated Video Segmentation",
    "animalpose": "Animal-Pose",
    "stanfordextra": "StanfordExtra annotations on Stanford Dogs (ImageNet)",
    "animal3d": "Animal3D",
    "apt36k": "APT-36K",
    "ap10k": "AP-10K",
    "awa2": "Animals with Attributes 2",
    "dove": "DOVE",
}
"""Where the photographs of known sets come from."""


@dataclass(frozen=True)
class Naming:
    """Turns paths and annotations into rows.

    Attributes:
        settings: what is said about sources that say nothing themselves.
        workspace: folders.
        dataset: name of the set.
        species: of sources that name none, unless the settings do.
        provenance: likewise.
    """

    settings: SourceSettings
    workspace: Workspace
    dataset: str
    species: str = "animal"
    provenance: str | None = None

    @property
    def results(self) -> frozenset[Path]:
        """Folders that are written, which no source lists."""
        return frozenset({self.workspace.dest, self.workspace.work})

    def text(self, path: Path) -> str:
        """A path below SOURCE, or below WORK with ``work:`` in front: the same text by whichever links and dots it is reached.

        Raises:
            FaunaError: when it leads elsewhere.
        """
        for folder, front in ((self.workspace.work, "work:"), (self.workspace.root, "")):
            if path.is_relative_to(folder) and ".." not in path.parts:
                return front + text_of_path(path.relative_to(folder))
        with contextlib.suppress(OSError, ValueError):  # a null byte, a link to itself
            found, root = path.resolve(), self.workspace.root.resolve()
            if found.is_relative_to(root):
                return text_of_path(found.relative_to(root))
        raise FaunaError(
            f"{path}: expected a file below SOURCE ({self.workspace.root}), got one elsewhere; move it there"
        )

    def named(self, species: str | None) -> str:
        """Folder name of a species, renamed as the settings say."""
        plain = species_name(species or self.settings.species or self.species)
        return dict(_pairs(self.settings.rename)).get(plain, plain)

    def row(
        self,
        path: Path,
        species: str | None,
        *,
        instance: int = 0,
        group: str | None = None,
        licence: str | None = None,
        provenance: str | None = None,
        **facts: Any,
    ) -> Record:
        """An animal of a photograph.

        Args:
            path: of the photograph.
            species: as the source names it, ``None`` where it does not.
            instance: of the photograph's animals.
            group: photograph or video it belongs to, ``None`` for the file itself.
            licence: as the source states it.
            provenance: likewise.
            facts: further fields.
        """
        source = self.text(path)
        photo = photo_id(self.dataset, source, facts.get("frame"))
        name = self.named(species)
        row = Record(
            id=row_id(photo, instance), photo=photo, instance=instance, dataset=self.dataset, source=source,
            species=_shortened(name), group=group or source,
            licence=_utf8(licence) or self.settings.licence or UNKNOWN,
            provenance=_utf8(provenance) or self.settings.provenance or self.provenance, **facts,
        )  # fmt: skip
        if row.species == name:
            return row
        told = f"{row.origin or source}: its species has a name of {len(name):,} letters"
        return replace(row, origin=told).rejected("scan", "annotation")

    def unusable(self, name: str, reason: str, word: str, species: str | None = None) -> Record:
        """A row for what cannot be used before any file is opened: an annotation, a missing file, a folder.

        Args:
            name: of the entry or file, unique.
            reason: in words, for :attr:`~fauna.prepare.record.Record.origin`.
            word: of :data:`fauna.prepare.reasons.REASONS`.
            species: where known.
        """
        source = text_of_path(Path(name))
        photo = hashlib.blake2b(f"{self.dataset}\0{source}\0unusable".encode(), digest_size=8).hexdigest()
        row = Record(
            id=row_id(photo, 0), photo=photo, instance=0, dataset=self.dataset, source=source,
            species=_shortened(self.named(species)), group=source, origin=_utf8(f"{source}: {reason}"),
        )  # fmt: skip
        return row.rejected("scan", word)

    def unlisted(self, error: OSError, root: Path) -> Record:
        """A row for a folder or link that cannot be looked into.

        Args:
            error: as :func:`fauna.prepare.sources.walking.walk` gives it.
            root: that was walked.
        """
        name = os.path.relpath(str(error.filename or root), root)
        return self.unusable(name, error.strerror or type(error).__name__, "unreadable")


def _utf8(text: str | None) -> str | None:
    """Text without what no table can hold: halves of characters, which JSON may spell."""
    return None if text is None else text.encode("utf-8", "replace").decode()


def _shortened(name: str) -> str:
    """The name of a species, cut off where a folder could not have it."""
    return name if len(name.encode("utf-8", "surrogateescape")) <= LONGEST_NAME else name[:LONGEST_SHOWN]


def dataset_name(settings: SourceSettings, workspace: Workspace) -> str:
    """Of the settings, else of the folder or file."""
    path = workspace.source
    return species_name(settings.name or (path.stem.split(".")[0] if path.is_file() else path.resolve().name))


def _pairs(rename: tuple[str, ...]) -> list[tuple[str, str]]:
    pairs = [tuple(str(text).split(":")) for text in rename]
    if any(len(pair) != 2 or not all(pair) for pair in pairs):
        raise FaunaError(f"source.rename: expected old:new each, got {list(rename)}; e.g. [libby:cat]")
    return [(species_name(old), species_name(new)) for old, new in pairs]
