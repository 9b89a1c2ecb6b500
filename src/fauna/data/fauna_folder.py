"""The ``data=fauna`` reader: crops stored as files, in a flat layout or in that of the published Fauna dataset.

Flat: ``root/<category>/{train,val,test,back}/<stem>_rgb.jpg`` (``back``: back views, for training) with ``_mask.png`` and, optionally, ``_box.txt``, ``_keypoints.json`` and
``_feat16.png``. Published: ``root/{large_scale,few_shot_web,few_shot_animal3d,few_shot_web_back}/<category>/...`` with the same files;
``large_scale`` has one folder per video below each split. ``root/keypoint_names.json`` names the keypoints, where there are any.
"""

import json
import re
import warnings
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

from fauna.data.photos import FileSource, Photo
from fauna.errors import FaunaError

SPLITS = ("train", "val", "test")
IMAGE_NAME = re.compile(r"^(?:(?P<stem>.*)_)?rgb\.(?:png|jpg|jpeg)$", re.IGNORECASE)
LARGE_SCALE = "large_scale"
FEW_SHOT = ("few_shot_web", "few_shot_animal3d")
BACK_VIEWS = "few_shot_web_back"
BACK = "back"
KEYPOINT_NAMES = "keypoint_names.json"


@dataclass(frozen=True)
class CategoryPhotos:
    """The photos of one species.

    Attributes:
        category: name of the species.
        train: sorted by path.
        val: empty when the folder has none; see :mod:`fauna.data.splits`.
        test: likewise.
        back_views: further training photos seen from behind, sampled more often.
    """

    category: str
    train: tuple[Photo, ...]
    val: tuple[Photo, ...] = ()
    test: tuple[Photo, ...] = ()
    back_views: tuple[Photo, ...] = ()


def read_fauna_folder(
    root: Path, *, photograph_pattern: str, num_keypoints: int | None = None
) -> dict[str, CategoryPhotos]:
    r"""List all photos below ``root`` without opening any.

    Args:
        root: dataset folder, either layout.
        photograph_pattern: regular expression with one group; a stem that matches it entirely is a crop of the photograph
            named by the group, any other stem is a photograph of its own. ``(.+_\d+)_\d+`` makes ``2007_001724_47`` a crop
            of ``2007_001724``.
        num_keypoints: that every ``_keypoints.json`` must list; ``None`` = any number.

    Returns:
        Categories in alphabetical order.

    Raises:
        FaunaError: if the folder is missing or holds no photo.
    """
    if not root.is_dir():
        raise FaunaError(
            f"data=fauna expects a folder of crops at {root}, got nothing there; set data.root, or use data=zoo, which needs no download"
        )
    pattern = re.compile(photograph_pattern)
    published = any((root / name).is_dir() for name in (LARGE_SCALE, *FEW_SHOT))
    categories = _read_published(root, pattern) if published else _read_flat(root, pattern)
    empty = sorted(name for name, photos in categories.items() if not (photos.train or photos.val or photos.test))
    if empty:
        warnings.warn(f"folders of {root} without a photo, left out: {', '.join(empty)}", UserWarning, stacklevel=2)
    categories = {name: photos for name, photos in sorted(categories.items()) if name not in empty}
    if not categories:
        raise FaunaError(
            f"data=fauna expects {root}/<category>/train/<name>_rgb.jpg (or .png) with <name>_mask.png, got no such file; "
            "check data.root, or use data=zoo, which needs no download"
        )
    return {name: expect_keypoints(photos, num_keypoints) for name, photos in categories.items()}


def read_keypoint_names(root: Path) -> tuple[str, ...] | None:
    """Names of the keypoints from ``root/keypoint_names.json``, ``{"keypoint_names": [name, ...]}`` or the list alone.

    Args:
        root: dataset folder.

    Returns:
        The names in the order of the keypoints, ``None`` without such a file.

    Raises:
        FaunaError: if the file holds anything but different names.
    """
    path = root / KEYPOINT_NAMES
    if not path.is_file():
        return None
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        reason = " ".join(str(error).split())
        raise FaunaError(
            f'{path} expects {{"keypoint_names": [name, ...]}}, got {reason}; mend or remove it'
        ) from error
    names = content.get("keypoint_names") if isinstance(content, dict) else content
    if not isinstance(names, list) or not all(isinstance(name, str) for name in names) or len(set(names)) < len(names):
        raise FaunaError(
            f'{path} expects {{"keypoint_names": [name, ...]}} with different names, got {str(names)[:60]}; mend or remove it'
        )
    return tuple(names)


