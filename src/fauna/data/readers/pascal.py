"""``data=pascal``: the annotations of A-CSM on photographs of PASCAL VOC, read from its ``.mat`` files.

``{species}_{split}.mat`` holds the struct array ``images`` with ``rel_path``, ``voc_rec_id``, ``bbox`` (``x1 y1 x2 y2``), ``parts`` (3, key) and
``mask`` (of the photograph's size); ``{species}_kps.mat`` holds ``kp_names`` and ``kp_perm_inds``. All pixels and indices count from 1.
"""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from scipy.io import loadmat

from fauna.data.readers.animal import Animal, LeftOut
from fauna.data.readers.collection import KeypointPhotos, photograph_name
from fauna.data.readers.files import forward_slashes, keypoint_rows
from fauna.data.readers.keypoints import canonical_names, mirror_indices
from fauna.data.readers.masks import encode_mask
from fauna.errors import FaunaError

SPLIT_NAMES = {"train": "train", "val": "val"}


class PascalPhotos(KeypointPhotos):
    """Animals of A-CSM's PASCAL files.

    Args:
        root: folder with ``annotations`` and ``images``.
        annotations: folder of the ``.mat`` files below the root.
        images: folder of the photographs below the root (VOC's ``JPEGImages``).
        species: the species to read: they name the files.
        crop_size: side of a crop, pixels.
        min_visibility: smallest flag of a keypoint that counts as annotated.
    """

    def __init__(
        self,
        *,
        root: str | None,
        annotations: str,
        images: str,
        species: list[str],
        crop_size: int,
        min_visibility: float,
    ) -> None:
        super().__init__(root=root, images=images, crop_size=crop_size, box_margin=0.0, box_fill=1.0, species=None)
        if not species:
            raise FaunaError(
                "data.source.species: expected species that name .mat files, got none; e.g. [horse,cow,sheep]"
            )
        self.folder = self.root / annotations
        self.listed_species = tuple(species)
        self.min_visibility = min_visibility

    @property
    def sources(self) -> Sequence[str]:
        """The folder of the annotations and the species."""
        return [self.folder.name, *self.listed_species]

    def read_keypoint_names(self) -> tuple[str, ...]:
        """From ``{species}_kps.mat``, the same for all species; its mirror indices must agree with the names."""
        lists = {species: self._names(species) for species in self.listed_species}
        if len(set(lists.values())) > 1:
            raise FaunaError(
                f"{self.folder} expects the same kp_names for {', '.join(lists)}, got different ones; read the species separately"
            )
        return lists[self.listed_species[0]]

    def animals(self, split: str) -> Iterator[Animal | LeftOut]:
        """By species, in the order of the file; a species may lack one of the two files."""
        if split not in SPLIT_NAMES:
            return
        for species in self.listed_species:
            path = self.folder / f"{species}_{SPLIT_NAMES[split]}.mat"
            if not path.is_file():
                self._require_any(species)
                continue
            for number, entry in enumerate(np.atleast_1d(_variable(path, "images"))):
                yield self._animal(entry, species, f"{path.name} entry {number}")

    def _animal(self, entry: Any, species: str, where: str) -> Animal | LeftOut:
        missing = [field for field in ("rel_path", "voc_rec_id", "bbox", "parts", "mask") if not hasattr(entry, field)]
        if missing:
            raise FaunaError(
                f"{where} expects rel_path, voc_rec_id, bbox, parts, mask, got no {', '.join(missing)}; mend it"
            )
        image = forward_slashes(str(entry.rel_path))
        name = f"{self.root.name}/{species}/{Path(image).stem}_{entry.voc_rec_id}"
        mask = np.asarray(entry.mask) > 0
        if mask.ndim != 2 or not mask.any():
            return LeftOut(name, f"its mask is empty or not a picture (shape {mask.shape})")
        box = entry.bbox
        return Animal(
            name=name,
            species=species,
            image=image,
            photograph=photograph_name(Path(image).stem, None, dataset="voc"),
            size=(mask.shape[1], mask.shape[0]),
            box=(float(box.x1) - 1, float(box.y1) - 1, float(box.x2), float(box.y2)),
            mask=encode_mask(mask),
            keypoints=keypoint_rows(np.asarray(entry.parts).T, name, shift=-0.5, min_visibility=self.min_visibility),
        )

    def _names(self, species: str) -> tuple[str, ...]:
        path = self.folder / f"{species}_kps.mat"
        names = tuple(str(name).strip() for name in np.atleast_1d(_variable(path, "kp_names")))
        mirrored = tuple(int(place) - 1 for place in np.atleast_1d(_variable(path, "kp_perm_inds")))
        expected = mirror_indices(canonical_names(names))
        if mirrored != expected:
            wrong = [name for name, one, other in zip(names, mirrored, expected, strict=False) if one != other]
            raise FaunaError(
                f"{path} expects kp_perm_inds to swap left and right of kp_names, got others for {wrong}; mend it"
            )
        return names

    def _require_any(self, species: str) -> None:
        if not any((self.folder / f"{species}_{name}.mat").is_file() for name in SPLIT_NAMES.values()):
            raise FaunaError(
                f"{self.folder} expects {species}_train.mat or {species}_val.mat, got neither; "
                "check data.root, data.source.annotations and data.source.species"
            )


def _variable(path: Path, name: str) -> Any:
    """A variable of a ``.mat`` file; raises FaunaError when the file is missing, broken or without it."""
    if not path.is_file():
        raise FaunaError(f"{path} expects a .mat file, got nothing there; check data.root and data.source")
    try:
        content = loadmat(path, struct_as_record=False, squeeze_me=True)
    except Exception as error:  # scipy raises many kinds for broken files
        reason = " ".join(str(error).split())
        raise FaunaError(f"{path} expects a .mat file up to version 7, got {reason}; download it again") from error
    if name not in content:
        raise FaunaError(
            f"{path} expects the variable {name}, got {sorted(k for k in content if k[0] != '_')}; mend it"
        )
    return content[name]
