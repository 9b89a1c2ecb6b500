"""From a predictions folder to all tables; needs neither model nor dataset."""

import time
from collections import Counter, defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from fauna.errors import FaunaError
from fauna.evaluation.baselines import get_baseline
from fauna.evaluation.baselines.base import MeshBaseline
from fauna.evaluation.prediction import Prediction
from fauna.evaluation.reading import FACTS, MODEL, read_facts, read_predictions, read_samples, read_terms
from fauna.evaluation.samples import KEYPOINT_METRICS
from fauna.evaluation.subjects import HELD_OUT, SEEN
from fauna.evaluation.summary import table
from fauna.evaluation.tallies import name_owners
from fauna.evaluation.transfers import lookup, read_transfers
from fauna.metrics.sample import Sample
from fauna.metrics.score import SHARED_BASE, model_flip, score, score_transfer, score_with_tallies

NOT_FEED_FORWARD = "not feed-forward: fitted to the mask it is scored against"


@dataclass(frozen=True)
class ScoreOptions:
    """Choices that change numbers without the model.

    Attributes:
        seed: of pairs, splits, surface points and resampling.
        pairs: largest number of ordered pairs per species.
        bootstrap: replicates of the intervals.
        settings: further settings of the metrics, see :func:`fauna.metrics.score.score`.
    """

    seed: int
    pairs: int
    bootstrap: int
    settings: tuple[str, ...]


