"""From one photograph's animal to another's, in steps (supplement of the paper, "Shape Interpolation between Instances")."""

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import torch
from trimesh.remesh import subdivide

from fauna.plots.bodies import Look
from fauna.reconstruct.coat import Coat, coat_of, crossfaded, in_box, painted
from fauna.reconstruct.pair import Pair
from fauna.reconstruct.settings import MOST_FRAMES, check_range
from fauna.reconstruct.traits import Body, embody, mixed, resting, rigged, traits_of

if TYPE_CHECKING:
    from fauna.export import RiggedAnimal


@dataclass(frozen=True, eq=False, kw_only=True)
class Morph(Pair):
    """Bodies between two photographs' animals: shape code, deformation feature and pose are mixed, colours cross-faded.

    Every step is cut from the signed distance anew, so steps share no triangles; each is a body of its own, with a skeleton found on it.

    Attributes:
        frames: steps from the first animal to the second, both counted.
    """

    frames: int

    def __post_init__(self) -> None:
        super().__post_init__()
        check_range("morph", self.frames, 2, MOST_FRAMES)

    @property
    def shares(self) -> list[float]:
        """Share of the second animal in each frame, 0 to 1."""
        return [frame / (self.frames - 1) for frame in range(self.frames)]

    def body(self, share: float) -> Body:
        """The body at a share of the second animal; 0 and 1 are the photographs' own.

        Raises:
            FaunaError: when there are not two animals.
        """
        first, second = self.fits
        return embody(first.model, mixed(traits_of(first.out), traits_of(second.out), share))

    def base(self, share: float) -> Body:
        """The base shape at a share of the second animal: neither deformed nor posed."""
        first, second = self.fits
        return embody(first.model, resting(torch.lerp(first.out.code, second.out.code, share)))

    def rigged(self, share: float) -> "RiggedAnimal":
        """The animal at a share of the second one, with skeleton, skin, clips and, unless the settings leave it out, texture."""
        body, settings = self.body(share), self.first.settings
        size = min(settings.output.texture_size, settings.morph.texture_size)
        renderer = self.fits[0].model.renderer
        texture = painted(renderer, body, *self._coats, share, size=size) if size else None
        places = in_box(body.base.verts, body.base.verts)
        colours = None if size else crossfaded(*self._coats, share, places)
        name = f"{self.name}_{100 * share:03.0f}"
        return rigged(self.fits[0].model, body, name=name, texture=texture, colours=colours)

    def look(self, share: float) -> Look:
        """The posed body in its colours, on the ground; its mesh is subdivided once, for colours finer than its triangles."""
        body = self.body(share)
        corners = torch.cat([body.posed.verts[0], body.base.verts], dim=1).detach().cpu().numpy()
        finer: Any = subdivide(
            corners[:, :3], body.base.faces.cpu().numpy(), vertex_attributes={"rest": corners[:, 3:]}
        )
        posed, faces, rest = finer[0], finer[1], np.asarray(finer[2]["rest"])
        places = in_box(torch.from_numpy(rest), body.base.verts.cpu())
        colours = torch.from_numpy(crossfaded(*self._coats, share, places)).float()
        return Look(torch.from_numpy(posed).float(), torch.from_numpy(faces), colours).grounded()

    @cached_property
    def _coats(self) -> tuple[Coat, Coat]:
        first, second = self.fits
        return coat_of(self.first, first), coat_of(self.second, second)

    def save(self, folder: str | Path) -> Path:
        """Write contact sheet, film, key frames as GLB and ``result.json`` into a folder, which is made.

        Returns:
            The folder.
        """
        from fauna.reconstruct.pair_files import write_morph

        path = Path(folder).expanduser()
        path.mkdir(parents=True, exist_ok=True)
        write_morph(self, path)
        return path
