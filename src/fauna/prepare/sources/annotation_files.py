"""Annotation files near SOURCE: which format each is in, where its photographs are, and its reader."""

import json
from collections.abc import Iterator, Mapping
from dataclasses import replace
from itertools import islice
from pathlib import Path
from typing import Any

from fauna.data.readers.animal3d import Animal3DPhotos
from fauna.data.readers.coco import CocoPhotos
from fauna.data.readers.collection import KeypointPhotos
from fauna.data.readers.files import find_image, forward_slashes
from fauna.data.readers.stanfordextra import StanfordExtraPhotos
from fauna.errors import FaunaError
from fauna.prepare.settings import Settings
from fauna.prepare.sources.annotated import AnnotatedSource, joined
from fauna.prepare.sources.base import Source
from fauna.prepare.sources.naming import PROVENANCE, Naming
from fauna.prepare.sources.profiles import COCO, PROFILES, Profile, recognise
from fauna.prepare.sources.walking import subfolders

ANNOTATION_KINDS = (*PROFILES, "animal3d", "stanfordextra")
ANIMAL3D_SPECIES = r".*_([A-Za-z-]+)\.[A-Za-z]+"
JSON_DEPTH = 3
TRIED = 50
"""Photographs of an annotation file by which their folder is found."""


def open_annotations(root: Path, kind: str, settings: Settings, naming: Naming) -> Source | None:
    """The source of all annotation files in or near ``root``, or of the file ``root``; ``None`` without one."""
    if kind not in ("auto", *ANNOTATION_KINDS):
        return None
    found = [_annotated(file, content, kind, settings, naming, root) for file, content in _json_files(root)]
    sources = [each for each in found if each is not None]
    return joined(sources) if sources else None


def _annotated(
    file: Path, content: object, kind: str, settings: Settings, naming: Naming, root: Path
) -> AnnotatedSource | None:
    """The source of an annotation file, ``None`` for a JSON file of another kind."""
    form = _form(content)
    if form is None:
        return None
    profile = _profile(content, form, kind)
    reader = _reader(file, content, form, profile, settings.source.min_visibility)
    reader.skips_bad = True
    reader.root = file.parent  # as it was given: rows name files below SOURCE, whatever links lead there
    names = reader.keypoint_names or ()
    if len(set(names)) < len(names):
        raise FaunaError(f"{file} expects keypoints of different names, got {str(list(names))[:80]}; mend the file")
    base = file.parent if root.is_file() else root
    reader.images = _images_folder(file, content, form, base, settings.source.images)
    species = "dog" if form == "stanfordextra" else naming.species
    named = replace(naming, species=species, provenance=PROVENANCE.get(profile.name, naming.provenance))
    return AnnotatedSource(profile.name, reader, reader.images, named, profile.box_margin, reader.keypoint_names)


def _reader(file: Path, content: Any, form: str, profile: Profile, visible: float) -> KeypointPhotos:
    common: dict[str, Any] = {
        "root": str(file.parent), "annotations": file.name, "images": ".", "crop_size": 256, "min_visibility": visible,
    }  # fmt: skip
    if form == "stanfordextra":
        return StanfordExtraPhotos(**common, train_indices=None, val_indices=None, test_indices=None)
    if form == "animal3d":
        return Animal3DPhotos(
            **common, test_annotations=None, species=None, species_pattern=ANIMAL3D_SPECIES, keypoint_names=None
        )
    return CocoPhotos(
        **common, val_annotations=None, test_annotations=None, box_margin=0.0, box_fill=1.0, species=None,
        species_field=profile.species_field, keypoint_set=None if _has_names(content) else profile.keypoint_set,
        photograph_pattern=profile.photograph_pattern,
    )  # fmt: skip


def _profile(content: Any, form: str, kind: str) -> Profile:
    if form in ("stanfordextra", "animal3d"):
        return Profile(form)
    if kind in PROFILES:
        return PROFILES[kind]
    if form == "items":
        names = content.get("keypoint_names")
        return PROFILES["animalpose"] if isinstance(names, list) and len(names) == 20 else COCO
    return recognise(content)


def _has_names(content: Mapping[str, Any]) -> bool:
    listed = content.get("categories")
    return bool(content.get("keypoint_names")) or any(
        isinstance(each, Mapping) and each.get("keypoints") for each in (listed if isinstance(listed, list) else ())
    )


def _form(content: object) -> str | None:
    """Which annotation format a JSON file is in, ``None`` for another."""
    if isinstance(content, Mapping):
        if isinstance(content.get("items"), list):
            return "items"
        if {"images", "annotations"} <= set(content):
            return "coco"
        data = content.get("data")
        first = data[0] if isinstance(data, list) and data else None
        return "animal3d" if isinstance(first, Mapping) and {"img_path", "keypoint_2d"} <= set(first) else None
    first = content[0] if isinstance(content, list) and content else None
    return "stanfordextra" if isinstance(first, Mapping) and {"img_path", "joints", "seg"} <= set(first) else None


def _image_names(content: Any, form: str) -> Iterator[str]:
    if form == "coco":
        images = content["images"]
        listed = images.values() if isinstance(images, Mapping) else images if isinstance(images, list) else ()
        yield from (str(each.get("file_name") if isinstance(each, Mapping) else each) for each in listed)
        return
    items = content["items"] if form == "items" else content["data"] if form == "animal3d" else content
    key = "image" if form == "items" else "img_path"
    yield from (str(each.get(key)) for each in items if isinstance(each, Mapping))


def _images_folder(file: Path, content: object, form: str, base: Path, given: str | None) -> Path:
    """The folder, of those near the annotations, that holds most of the first photographs they name."""
    if given is not None:
        return base / given
    names = [forward_slashes(name) for name in islice(_image_names(content, form), TRIED)]
    candidates: dict[Path, None] = {}
    for folder in (file.parent, *file.parent.parents):  # the nearest first
        candidates.update(dict.fromkeys([folder, *subfolders(folder)]))
        candidates.update(dict.fromkeys(inner for each in subfolders(folder) for inner in subfolders(each)))
        if folder == base:
            break
    return max(candidates, key=lambda folder: sum(find_image(folder, name) is not None for name in names))


def _json_files(root: Path) -> Iterator[tuple[Path, object]]:
    """JSON files near the root with their content; what is no JSON is passed over, unless it was named."""
    if root.is_file():
        files = [root] if root.suffix.lower() == ".json" else []
    else:
        files = [path for depth in range(JSON_DEPTH) for path in sorted(root.glob("*/" * depth + "*.json"))]
    for path in files:
        if path.name.startswith(".") or path.stem.endswith("_keypoints") or path.name == "keypoint_names.json":
            continue
        try:
            yield path, json.loads(path.read_text(encoding="utf-8"))
        except (OSError, ValueError) as error:
            if root.is_file():
                reason = " ".join(str(error).split())[:120]
                raise FaunaError(
                    f"{path} expects a JSON file, got a damaged one ({reason}); download it again"
                ) from error