class Scorer:
    """Scores what a predictions folder holds.

    Args:
        folder: finished predictions folder.
        options: see :class:`ScoreOptions`.

    Raises:
        FaunaError: when the folder is unfinished or damaged.
    """

    def __init__(self, *, folder: Path, options: ScoreOptions) -> None:
        self.folder = folder
        self.options = options
        self.facts = read_facts(folder)
        everything, self.pictures = read_samples(folder, self.facts["keypoint_names"])
        names = [name for group in self.facts["groups"].values() for name in group]
        absent = sorted(set(names) - set(everything))
        if absent:
            raise FaunaError(
                f"predictions: expected a sample of every photograph that {FACTS} names, got none of {absent[0]} in {folder}; "
                "delete the folder and evaluate anew"
            )
        self.samples = {name: everything[name] for name in names}  # earlier runs may have stored others
        self.left_out: list[dict[str, str]] = list(self.facts["left_out"])
        self.seconds: dict[str, float] = {}

    def tables(self) -> dict[str, Any]:
        """What the report holds, and for files of their own ``images`` and ``tallies``.

        Returns:
            ``metrics``, ``species``, ``held_out``, ``baselines``, ``probes``, ``validation``, ``left_out``, as in ``report.json``;
            ``images``: by group and photograph, with what each baseline scored on it; ``tallies``: by group, key and species.
        """
        settings = self.facts["settings"]
        model = self._predictions(MODEL)
        result = self._groups(MODEL, model, self._shared_base())
        images = {group: self._with_species(scored.pop("images")) for group, scored in _parts(result)}
        tallies = {group: name_owners(scored.pop("tallies"), images[group]) for group, scored in _parts(result)}
        baselines = {name: self._baseline(name, images) for name in settings["baselines"]}
        probes = {name: self._probe(name, model) for name in settings["probes"]}
        terms = defaultdict(list)
        for name, row in read_terms(self.folder).items():
            if name in self.facts["groups"].get(SEEN, ()):
                terms[self.samples[name].category].append(row)
        return {
            **result,
            "baselines": {name: scored for name, scored in baselines.items() if scored},
            "probes": probes,
            "validation": table(terms),
            "images": images,
            "tallies": tallies,
            "left_out": _counted(self.left_out + self._absent(), self.samples),
        }

    def _predictions(self, name: str) -> list[Prediction]:
        return [each for each in read_predictions(self.folder, name) if each.name in self.samples]

    def _shared_base(self) -> list[Prediction]:
        """Predictions of the model with one base mesh per species, where they are asked for and were made."""
        if SHARED_BASE not in self.options.settings:
            return []
        if (self.folder / SHARED_BASE).is_dir():
            return self._predictions(SHARED_BASE)
        reason = (
            f"no predictions with shared base meshes are stored; evaluate the checkpoint with settings=[{SHARED_BASE}]"
        )
        self.left_out.append({"of": MODEL, "name": "*", "metric": SHARED_BASE, "reason": reason})
        return []

    def _groups(
        self, of: str, predictions: Sequence[Prediction], shared: Sequence[Prediction] | None = None
    ) -> dict[str, Any]:
        """Scores of the main group, with those of held-out species under ``held_out``."""
        by_name = {prediction.name: prediction for prediction in predictions}
        result: dict[str, Any] = {"metrics": {}, "species": {}, "images": {}, "tallies": {}}
        started = time.monotonic()
        everywhere = [name for names in self.facts["groups"].values() for name in names]
        flip = model_flip([by_name[n] for n in everywhere if n in by_name], [self.samples[n] for n in everywhere])
        for group, names in self.facts["groups"].items():
            found = [by_name[name] for name in names if name in by_name]
            samples = [self.samples[name] for name in names]
            scored, tallies = score_with_tallies(
                found,
                samples,
                seed=self.options.seed,
                pairs=self.options.pairs,
                bootstrap=self.options.bootstrap,
                settings=self.options.settings,
                flip=flip,
                shared=None if shared is None else [each for each in shared if each.name in set(names)],
            )
            scored["tallies"] = tallies
            self._place(result, of, group, scored)
        self.seconds[f"score {of}"] = round(time.monotonic() - started, 2)
        return result

    def _place(self, result: dict[str, Any], of: str, group: str, scored: dict[str, Any]) -> None:
        self.left_out += [{"of": of, **row} for row in scored.pop("left_out")]
        if group == HELD_OUT:
            result[HELD_OUT] = scored
        else:
            result |= scored

    def _baseline(self, name: str, images: Mapping[str, Mapping[str, dict[str, Any]]]) -> dict[str, Any]:
        """Scores of a baseline; those of each photograph are noted beside the model's."""
        baseline = get_baseline(name)
        if isinstance(baseline, MeshBaseline):
            result = self._groups(name, self._predictions(name))
        else:
            try:
                result = self._transferred(name)
            except FaunaError as error:
                self.left_out.append({"of": name, "name": "*", "metric": "all", "reason": str(error)})
                return {}
        for group, scored in _parts(result):
            for photograph, scores in scored.pop("images", {}).items():
                known = {key: value for key, value in scores.items() if value is not None}
                images[group][photograph]["baselines"][name] = known
            scored.pop("tallies", None)
        return {"description": baseline.description, **result}

    def _transferred(self, name: str) -> dict[str, Any]:
        options = self.options
        positions = read_transfers(self.folder / f"{name}.npz", seed=options.seed, pairs=options.pairs)
        result: dict[str, Any] = {"metrics": {}, "species": {}}
        for group, names in self.facts["groups"].items():
            samples = [self.samples[n] for n in names if self.samples[n].keypoints is not None]
            if not samples:
                continue
            transfer = lookup(positions, samples)
            scored = score_transfer(
                transfer, samples, seed=options.seed, pairs=options.pairs, bootstrap=options.bootstrap
            )
            self._place(result, name, group, scored)
        return result

    def _probe(self, name: str, model: Sequence[Prediction]) -> dict[str, Any]:
        """The fitted predictions, and the model's own on the same photographs."""
        probed = self.facts["settings"]["probed"]
        found = [each for each in self._predictions(f"probe_{name}") if each.name in probed]
        chosen = {prediction.name for prediction in found}
        fitted = self._probed(found, f"probe {name}")
        own = self._probed(
            [each for each in model if each.name in chosen], f"the model on the photographs of probe {name}"
        )
        return {
            "label": NOT_FEED_FORWARD,
            "num_photos": len(found),
            "metrics": fitted["metrics"],
            "species": fitted["species"],
            "model_on_the_same_photos": own["metrics"],
        }

    def _probed(self, predictions: Sequence[Prediction], of: str) -> dict[str, Any]:
        """Scores of predictions of a few photographs, in one group."""
        options = self.options
        scored = score(
            predictions,
            [self.samples[prediction.name] for prediction in predictions],
            seed=options.seed,
            pairs=options.pairs,
            bootstrap=options.bootstrap,
            settings=options.settings,
        )
        self.left_out += [{"of": of, **row} for row in scored["left_out"]]
        return scored

    def _with_species(self, images: Mapping[str, Mapping[str, Any]]) -> dict[str, dict[str, Any]]:
        return {
            name: {"species": self.samples[name].category, "scores": dict(row), "baselines": {}}
            for name, row in images.items()
        }

    def _absent(self) -> list[dict[str, str]]:
        """Kinds of metric that the whole dataset does not allow."""
        rows = []
        samples: Sequence[Sample] = list(self.samples.values())
        unnamed = any(row["metric"] == KEYPOINT_METRICS for row in self.left_out)
        if not unnamed and not any(sample.keypoints is not None for sample in samples):
            rows.append((KEYPOINT_METRICS, "the dataset has no keypoints"))
        if not any(sample.truth is not None for sample in samples):
            rows.append(("3D metrics", "the dataset has no 3D truth"))
        return [{"of": MODEL, "name": "*", "metric": metric, "reason": reason} for metric, reason in rows]


def _parts(result: dict[str, Any]) -> list[tuple[str, dict[str, Any]]]:
    """The score dictionaries of a result by group."""
    return [(SEEN, result), *([(HELD_OUT, result[HELD_OUT])] if HELD_OUT in result else [])]


def _counted(rows: Sequence[Mapping[str, str]], samples: Mapping[str, Sample]) -> list[dict[str, Any]]:
    """Rows joined: the names that share metric and reason, then the metrics that share names and reason.

    ``count`` is the number of photographs; the name of a species stands for all of its, ``*`` for all there are.
    """
    names: dict[tuple[str, str, str], list[str]] = defaultdict(list)
    for row in rows:
        names[row["of"], row["reason"], row["metric"]].append(row["name"])
    metrics: dict[tuple[str, str, tuple[str, ...]], list[str]] = defaultdict(list)
    for (of, reason, metric), found in names.items():
        metrics[of, reason, tuple(found)].append(metric)
    species = Counter(sample.category for sample in samples.values()) | {"*": len(samples)}
    return [
        {
            "of": of,
            "metrics": found,
            "reason": reason,
            "count": sum(1 if name in samples else species.get(name, 1) for name in of_names),
            "names": list(of_names),
        }
        for (of, reason, of_names), found in metrics.items()
    ]
