"""Shards side by side on a Ray cluster: Ray Data schedules, the work is that of the plain run (extra ``ray``)."""

from collections.abc import Sequence
from dataclasses import asdict
from typing import Any

from fauna.errors import FaunaError
from fauna.prepare.driver import Tally
from fauna.prepare.pipeline import Pipeline
from fauna.prepare.shard import Shard


def run_on_ray(name: str, shards: Sequence[Shard], pipeline: Pipeline) -> list[Tally]:
    """Bring shards through a step; the folders must be seen by every machine of the cluster.

    Stages that look at all shards together are done here first. A task that dies is started again by Ray and goes on where its
    journal ends. Runs on the cluster that ``RAY_ADDRESS`` names, else on this machine.

    Args:
        name: of the step.
        shards: to work on.
        pipeline: settings and folders.

    Raises:
        FaunaError: when Ray is not installed, or as the step raises.
    """
    try:
        import ray  # pyright: ignore[reportMissingImports]  # an optional extra
    except ImportError as error:
        raise FaunaError(
            "runner: expected the package ray for runner=ray, got none; pip install -e '.[ray]' in the checkout"
        ) from error
    if name == "mask":
        pipeline.duplicates()
    if name == "features":
        pipeline.basis()
    if not ray.is_initialized():
        ray.init(log_to_driver=False, include_dashboard=False)
    ray.data.DataContext.get_current().enable_progress_bars = False
    tasks = [
        {"step": name, "index": shard.index, "count": shard.count, "pipeline": pipeline_data(pipeline)}
        for shard in shards
    ]
    done = ray.data.from_items(tasks, override_num_blocks=len(tasks)).map(run_task).take_all()
    return [Tally(each["photos"], each["worked"], each["seconds"]) for each in done]


def pipeline_data(pipeline: Pipeline) -> bytes:
    """What a task needs of a pipeline, in a form that Ray Data's blocks hold."""
    import pickle

    return pickle.dumps((pipeline.settings, pipeline.workspace))


def run_task(task: dict[str, Any]) -> dict[str, Any]:
    """One shard, in a process of the cluster.

    Args:
        task: step, shard, and :func:`pipeline_data`.

    Returns:
        Fields of :class:`fauna.prepare.driver.Tally`.
    """
    import pickle

    settings, workspace = pickle.loads(task["pipeline"])
    tally = Pipeline(settings, workspace).run(task["step"], Shard(task["index"], task["count"]))
    return asdict(tally)
