"""Base shape as the zero level of a learned signed distance, extracted sparsely on a BCC lattice."""

from collections.abc import Sequence

import torch
from jaxtyping import Float
from torch import Tensor

from fauna.errors import FaunaError
from fauna.geometry.half_turn import half_turn
from fauna.geometry.lattice import BCCLattice, cell_size_of
from fauna.geometry.marching_tets import drop_small_components, face_components
from fauna.geometry.sparse_extraction import RETRY_LIPSCHITZ, ExtractionStats, extract_sparse
from fauna.shape.base import Shape
from fauna.shape.sdf_mlp import SDFField, SDFNetwork
from fauna.types import BaseShape


class SDFMesh(Shape):
    """Signed distance network plus marching tetrahedra.

    Args:
        sdf: the signed distance network.
        grid_resolution: resolution in the paper's units (256); a cell has ``grid_scale / (0.40625 * grid_resolution)``.
        grid_scale: edge of the paper's cube, world units.
        half_extents: half edges of the lattice box, world units; ``None`` for the whole cube.
        jitter: largest shift of the lattice along y and z during training, in cells.
        lipschitz: bound of the gradient norm assumed when blocks are discarded.
        coarse_cells: blocks along the longest axis to start from.
        coarse_bf16: evaluate in bfloat16 without gradient and repeat in full precision where that leaves a sign open.
        min_component_fraction: components with fewer than this share of the faces are dropped; 0 keeps all.
        eikonal_points: uniform points, and as many near the surface, of the Eikonal term.
        eikonal_spread: largest distance of the latter to a vertex per axis, world units.

    Raises:
        FaunaError: when a number is out of range.
    """

    def __init__(
        self,
        *,
        sdf: SDFNetwork,
        grid_resolution: int,
        grid_scale: float,
        half_extents: Sequence[float] | None,
        jitter: float,
        lipschitz: float,
        coarse_cells: int,
        coarse_bf16: bool,
        min_component_fraction: float,
        eikonal_points: int,
        eikonal_spread: float,
    ) -> None:
        super().__init__()
        if not 0 <= min_component_fraction <= 1:
            raise FaunaError(f"shape.min_component_fraction must be in [0, 1], got {min_component_fraction}")
        self.sdf = sdf
        self.grid_scale = grid_scale
        x, y, z = half_extents or [grid_scale / 2] * 3
        self.half_extents = (float(x), float(y), float(z))
        self.jitter = jitter
        self.lipschitz = lipschitz
        self.coarse_cells = coarse_cells
        self.coarse_bf16 = coarse_bf16
        self.min_component_fraction = min_component_fraction
        self.eikonal_points = eikonal_points
        self.eikonal_spread = eikonal_spread
        self.set_resolution(grid_resolution)

    def set_resolution(self, grid_resolution: int) -> None:
        """Change the lattice from the next mesh on.

        Raises:
            FaunaError: when the resolution leaves the box without a whole cell.
        """
        cell_size = cell_size_of(self.grid_scale, max(grid_resolution, 1))
        if grid_resolution < 1 or cell_size > min(self.half_extents):
            raise FaunaError(
                f"shape.grid_resolution {grid_resolution} gives cells of {cell_size:.3g}, larger than the box "
                f"half extents {self.half_extents}; raise it"
            )
        self.grid_resolution = grid_resolution
        self.lattice = BCCLattice(cell_size=cell_size, half_extents=self.half_extents)

    def extract(
        self, embedding: Float[Tensor, " value_chan"], generator: torch.Generator | None
    ) -> tuple[BaseShape, ExtractionStats]:
        """Rest mesh and extraction cost; see :meth:`Shape.extract`.

        Raises:
            EmptyMeshError: when the signed distance has no zero level in the box.
        """
        base, stats = self._extract(self.sdf(embedding), self._offset(generator))
        verts, faces = drop_small_components(base.verts, base.faces, self.min_component_fraction)
        return BaseShape(verts, faces), stats

    def eikonal(
        self, embedding: Float[Tensor, " value_chan"], base: BaseShape, generator: torch.Generator
    ) -> Float[Tensor, ""]:
        """``mean((|grad sdf| - 1)**2)`` over uniform points of the box and points near the surface."""
        box = self.sdf.radii.new_tensor(self.lattice.box)
        uniform = self._signed_uniform(generator, self.eikonal_points) * box
        picks = torch.randint(len(base.verts), (self.eikonal_points,), generator=generator).to(box.device)
        spread = self._signed_uniform(generator, self.eikonal_points) * self.eikonal_spread
        near = half_turn(base.verts.detach()[picks], self.turned) + spread
        gradient = self.sdf(embedding.detach()).gradient(torch.cat((uniform, near)))
        return (gradient.norm(dim=1) - 1).square().mean()

    @torch.no_grad()
    def audit(self, embedding: Float[Tensor, " value_chan"], generator: torch.Generator | None) -> int:
        """Components missed by the Lipschitz bound, against a bound of 4 in full precision on the same lattice."""
        field, offset = self.sdf(embedding), self._offset(generator)
        quick, _ = self._extract(field, offset)
        verts, faces, _ = extract_sparse(
            field,
            self.lattice,
            offset,
            lipschitz=max(self.lipschitz, RETRY_LIPSCHITZ),
            coarse_cells=self.coarse_cells,
        )
        return _count_components(verts, faces) - _count_components(quick.verts, quick.faces)

    def _extract(self, field: SDFField, offset: Tensor) -> tuple[BaseShape, ExtractionStats]:
        verts, faces, stats = extract_sparse(
            field,
            self.lattice,
            offset,
            lipschitz=self.lipschitz,
            coarse_cells=self.coarse_cells,
            approximation=field.coarse if self.coarse_bf16 else None,
        )
        return BaseShape(verts, faces), stats

    def _offset(self, generator: torch.Generator | None) -> Tensor:
        """(3,) lattice shift, 0 along x so that the mesh stays symmetric."""
        offset = torch.zeros_like(self.sdf.radii)
        if generator is not None:
            offset[1:] = self._signed_uniform(generator, 1)[0, 1:] * (self.jitter * self.lattice.cell_size)
        return offset

    def _signed_uniform(self, generator: torch.Generator, count: int) -> Tensor:
        """(count, 3) uniform in [-1, 1), drawn on the CPU so that devices agree."""
        return torch.rand(count, 3, generator=generator).to(self.sdf.radii) * 2 - 1


def _count_components(verts: Tensor, faces: Tensor) -> int:
    return int(face_components(faces, len(verts)).max()) + 1
