"""What a command does: which folders it may use, which stages it runs, what it says at the end."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from fauna.errors import FaunaError
from fauna.prepare.locks import only_run
from fauna.prepare.pipeline import KEYPOINT_NAMES, Pipeline
from fauna.prepare.place import manifest_files, place, write_manifest
from fauna.prepare.progress import progress
from fauna.prepare.settings import Settings
from fauna.prepare.steps import IMAGE_STEPS
from fauna.prepare.tables import read_columns
from fauna.prepare.workspace import Workspace, shown, write_file

CLAIM = "set.txt"


def prepare(step: str, source: Path, dest: Path, settings: Settings) -> bool:
    """Run a command.

    Args:
        step: ``all``, ``split`` or one of :data:`fauna.prepare.steps.IMAGE_STEPS`.
        source: the pile of photographs.
        dest: folder of the set.
        settings: numbers and choices.

    Returns:
        Whether the finished set is sound; true while it is not finished.

    Raises:
        FaunaError: for folders that cannot be used, steps that are missing, or when nothing can be used.
    """
    if settings.shard is not None and step in ("all", "split"):
        raise FaunaError(
            f"shard: expected none for fauna-prepare {step}, got {settings.shard}; only steps on photographs have shards"
        )
    workspace = claim(source, dest, settings)
    if settings.shard is not None:  # journals keep two runs from one shard; different shards go side by side
        run_image_step(step, Pipeline(settings, workspace))
        return True
    steps = [name for name in IMAGE_STEPS if name != "features" or settings.features.encoder is not None]
    with only_run(workspace.work, workspace.dest):
        for name in steps if step == "all" else [step] if step != "split" else []:
            run_image_step(name, Pipeline(settings, workspace))
        if step in ("all", "split"):
            finish(workspace, settings)
        if step != "all":
            return True
        from fauna.prepare.check import check_set

        return check_set(dest, settings)


def claim(source: Path, dest: Path, settings: Settings) -> Workspace:
    """The folders of a command.

    Raises:
        FaunaError: when they lie in each other, or DEST holds something else already.
    """
    if not source.exists():
        raise FaunaError(f"SOURCE: expected photographs, got {source}, which does not exist; check the path")
    source, dest = source.resolve(), dest.absolute()
    if dest.name in ("", ".."):
        raise FaunaError(f"DEST: expected the name of a folder, got {dest}; choose another")
    work = dest.with_name(f"{dest.name}.work") if settings.work is None else Path(settings.work).expanduser().absolute()
    for name, folder in (("DEST", dest), ("work", work)):
        if not _is_text(folder):
            raise FaunaError(
                f"{name}: expected a folder whose name is UTF-8 text, got {shown(str(folder))}; choose another"
            )
        if folder.exists() and not folder.is_dir():
            raise FaunaError(f"{name}: expected a folder, got {folder}, which is a file; choose another")
        if source.is_dir() and folder.resolve().is_relative_to(source):
            raise FaunaError(
                f"{name}: expected a folder outside of SOURCE, got {folder}; its own files would be taken for photographs"
            )
        if source.is_relative_to(folder.resolve()):
            raise FaunaError(f"{name}: expected a folder that SOURCE does not lie in, got {folder}; choose another")
    if work.is_relative_to(dest) or dest.is_relative_to(work):
        raise FaunaError(f"work: expected a folder beside DEST, got {work}; the set and the way to it are kept apart")
    known = work / CLAIM
    told = known.read_text(encoding="utf-8", errors="surrogateescape") if known.is_file() else ""
    begun = told.startswith(f"{dest}\n")
    before = told.removeprefix(f"{dest}\n").removesuffix("\n")
    if begun and before != str(source):
        raise FaunaError(
            f"SOURCE: expected {shown(before)}, which {dest} is made from, got {shown(str(source))}; choose another DEST, or write the "
            f"new place into {known} if it was moved"
        )
    if not begun and dest.is_dir() and any(dest.iterdir()) and not manifest_files(dest):
        raise FaunaError(
            f"DEST: expected a new folder or a set of fauna-prepare, got {dest}, which holds something else; choose another"
        )
    if not begun:
        write_file(known, f"{dest}\n{source}\n".encode("utf-8", "surrogateescape"))
    dest.mkdir(parents=True, exist_ok=True)
    return Workspace(source, dest, work)


def _is_text(folder: Path) -> bool:
    """Whether every part of the name is UTF-8: Parquet takes no other."""
    try:
        return bool(str(folder).encode())
    except UnicodeEncodeError:
        return False


def run_image_step(name: str, pipeline: Pipeline) -> None:
    """Bring the shards of a command through a step, and do what follows when all of them are there."""
    shards = pipeline.shards()
    if pipeline.settings.runner == "ray":
        from fauna.prepare.ray_driver import run_on_ray

        tallies = run_on_ray(name, shards, pipeline)
    else:
        with progress(name) as tick:
            tallies = [replace(pipeline, tick=tick).run(name, shard) for shard in shards]
    photos, worked = sum(each.photos for each in tallies), sum(each.worked for each in tallies)
    seconds = sum(each.seconds for each in tallies)
    stage = name
    if pipeline.settings.shard is None and name == "scan":
        pipeline.duplicates()
        stage = "duplicates"
    each = f", {1000 * seconds / worked:.1f} ms each" if worked else ""
    counts = _reasons([pipeline.workspace.table(stage, shard) for shard in shards])
    print(f"{name:<9} {photos:>9,} photographs, {worked:,} worked on{each}; {_account(counts)}", flush=True)
    if pipeline.settings.shard is None:
        _expect_some(counts, pipeline.workspace)
    if name == "mask" and pipeline.settings.shard is None:
        pipeline.expect_known("mask")
    if name == "filter" and pipeline.settings.shard is None:
        from fauna.prepare.sheets import write_sheets

        write_sheets(pipeline.tables("filter"), pipeline.settings, pipeline.workspace)


def finish(workspace: Workspace, settings: Settings) -> None:
    """Split the set, place its files, write its manifest and the report.

    Raises:
        FaunaError: when nothing can be used.
    """
    from fauna.prepare.report import write_report

    pipeline = Pipeline(settings, workspace)
    split = pipeline.split()
    counts = _reasons(pipeline.tables("split"))
    _expect_some(counts, workspace)
    with progress("place") as tick:
        placed = place(lambda: pipeline.rows("split"), split.joint, workspace, tick)
    names = pipeline.keypoint_names()
    if names is not None:
        write_file(workspace.dest / KEYPOINT_NAMES, f"{_json(names)}\n".encode())
    else:
        (workspace.dest / KEYPOINT_NAMES).unlink(missing_ok=True)
    if (
        pipeline.count > 1 or not (workspace.report / "used.png").is_file()
    ):  # shards leave the sheets to whoever sees all
        from fauna.prepare.sheets import write_sheets

        write_sheets(pipeline.tables("filter"), settings, workspace)
    files = write_manifest(pipeline.merged("split"), workspace, counts.total(), settings.manifest_rows)
    write_report(files, settings, workspace)
    print(
        f"split     {counts['ok']:>9,} animals in {shown(str(workspace.dest))}, {placed:,} files placed anew; "
        f"report: {shown(str(workspace.report))}",
        flush=True,
    )


def _account(counts: Counter[str]) -> str:
    rejected = [f"{word} {number:,}" for word, number in counts.most_common() if word != "ok"]
    return f"{counts['ok']:,} animals go on" + (f"; left out: {', '.join(rejected)}" if rejected else "")


def _expect_some(counts: Counter[str], workspace: Workspace) -> None:
    if not counts["ok"]:
        told = ", ".join(f"{word} {number:,}" for word, number in counts.most_common()) or "it is empty"
        raise FaunaError(
            f"{workspace.source}: expected at least one animal that can be used, got none ({told}); see {workspace.work}"
        )


def _reasons(tables: Sequence[Path]) -> Counter[str]:
    """Rows that are ok, and the others by their first reason."""
    counts: Counter[str] = Counter()
    for table in tables:
        for part in read_columns(table, ["status", "reasons"]):
            for status, reasons in zip(part["status"], part["reasons"], strict=True):
                counts["ok" if status == "ok" else reasons[0].split(":")[1]] += 1
    return counts


def _json(names: Sequence[str]) -> str:
    import json

    return json.dumps({"keypoint_names": list(names)}, indent=1)
