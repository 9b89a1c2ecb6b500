"""How well do exported rigs hold? Over drawn animals of every species, and photographs with masks (``--photos FOLDER[:MASKS]``).

One row per set, in the fields ``set``, ``animals``, ``legs_crossed`` (animals whose front bones lie in other legs than the front ones),
``noted`` (whose rig is called doubtful), ``slide_walk``, ``slide_trot``, ``slide_stand`` (the largest distance that a vertex of a
standing sole moves over the ground in a clip, share of the leg's length, worst animal), ``slide_median`` (median animal, its worst clip),
``skin_error_mean``, ``skin_error_mean_max``, ``skin_error_max_median`` and ``skin_error_max`` (four joints a vertex against all twenty, share
of the body's length: mean over the vertices and worst vertex, each of the median and of the worst animal).

    python benchmarks/rigs.py [--smoke | --full] [--photos FOLDER[:MASKS] ...] [--checkpoint FILE] [--json FILE]
"""

import argparse
import json
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from statistics import median
from typing import Any

from arguments import new_file
from segmenters import photographed
from things import Pair

import fauna
from fauna.export.animal import RiggedAnimal
from fauna.export.legs import legs_of
from fauna.reconstruct.reconstructor import Reconstructor
from fauna.reconstruct.settings import default_settings
from fauna.threads import set_threads
from fauna.zoo.zoo import SPECIES, Zoo

IMAGE_SIZE = 256
DEFAULT_COUNT, SMOKE_COUNT, FULL_COUNT = 4, 1, 12
"""Animals of each species."""
STANDING = ("idle", "look_around")


def drawn(count: int) -> Iterator[Pair]:
    """Individuals of every species."""
    zoo = Zoo(seed=0, image_size=IMAGE_SIZE)
    for name in SPECIES:
        for index in range(count):
            sample = zoo.sample(name, 5 * index)
            yield sample.image, sample.mask > 127


def crossed(animal: RiggedAnimal) -> bool:
    """Whether a front foot lies behind the middle of the back, or a hind foot before it."""
    return any((leg.sole[2] < 0.0) == leg.joints.front for leg in legs_of(animal))


def measure(name: str, pairs: Iterator[Pair], reconstructor: Reconstructor) -> dict[str, Any]:
    """A row."""
    results = [reconstructor.reconstruct(image, mask=mask) for image, mask in pairs]
    animals = [result.rigged() for result in results if result.fit is not None]
    slides = [{clip.name: clip.extras["foot_slide"] for clip in animal.clips} for animal in animals]
    mean, most = [each.skin_error_mean for each in animals], [each.skin_error_max for each in animals]
    return {
        "set": name,
        "animals": len(animals),
        "legs_crossed": sum(map(crossed, animals)),
        "noted": sum(bool(each.notes) for each in animals),
        "slide_walk": round(max(each["walk"] for each in slides), 4),
        "slide_trot": round(max(each["trot"] for each in slides), 4),
        "slide_stand": round(max(each[clip] for each in slides for clip in STANDING), 4),
        "slide_median": round(median(max(each.values()) for each in slides), 4),
        "skin_error_mean": round(median(mean), 5),
        "skin_error_mean_max": round(max(mean), 5),
        "skin_error_max_median": round(median(most), 5),
        "skin_error_max": round(max(most), 5),
    }


def main(arguments: Sequence[str] | None = None) -> list[dict[str, Any]]:
    """Parse, measure, print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--smoke", action="store_true", help=f"{SMOKE_COUNT} animal of each species")
    parser.add_argument("--full", action="store_true", help=f"{FULL_COUNT} animals of each species")
    parser.add_argument("--photos", nargs="*", default=[], metavar="FOLDER[:MASKS]")
    parser.add_argument("--count", type=int, default=60, help="photographs of each folder (default 60)")
    parser.add_argument("--checkpoint", default=None, help="default: the model in the package")
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--json", type=new_file, default=None, metavar="FILE")
    given = parser.parse_args(arguments)
    set_threads(given.threads)
    settings = default_settings()
    output = replace(settings.output, finetune_iterations=0, texture_size=0)
    reconstructor = fauna.load(given.checkpoint, settings=replace(settings, output=output))
    count = SMOKE_COUNT if given.smoke else FULL_COUNT if given.full else DEFAULT_COUNT
    rows = [measure("zoo", drawn(count), reconstructor)]
    for folder in given.photos:
        name = Path(folder.partition(":")[0]).name
        rows.append(measure(name, photographed(folder, given.count), reconstructor))
    for row in rows:
        print("  ".join(f"{key} {value}" for key, value in row.items()))
    if given.json is not None:
        given.json.write_text(json.dumps(rows, indent=2) + "\n")
    return rows


if __name__ == "__main__":
    main()
