"""How good are the masks of a segmenter? IoU with given masks, on drawn animals and on your own photographs.

One row per set of photographs, in the fields ``segmenter``, ``set``, ``photographs``, ``iou_mean``, ``iou_median``, ``above_0.7`` (share) and
``median_ms``. Folders hold photographs with masks beside them (``x_mask.png``, ``masks/x.png``) or in a second folder, in files of the
same stem (``--photos PHOTOS:MASKS``). The photographs are chosen by lot.

    python benchmarks/segmenters.py [--smoke | --full] [--photos FOLDER[:MASKS] ...] [--segmenter grabcut] [--json FILE]
"""

import argparse
import json
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from statistics import mean, median
from typing import Any

import numpy as np
from arguments import new_file

from fauna.build import build_encoder, stored_config
from fauna.errors import FaunaError
from fauna.io.checkpoint import read_weights
from fauna.masks.grabcut import GrabCut
from fauna.masks.registry import build_segmenter
from fauna.pretrained.shipped import shipped_weights
from fauna.reconstruct.formats import PHOTO_SUFFIXES
from fauna.reconstruct.mask_files import masks_beside, read_masks
from fauna.reconstruct.photograph import read_photograph
from fauna.reconstruct.settings import default_settings
from fauna.threads import set_threads
from fauna.zoo.zoo import SPECIES, Zoo

Pair = tuple[np.ndarray, np.ndarray]
"""Photograph and mask."""
SEED = 0
IMAGE_SIZE = 256
DEFAULT_COUNT, SMOKE_COUNT, FULL_COUNT = 40, 2, 200


def drawn(count: int) -> Iterator[Pair]:
    """Animals of the zoo in their surroundings, individuals no weights were trained on."""
    zoo = Zoo(seed=5, image_size=IMAGE_SIZE)
    for index in range(count):
        sample = zoo.sample(SPECIES[index % len(SPECIES)], index // len(SPECIES))
        yield sample.image, sample.mask > 127


def photographed(text: str, count: int) -> Iterator[Pair]:
    """Photographs of a folder that have a mask, by lot."""
    folder, _, masks = text.partition(":")
    limits = default_settings().photo
    listed = [each for each in sorted(Path(folder).rglob("*")) if each.suffix.lower() in PHOTO_SUFFIXES]
    pairs = [(photo, _masks(photo, masks)) for photo in listed if not photo.stem.endswith("_mask")]
    pairs = [(photo, found) for photo, found in pairs if found]
    if not pairs:
        raise FaunaError(f"photos: expected photographs with masks, got {text} without any; see --help")
    for index in np.random.default_rng(SEED).permutation(len(pairs))[:count]:
        photo, files = pairs[index]
        photograph = read_photograph(photo, limits)
        yield (
            photograph.image,
            np.logical_or.reduce(read_masks(files, photograph, "beside", default_settings().mask).masks),
        )


def _masks(photo: Path, folder: str) -> list[Path]:
    return sorted(Path(folder).rglob(f"{photo.stem}*.*")) if folder else masks_beside(photo)


def measure(segmenter: Any, name: str, pairs: Iterator[Pair]) -> dict[str, Any]:
    """A row."""
    overlaps, seconds = [], []
    for image, mask in pairs:
        begun = time.perf_counter()
        found = segmenter.segment(image)
        seconds.append(time.perf_counter() - begun)
        overlaps.append(float((found & mask).sum() / max((found | mask).sum(), 1)))
    return {
        "segmenter": segmenter.name,
        "set": name,
        "photographs": len(overlaps),
        "iou_mean": round(mean(overlaps), 4),
        "iou_median": round(median(overlaps), 4),
        "above_0.7": round(mean(each > 0.7 for each in overlaps), 4),
        "median_ms": round(1000 * median(seconds), 1),
    }


def main(arguments: Sequence[str] | None = None) -> list[dict[str, Any]]:
    """Parse, measure, print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--smoke", action="store_true", help="two drawn animals")
    parser.add_argument("--full", action="store_true", help=f"{FULL_COUNT} photographs of each set")
    parser.add_argument("--photos", nargs="*", default=[], metavar="FOLDER[:MASKS]")
    parser.add_argument("--count", type=int, default=None, help=f"photographs of each set (default {DEFAULT_COUNT})")
    parser.add_argument("--segmenter", default="grabcut")
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--json", type=new_file, default=None, metavar="FILE")
    given = parser.parse_args(arguments)
    set_threads(given.threads)
    count = given.count or (SMOKE_COUNT if given.smoke else FULL_COUNT if given.full else DEFAULT_COUNT)
    settings = default_settings().mask
    encoder = build_encoder(stored_config(read_weights(shipped_weights())[1]["config"]))
    default = GrabCut(encoder=encoder, saliency=settings.saliency, options=settings.grabcut)
    segmenter = build_segmenter(given.segmenter, default)
    rows = [measure(segmenter, "zoo", drawn(count))]
    rows += [measure(segmenter, Path(each.partition(":")[0]).name, photographed(each, count)) for each in given.photos]
    for row in rows:
        print("  ".join(f"{key} {value}" for key, value in row.items()))
    if given.json is not None:
        given.json.write_text(json.dumps(rows, indent=2) + "\n")
    return rows


if __name__ == "__main__":
    main()
