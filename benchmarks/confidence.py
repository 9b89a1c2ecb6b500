"""Is there an animal in the mask? Fits the confidence of ``conf/reconstruct.yaml`` to a model and tells how often it errs.

Animals are drawn ones, of individuals no shipped weights were trained on, and photographs with masks (``--animals FOLDER[:MASKS]``, as in
``benchmarks/segmenters.py``). Other things are drawn ones, the photographs in scikit-image that show no animal, those of ``--things FOLDER``
(the segmenter makes their masks), and pieces of the photographs of animals beside the animal. One row per set, in the fields ``set``,
``kind`` (one of :data:`KINDS`), ``pictures``, ``iou_median``, ``strangeness_median``, ``distinctness_median``, ``confidence_median``,
``doubted`` (share below the limit, by the numbers of ``conf/reconstruct.yaml``), ``doubted_held_out`` and ``wrong_held_out`` (the same, and the
share on the wrong side of 0.5, by numbers fitted without the tenth of the pictures that a picture belongs to) and ``fit``: the numbers that fit
all pictures, and the weight file they belong to, the same in every row.

    python benchmarks/confidence.py [--smoke] [--animals FOLDER[:MASKS] ...] [--things FOLDER ...] [--checkpoint FILE] [--json FILE]
"""

import argparse
import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import skimage
from arguments import new_file
from scipy.optimize import minimize
from scipy.special import expit
from segmenters import drawn, photographed
from things import Pair, drawn_things, pieces

import fauna
from fauna.errors import FaunaError
from fauna.reconstruct.formats import PHOTO_SUFFIXES
from fauna.reconstruct.photograph import read_photograph
from fauna.reconstruct.quality import Measures, confidence
from fauna.reconstruct.reconstructor import Reconstructor
from fauna.reconstruct.settings import QualitySettings, default_settings
from fauna.reconstruct.status import Refused
from fauna.threads import set_threads

KINDS = {
    "drawn animals": True,
    "animals": True,
    "drawn things": False,
    "things": False,
    "beside animals": False,
}
"""What pictures show, and whether that is an animal. Animals and things weigh the same in a fit, and so do the kinds of each."""
BUNDLED = (
    *("astronaut", "brick", "camera", "cell", "clock_motion", "coffee", "coins", "color", "grass", "gravel", "hubble_deep_field"),
    *("ihc", "microaneurysms", "moon", "motorcycle_left", "page", "phantom", "retina", "rocket", "text"),
)  # fmt: skip
"""Pictures that scikit-image carries; its cat and its horse are left out."""
SEED, FOLDS, RIDGE = 0, 10, 0.01
THING_SIDE = 400
DEFAULT_COUNT, SMOKE_COUNT = 60, 12


@dataclass(frozen=True)
class PictureSet:
    """What was measured on pictures of one kind, and the tenth that each belongs to."""

    name: str
    kind: str
    measures: tuple[Measures, ...]
    folds: tuple[int, ...]

    @property
    def animals(self) -> bool:
        """Whether they are."""
        return KINDS[self.kind]

    @property
    def table(self) -> np.ndarray:
        """(picture, 3) outline IoU, strangeness and distinctness."""
        return np.array([(each.iou, each.strangeness, each.distinctness) for each in self.measures])


def things_of(paths: Sequence[Path], reconstructor: Reconstructor) -> Iterator[Pair]:
    """Photographs without an animal as the segmenter sees them; none where it finds nothing."""
    limits = replace(reconstructor.settings.photo, work_side=THING_SIDE)
    for path in paths:
        try:
            image = read_photograph(path, limits).image
        except Refused:
            continue
        mask = reconstructor.segmenter.segment(image)
        if mask.any():
            yield image, mask


def by_lot(folder: str, count: int) -> list[Path]:
    """Photographs of a folder."""
    listed = [each for each in sorted(Path(folder).rglob("*")) if each.suffix.lower() in PHOTO_SUFFIXES]
    if not listed:
        raise FaunaError(f"things: expected photographs, got {folder} without any; see --help")
    return [listed[index] for index in np.random.default_rng(SEED).permutation(len(listed))[:count]]


def bundled(count: int) -> list[Path]:
    """Those of scikit-image."""
    listed = sorted((Path(skimage.__file__).parent / "data").glob("*.*"))
    return [each for each in listed if each.stem in BUNDLED and each.suffix in PHOTO_SUFFIXES][:count]


def measured(name: str, kind: str, pairs: Iterator[Pair], reconstructor: Reconstructor) -> PictureSet:
    """Reconstruct each; what gives no mesh is left out."""
    measures, folds = [], []
    for index, (image, mask) in enumerate(pairs):
        fit = reconstructor.reconstruct(image, mask=mask).fit
        if fit is not None:
            measures.append(fit.measures)
            folds.append(index % FOLDS)
    if not measures:
        raise FaunaError(f"{name}: expected pictures that can be measured, got none; choose others")
    return PictureSet(name, kind, tuple(measures), tuple(folds))


