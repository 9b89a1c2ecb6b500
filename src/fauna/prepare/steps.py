"""What a step is. Everything that runs steps (one process, shards, Ray) goes by this and nothing else."""

from abc import ABC, abstractmethod
from pathlib import Path

from fauna.prepare.record import Rows
from fauna.prepare.settings import Settings
from fauna.prepare.workspace import Workspace

IMAGE_STEPS = ("scan", "mask", "crop", "filter", "features")
"""The steps that work on one photograph at a time, in their order."""


class Step(ABC):
    """A step that works on one photograph at a time: a pure function of its rows and the files they name.

    A step is made where it runs, from settings and the workspace, and may hold weights. It never looks at other photographs.
    """

    name: str

    @property
    @abstractmethod
    def key(self) -> str:
        """Digest of whatever decides the outcome beside the rows: settings of this step, weights. Work done with another key is done again."""

    @abstractmethod
    def __call__(self, rows: Rows) -> Rows:
        """The rows of the photograph after the step.

        Rows that are not ok come in and go out unchanged. Files are complete (:func:`fauna.prepare.workspace.write_file`) before
        this returns; what is returned is committed by the caller. A picture that cannot be used becomes ``row.rejected(...)``;
        anything raised is a defect or a condition of the machine (full disk) and ends the run.
        """

    def stamp(self, rows: Rows) -> str:
        """What a repetition depends on beside the rows, told without reading: sizes and times of files."""
        return ""

    @abstractmethod
    def outputs(self, rows: Rows) -> list[Path]:
        """Files that a committed photograph must have."""

    def intact(self, rows: Rows) -> bool:
        """Whether the files of a committed photograph are what was made; where one is missing or changed it is done again."""
        return all(_is_whole(path) for path in self.outputs(rows))


def _is_whole(path: Path) -> bool:
    """Whether a file is there and not empty, as after a power cut."""
    try:
        return path.stat().st_size > 0
    except OSError:
        return False


def build_step(name: str, settings: Settings, workspace: Workspace) -> Step:
    """The step of a name in :data:`IMAGE_STEPS`; heavy imports happen here."""
    if name == "scan":
        from fauna.prepare.scan import ScanStep

        return ScanStep(settings=settings, workspace=workspace)
    if name == "mask":
        from fauna.prepare.mask import MaskStep

        return MaskStep(settings=settings, workspace=workspace)
    if name == "crop":
        from fauna.prepare.crop import CropStep

        return CropStep(settings=settings, workspace=workspace)
    if name == "filter":
        from fauna.prepare.filter import FilterStep

        return FilterStep(settings=settings, workspace=workspace)
    if name == "features":
        from fauna.prepare.features import FeatureStep

        return FeatureStep(settings=settings, workspace=workspace)
    raise ValueError(f"no step is called {name}")