def expect_keypoints(photos: CategoryPhotos, number: int | None) -> CategoryPhotos:
    """The same photos, whose keypoint files must list ``number`` points; ``None`` = any number."""
    if number is None:
        return photos
    lists = {
        field: tuple(
            replace(photo, source=replace(photo.source, num_keypoints=number)) for photo in getattr(photos, field)
        )
        for field in (*SPLITS, "back_views")
    }
    return replace(photos, **lists)


def _read_flat(root: Path, pattern: re.Pattern[str]) -> dict[str, CategoryPhotos]:
    found = {}
    for folder in _subfolders(root):
        photos = _read_category(folder, folder.name, pattern)
        found[folder.name] = replace(photos, back_views=tuple(_read_photos(folder, BACK, folder.name, pattern)))
    return found


def _read_published(root: Path, pattern: re.Pattern[str]) -> dict[str, CategoryPhotos]:
    """Few-shot categories of one name are merged; one that is also large-scale becomes ``<name>_few_shot``."""
    categories: dict[str, CategoryPhotos] = {}
    for folder in _subfolders(root / LARGE_SCALE):
        name = folder.name.split("_")[0]
        categories[name] = _merge(categories.get(name), _read_category(folder, name, pattern))
    large = set(categories)
    for few_shot in FEW_SHOT:
        for folder in _subfolders(root / few_shot):
            name = f"{folder.name}_few_shot" if folder.name in large else folder.name
            found = _read_category(folder, name, pattern)
            back = root / BACK_VIEWS / folder.name
            if few_shot == FEW_SHOT[0] and back.is_dir():
                found = replace(found, back_views=_read_category(back, name, pattern).train)
            categories[name] = _merge(categories.get(name), found)
    return categories


def _merge(first: CategoryPhotos | None, second: CategoryPhotos) -> CategoryPhotos:
    if first is None:
        return second
    joined = {field: getattr(first, field) + getattr(second, field) for field in (*SPLITS, "back_views")}
    return CategoryPhotos(second.category, **joined)


def _subfolders(root: Path) -> list[Path]:
    return (
        sorted(path for path in root.iterdir() if path.is_dir() and not path.name.startswith("."))
        if root.is_dir()
        else []
    )


def _read_category(folder: Path, category: str, pattern: re.Pattern[str]) -> CategoryPhotos:
    splits = {split: tuple(_read_photos(folder, split, category, pattern)) for split in SPLITS}
    return CategoryPhotos(category, **splits)


def _read_photos(folder: Path, split: str, category: str, pattern: re.Pattern[str]) -> Iterator[Photo]:
    base = folder / split
    for image in sorted(base.rglob("*")) if base.is_dir() else []:
        match = IMAGE_NAME.match(image.name)
        if match is None or image.name.startswith("._"):  # the latter are remains of macOS archives
            continue
        stem = match["stem"] or ""
        prefix = f"{stem}_" if stem else ""
        relative = image.relative_to(base).parent
        yield Photo(
            name="/".join((folder.parent.name, folder.name, split, *relative.parts, stem or "rgb")),
            category=category,
            photograph=_photograph(stem, relative, folder, pattern),
            source=_source(image, prefix),
            feature_map=_existing(image.with_name(f"{prefix}feat16.png")),
        )


def _photograph(stem: str, relative: Path, folder: Path, pattern: re.Pattern[str]) -> str:
    """Frames of one video folder count as one photograph; elsewhere the pattern decides, across categories."""
    if relative.parts:
        return "/".join((folder.parent.name, folder.name, *relative.parts))
    match = pattern.fullmatch(stem)
    return match[1] if match else f"{folder.parent.name}/{folder.name}/{stem}"


def _source(image: Path, prefix: str) -> FileSource:
    mask = image.with_name(f"{prefix}mask.png")
    return FileSource(
        image=image,
        mask=mask,
        box=_existing(image.with_name(f"{prefix}box.txt")),
        keypoints=_existing(image.with_name(f"{prefix}keypoints.json")),
    )


def _existing(path: Path) -> Path | None:
    return path if path.is_file() else None
