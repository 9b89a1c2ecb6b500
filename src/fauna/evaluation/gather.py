"""Everything that needs the model or the dataset: samples, predictions, baselines and probes, written to one folder."""

import contextlib
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import torch
from rich.progress import track

from fauna.data.datamodule import PhotoDataModule
from fauna.data.photos import Photo
from fauna.errors import FaunaError
from fauna.evaluation.baselines import get_baseline
from fauna.evaluation.baselines.base import Bench, MeshBaseline, Reconstruct
from fauna.evaluation.predict import predict
from fauna.evaluation.probes import ProbeOptions, check_probes, probe
from fauna.evaluation.reading import FACTS, FORMAT, MODEL, SAMPLES
from fauna.evaluation.records import pack_prediction, pack_sample, unpack_prediction, unpack_sample
from fauna.evaluation.samples import KEYPOINT_METRICS, read_sample
from fauna.evaluation.shared_base import shared_base
from fauna.evaluation.stopwatch import Stopwatch
from fauna.evaluation.store import ArrayStore, Item, names_digest
from fauna.evaluation.subjects import Subjects
from fauna.evaluation.summary import image_terms
from fauna.evaluation.trained_on import REASON
from fauna.evaluation.transfers import record_transfers
from fauna.io.run_folder import write_json
from fauna.losses.objective import Objective
from fauna.metrics.sample import Sample
from fauna.metrics.score import SHARED_BASE
from fauna.model import FaunaModel

TIMING = "timing.json"
PHOTOS = "photos"  # part of the identity of what depends on all photographs together
UNNAMED = "its keypoints have no names; add keypoint_names.json to the dataset"
LeftOut = list[dict[str, str]]
"""Rows ``of`` (the model, a baseline or a probe), ``name`` of the photograph, ``metric``, ``reason``."""