def fitted(sets: Sequence[PictureSet], inside: np.ndarray) -> np.ndarray:
    """(4,) bias and three factors: ridge logistic regression, weights as :data:`KINDS` says.

    Args:
        sets: measured.
        inside: (picture,) which pictures of all sets are looked at.
    """
    kinds = np.concatenate([[each.kind] * len(each.measures) for each in sets])[inside]
    animals = np.array([KINDS[kind] for kind in kinds])
    of_kind, first = np.unique(kinds, return_index=True)
    weights = np.zeros(len(kinds))
    for kind, animal in zip(of_kind, animals[first], strict=True):
        weights[kinds == kind] = 0.5 / (animals[first] == animal).sum() / (kinds == kind).sum()
    table = np.concatenate([each.table for each in sets])[inside]
    middle, spread = table.mean(axis=0), table.std(axis=0)
    design = np.column_stack([np.ones(len(table)), (table - middle) / spread])
    signs = np.where(animals, 1.0, -1.0)

    def loss(factors: np.ndarray) -> float:
        wrong = np.logaddexp(0.0, -signs * (design @ factors))
        return float(weights @ wrong + 0.5 * RIDGE * (factors[1:] ** 2).sum())

    factors = minimize(loss, np.zeros(design.shape[1]), method="BFGS").x
    scaled = factors[1:] / spread
    return np.array([factors[0] - scaled @ middle, *scaled])


def held_out(sets: Sequence[PictureSet]) -> list[np.ndarray]:
    """Confidence of every picture by numbers that were fitted without its tenth."""
    table, folds = np.concatenate([each.table for each in sets]), np.concatenate([each.folds for each in sets])
    found = np.empty(len(table))
    for fold in range(FOLDS):
        bias, *factors = fitted(sets, folds != fold)
        found[folds == fold] = expit(bias + table[folds == fold] @ factors)
    return np.split(found, np.cumsum([len(each.measures) for each in sets])[:-1])


def rows_of(sets: Sequence[PictureSet], quality: QualitySettings, weights: str) -> list[dict[str, Any]]:
    """One per set."""
    bias, iou, strangeness, distinctness = fitted(sets, np.ones(sum(len(each.measures) for each in sets), bool))
    fit = {"bias": bias, "iou": iou, "strangeness": -strangeness, "distinctness": distinctness}
    fit = {**{name: round(float(value), 1) for name, value in fit.items()}, "weights": weights}
    rows = []
    for each, unseen in zip(sets, held_out(sets), strict=True):
        sure = np.array([confidence(measures, quality) for measures in each.measures])
        medians = [_rounded(value) for value in np.median(each.table, axis=0)]
        rows.append({
            "set": each.name,
            "kind": each.kind,
            "pictures": len(sure),
            **dict(zip(("iou_median", "strangeness_median", "distinctness_median"), medians, strict=True)),
            "confidence_median": _rounded(np.median(sure)),
            "doubted": _rounded((sure < quality.quadruped).mean()),
            "doubted_held_out": _rounded((unseen < quality.quadruped).mean()),
            "wrong_held_out": _rounded(((unseen > 0.5) != each.animals).mean()),
            "fit": fit,
        })  # fmt: skip
    return rows


def _rounded(value: Any) -> float:
    return round(float(value), 4)


def picture_sets(
    reconstructor: Reconstructor, *, animals: Sequence[str], things: Sequence[str], count: int
) -> list[PictureSet]:
    """Measure everything: what everybody has, then folders."""
    plain: list[tuple[str, str, Iterator[Pair]]] = [
        ("drawn animals", "drawn animals", drawn(count)),
        ("drawn things", "drawn things", drawn_things(count, SEED)),
        ("scikit-image", "things", things_of(bundled(count), reconstructor)),
    ]
    plain += [(Path(folder).name, "things", things_of(by_lot(folder, count), reconstructor)) for folder in things]
    for folder in animals:
        name = Path(folder.partition(":")[0]).name
        plain.append((name, "animals", photographed(folder, count)))
        plain.append((f"beside {name}", "beside animals", pieces(photographed(folder, count), SEED)))
    return [measured(name, kind, pairs, reconstructor) for name, kind, pairs in plain]


def main(arguments: Sequence[str] | None = None) -> list[dict[str, Any]]:
    """Parse, measure, print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--smoke", action="store_true", help=f"{SMOKE_COUNT} pictures of each set")
    parser.add_argument("--animals", nargs="*", default=[], metavar="FOLDER[:MASKS]")
    parser.add_argument("--things", nargs="*", default=[], metavar="FOLDER")
    parser.add_argument("--count", type=int, default=None, help=f"pictures of each set (default {DEFAULT_COUNT})")
    parser.add_argument("--checkpoint", default=None, help="default: the model in the package")
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--json", type=new_file, default=None, metavar="FILE")
    given = parser.parse_args(arguments)
    set_threads(given.threads)
    settings = default_settings()
    settings = replace(settings, output=replace(settings.output, finetune_iterations=0))
    reconstructor = fauna.load(given.checkpoint, settings=settings)
    count = given.count or (SMOKE_COUNT if given.smoke else DEFAULT_COUNT)
    sets = picture_sets(reconstructor, animals=given.animals, things=given.things, count=count)
    rows = rows_of(sets, settings.quality, reconstructor.weights.sha256)
    for row in rows:
        print("  ".join(f"{key} {value}" for key, value in row.items() if key != "fit"))
    print("quality:", json.dumps(rows[0]["fit"]))
    if given.json is not None:
        given.json.write_text(json.dumps(rows, indent=2) + "\n")
    return rows


if __name__ == "__main__":
    main()
