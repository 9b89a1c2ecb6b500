"""The pose of one photograph's animal on the body of another's: bone rotations mean the same on every body (``docs/skeleton.md``)."""

from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

import torch

from fauna.errors import FaunaError
from fauna.reconstruct.pair import Pair
from fauna.types import Pose, Reconstruction

if TYPE_CHECKING:
    from fauna.export import RiggedAnimal


@dataclass(frozen=True, eq=False)
class PoseTransfer(Pair):
    """Shape, colours and camera of ``first``, bone angles of ``second``."""

    @cached_property
    def out(self) -> Reconstruction:
        """The first reconstruction in the pose of the second; what was rendered of it is left as it was.

        Raises:
            FaunaError: when there are not two animals, or one has no pose.
        """
        first, second = self.fits
        if first.out.skeleton is None or second.out.pose is None:
            raise FaunaError(
                f"{self.name}: expected a model that articulates, got one that does not; use other weights"
            )
        pose = Pose(second.out.pose.angles[:1])
        with torch.no_grad():
            posed = first.model.rig.pose(first.out.base, first.out.instance, first.out.skeleton, pose)
        return replace(first.out, pose=pose, posed=posed)

    def rigged(self) -> "RiggedAnimal":
        """The first animal with skeleton, skin, clips and texture; its clip ``photo`` holds the pose of the second.

        Raises:
            FaunaError: when there are not two animals.
        """
        from fauna.export import rig_reconstruction

        return rig_reconstruction(self.fits[0].model, self.out, name=self.name, texture=self.first.texture)

    def save(self, folder: str | Path) -> Path:
        """Write model, pictures and ``result.json`` into a folder, which is made.

        Returns:
            The folder.
        """
        from fauna.reconstruct.pair_files import write_transfer

        path = Path(folder).expanduser()
        path.mkdir(parents=True, exist_ok=True)
        write_transfer(self, path)
        return path