class Gatherer:
    """Fills a predictions folder; what is there already is kept, so that an interrupted evaluation goes on.

    Args:
        folder: of the predictions.
        model: in evaluation mode.
        fresh_model: builds a model of the same architecture with new random weights.
        data: makes batches.
        subjects: the photographs.
        keys: of every photograph, changing with its picture and annotation (:func:`fauna.evaluation.protocol.photo_keys`).
        facts: what the protocol says about checkpoint and dataset; identifies the folder.
        size: side of masks and silhouettes, pixels.
    """

    def __init__(
        self,
        *,
        folder: Path,
        model: FaunaModel,
        fresh_model: Callable[[], FaunaModel],
        data: PhotoDataModule,
        subjects: Subjects,
        keys: Mapping[str, str],
        facts: Mapping[str, Any],
        size: int,
    ) -> None:
        self.folder = folder
        self.model = model
        self.fresh_model = fresh_model
        self.data = data
        self.subjects = subjects
        self.keys = keys
        self.size = size
        self.keypoint_names = tuple(data.source.keypoint_names or ())
        self.facts = dict(facts) | {"size": size, "keypoint_names": list(self.keypoint_names)}
        self.left_out: LeftOut = [
            {"of": "dataset", "name": name, "metric": "all", "reason": reason}
            for name, reason in (*data.source.left_out, *((name, REASON) for name in subjects.left_out))
        ]
        self.probed: list[str] = []
        self.stopwatch = Stopwatch(folder / TIMING)

    def samples(self) -> dict[str, Sample]:
        """Read masks, keypoints and truth of the photographs; unusable ones are left out by name and reason.

        Raises:
            FaunaError: when a photograph stored by an earlier run is not what the dataset holds now.
        """
        store = self._store(SAMPLES)
        with self._timed(SAMPLES):
            for photo in self._missing(store, self.subjects.photos, "photographs"):
                try:
                    read = read_sample(photo, size=self.size, keypoint_names=self.keypoint_names)
                except FaunaError as error:
                    self._leave_out(photo, MODEL, str(error))
                    continue
                notes = {"key": self.keys[photo.name], "unnamed_keypoints": read.unnamed_keypoints}
                store.add(pack_sample(read.sample, thumbnail=read.picture, **notes))
            store.flush()
        return self._current(store)

    def _current(self, store: ArrayStore) -> dict[str, Sample]:
        """Samples of the photographs that are looked at; an earlier run may have stored others."""
        samples: dict[str, Sample] = {}
        items = {item.name: item for item in store.items()}
        for photo in self.subjects.photos:
            if photo.name not in items:
                continue
            item = items[photo.name]
            if item.notes.get("key") != self.keys[photo.name]:
                raise FaunaError(
                    f"out: expected the photographs {self.folder} was made with, got another picture or annotation of "
                    f"{photo.name}; choose another out"
                )
            if item.notes.get("unnamed_keypoints"):
                self._leave_out(photo, "dataset", UNNAMED, metric=KEYPOINT_METRICS)
            samples[photo.name] = unpack_sample(item, self.keypoint_names)
        return samples

    def predictions(self, samples: Mapping[str, Sample], objective: Objective) -> Bench:
        """Reconstruct the photographs one by one. A folder that was finished is unfinished from here on.

        Args:
            samples: of :meth:`samples`.
            objective: whose image terms are noted, unweighted.
        """
        photos = [photo for photo in self.subjects.photos if photo.name in samples]
        store = self._store(MODEL)
        (self.folder / FACTS).unlink(missing_ok=True)  # not finished again before :meth:`finish`
        plain = replace(objective, weighting="uniform")
        with self._timed(MODEL):
            for photo in self._missing(store, photos, "reconstructions"):
                try:
                    store.add(self._predicted(photo, plain))
                except FaunaError as error:
                    self._leave_out(photo, MODEL, str(error))
            store.flush()
        items = [item for item in store.items() if item.name in samples]
        found = {item.name: unpack_prediction(item) for item in items}
        if not found:
            raise FaunaError(
                f"expected at least one reconstruction of {len(photos)} photographs, got none; first problem: "
                f"{self.left_out[-1]['reason']}"
            )
        return Bench(
            model=self.model,
            fresh_model=self.fresh_model,
            data=self.data,
            photos=photos,
            samples=samples,
            predictions=found,
            codes={item.name: item.arrays["code"] for item in items},
            size=self.size,
            species=list(self.facts["checkpoint"]["species"]),
        )

    def baselines(self, bench: Bench, names: Sequence[str], *, seed: int, pairs: int) -> None:
        """Predictions or keypoint transfers of each baseline."""
        predicted = [photo for photo in bench.photos if photo.name in bench.predictions]
        for name in names:
            baseline = get_baseline(name)
            with self._timed(name):
                if isinstance(baseline, MeshBaseline):
                    settings = {PHOTOS: names_digest(bench.predictions)} if baseline.of_all_photos else {}
                    self._reconstructed(name, predicted, lambda b=baseline: b.prepare(bench), settings)
                else:
                    groups = self._groups(bench)
                    record_transfers(
                        self.folder / f"{name}.npz", baseline.prepare, bench, groups, seed=seed, pairs=pairs
                    )

    def shared_base(self, bench: Bench) -> None:
        """Predictions with one base mesh per species, see :mod:`fauna.evaluation.shared_base`."""
        photos = [photo for photo in bench.photos if photo.name in bench.predictions]
        with self._timed(SHARED_BASE):
            settings = {PHOTOS: names_digest(bench.predictions)}
            self._reconstructed(SHARED_BASE, photos, lambda: shared_base(bench), settings)

    def probes(self, bench: Bench, names: Sequence[str], options: ProbeOptions, number: int) -> None:
        """Fit the first ``number`` photographs, those of the main group before others."""
        photos = [photo for photo in bench.photos if photo.name in bench.predictions][:number]
        self.probed = [photo.name for photo in photos]
        for name in check_probes(names):
            with self._timed(f"probe_{name}"):
                settings = {"steps": options.steps, "lr": options.lr}
                self._reconstructed(f"probe_{name}", photos, lambda free=name: probe(bench, free, options), settings)

    def finish(self, bench: Bench, settings: Mapping[str, Any]) -> None:
        """Write ``facts.json``; the folder is complete with it."""
        content = {
            **self.facts | {"format": FORMAT},
            "split": self.subjects.split,
            "groups": self._groups(bench),
            "settings": {**settings, "probed": self.probed},
            "left_out": self.left_out,
            "timing": self.stopwatch.rounded(),
        }
        write_json(content, self.folder / FACTS)

    def _groups(self, bench: Bench) -> dict[str, list[str]]:
        return {
            name: [p.name for p in photos if p.name in bench.samples] for name, photos in self.subjects.groups.items()
        }

    def _predicted(self, photo: Photo, objective: Objective) -> Item:
        batch = self.model.with_features(self.data.single(photo).to(self.model.device))
        prediction, out = predict(self.model, batch, category=photo.category, size=self.size)
        item = pack_prediction(prediction, terms=image_terms(self.model, objective, batch, out))
        return replace(item, arrays={**item.arrays, "code": out.code.cpu().float().numpy()})

    def _reconstructed(
        self,
        name: str,
        photos: Sequence[Photo],
        prepare: Callable[[], Reconstruct],
        settings: Mapping[str, Any] | None = None,
    ) -> None:
        store = self._store(name, settings)
        if not {photo.name for photo in photos} <= set(store.names):
            reconstruct = prepare()
            for photo in self._missing(store, photos, name):
                try:
                    store.add(pack_prediction(reconstruct(photo)))
                except FaunaError as error:
                    self._leave_out(photo, name, str(error))
        store.flush()

    def _store(self, name: str, settings: Mapping[str, Any] | None = None) -> ArrayStore:
        identity = {key: self.facts[key] for key in ("size", "keypoint_names")}
        identity |= {"dataset": self.facts["dataset"]["identity"]}
        if name != SAMPLES:
            identity["checkpoint"] = self.facts["checkpoint"]["sha256"]
        return ArrayStore(self.folder / name, identity=identity | dict(settings or {}), renewed_by=(PHOTOS,))

    def _missing(self, store: ArrayStore, photos: Iterable[Photo], described: str) -> Iterator[Photo]:
        known = set(store.names)
        todo = [photo for photo in photos if photo.name not in known]
        for photo in track(todo, description=described, disable=not todo):
            yield photo
            self.stopwatch.tick()

    def _leave_out(self, photo: Photo, of: str, reason: str, metric: str = "all") -> None:
        self.left_out.append({"of": of, "name": photo.name, "metric": metric, "reason": reason})

    @contextlib.contextmanager
    def _timed(self, name: str) -> Iterator[None]:
        gradients = contextlib.nullcontext() if name.startswith("probe_") else torch.no_grad()
        with self.stopwatch.part(name), gradients:
            yield
