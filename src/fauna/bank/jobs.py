"""What ``fauna-bank`` does: folders appear whole, and are left alone when they hold the same already."""

import argparse
import hashlib
import json
import sys
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import fauna
from fauna.bank.census import take_census
from fauna.bank.dataset import pictures_of, training_pictures
from fauna.bank.samples import sample_bank
from fauna.bank.table import TABLE, table_beside, write_table
from fauna.errors import FaunaError
from fauna.evaluation.weights import file_digest, locate
from fauna.io.run_folder import write_json
from fauna.model import FaunaModel
from fauna.pretrained.load import load_model
from fauna.pretrained.shipped import PRETRAINED
from fauna.reconstruct.folders import KEY, is_free, read_result, whole_folder
from fauna.threads import set_threads

SPECIES_SCHEMA = "fauna-bank-species-1"


def sample(given: argparse.Namespace) -> bool:
    """``fauna-bank sample``; whether every sample became an animal."""
    path = _weights(given)
    key = _key(file_digest(path), {"seed": given.seed, "mixtures": given.mixtures})
    if (done := _finished(given, key)) is not None:
        return done["status"] == "ok"
    from fauna.bank.sample_files import write_samples

    samples = sample_bank(_model(given), file_digest(path), mixtures=given.mixtures, seed=given.seed)
    with whole_folder(given.out.expanduser()) as folder:
        whole = write_samples(samples, folder, **{KEY: key})
    print(f"{given.out}: {len(samples.samples)} bodies{'' if whole else ', not all of them animals'}")
    return whole


def species(given: argparse.Namespace) -> bool:
    """``fauna-bank species``."""
    path = _weights(given)
    digest = file_digest(path)
    key = _key(digest, {"between": given.between, "photos": given.photos, "data": given.data})
    if _finished(given, key) is not None:
        return True
    from fauna.plots.bank import draw_bank, species_similarity

    model = _model(given)
    table = table_beside(path, digest) if not given.data else None
    if table is None:
        photos, known = pictures_of(given.data or ["data=zoo"], path, most=given.photos)
        table = take_census(model, photos, trained=known, weights_sha256=digest, report=_progress(len(photos)))
    matrix = species_similarity(table, model.bank.get_parameter("values"))
    with whole_folder(given.out.expanduser()) as folder:
        files = draw_bank(model, table, folder, between=(given.between[0], given.between[1]))
        content = {
            "schema": SPECIES_SCHEMA,
            KEY: key,
            "weights": digest,
            "pictures": len(table.names),
            "species": {kind: {"pictures": int(row.sum()), "trained": table.is_trained(kind)} for kind, row in zip(table.kinds, table.members, strict=True)},
            "similarity": {kind: dict(zip(table.kinds, row.round(4).tolist(), strict=True)) for kind, row in zip(table.kinds, matrix, strict=True)},
            "files": [*(each.name for each in files), "result.json"],
        }  # fmt: skip
        write_json(content, folder / "result.json")
    print(f"{given.out}: {len(table.kinds)} species, {len(table.names)} pictures")
    return True


def table(given: argparse.Namespace) -> bool:
    """``fauna-bank table``."""
    path = _weights(given)
    out = path.parent / TABLE if given.out is None else given.out.expanduser()
    if given.held_out < 0:
        raise FaunaError(f"--held-out: expected a number >= 0, got {given.held_out}; 0 leaves other species out")
    if out.is_dir() or not out.parent.is_dir():
        raise FaunaError(f"--out: expected a file in a folder that exists, got {out}; make the folder or name a file")
    photos, trained = training_pictures(path, given.data, held_out=given.held_out)
    made = take_census(
        _model(given), photos, trained=trained, weights_sha256=file_digest(path), report=_progress(len(photos))
    )
    write_table(made, out)
    print(f"{out}: {sum(trained)} training pictures and {len(photos) - sum(trained)} of other species")
    return True


def _weights(given: argparse.Namespace) -> Path:
    return locate(PRETRAINED if given.checkpoint is None else given.checkpoint)


def _model(given: argparse.Namespace) -> FaunaModel:
    set_threads(given.threads)
    return load_model(given.checkpoint, device=given.device)


def _key(digest: str, facts: Mapping[str, Any]) -> str:
    text = json.dumps({"weights": digest, "fauna": fauna.__version__, **facts}, sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()


def _finished(given: argparse.Namespace, key: str) -> dict[str, Any] | None:
    """What the folder holds, when it is what is asked for.

    Raises:
        FaunaError: when it holds something else.
    """
    out: Path = given.out.expanduser()
    found = read_result(out)
    if found is not None and found.get(KEY) == key:
        print(f"{given.out}: done before")
        return found
    if not is_free(out, overwrite=given.overwrite):
        raise FaunaError(
            f"--out: expected a new folder, got {given.out}, which holds something else; add --overwrite or choose another"
        )
    return None


def _progress(total: int) -> Callable[[int], None]:
    def report(done: int) -> None:
        if sys.stdout.isatty():
            print(f"\r{done} of {total} pictures", end="\n" if done == total else "", flush=True)

    return report
