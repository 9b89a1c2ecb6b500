"""Zero level of a signed distance on a BCC lattice while evaluating it near the surface only.

1. Blocks of cells whose centre value rules a zero out (Lipschitz bound) are dropped, the others split, down to cells.
2. Signs are computed at the lattice points around the cells that are left.
3. Flood: a cell sharing a face with an active one is activated when the surface passes through that face. This repairs
   every violation of the bound on a component that was found at all.
4. Marching tetrahedra on the crossed tetrahedra around active cells.
5. Only the end points of edges that carry a vertex are evaluated with gradient.

Steps 1 to 3 need signs, not values: an approximation, say in half precision, serves wherever it exceeds its error,
which is measured at some points of each field. Step 5 is exact and sees a wrong sign at any of its points; then all is
done again without the approximation.

Everything happens at x >= 0; the other half is the mirror image. Steps 1 to 3 are in ``narrow_band``.
"""

from dataclasses import dataclass

import torch
from jaxtyping import Float, Int
from torch import Tensor

from fauna.errors import FaunaError
from fauna.geometry.band_march import HalfSurface, march
from fauna.geometry.band_ops import half_steps
from fauna.geometry.lattice import BCCLattice, ExplicitLattice, explicit_lattice
from fauna.geometry.marching_tets import interpolate_zeros, marching_tets
from fauna.geometry.narrow_band import SDF, NarrowBand, SignSource, in_chunks

RETRY_LIPSCHITZ = 4.0
"""Bound of the second attempt when the first one finds nothing."""

ROUND_OFF = 1e-4
"""Cells by which a value may contradict its sign because it was evaluated in other company."""


class EmptyMeshError(FaunaError):
    """The signed distance has no zero level on the lattice."""


@dataclass(frozen=True)
class ExtractionStats:
    """What an extraction cost.

    Attributes:
        evaluations: points evaluated without gradient.
        exact_evaluations: those of them for which an approximation did not do.
        grad_evaluations: points evaluated with gradient.
        flood_rounds: rounds in which the flood activated cells; much above 3 the signed distance is not one.
        retries: 1 when the first bound found nothing or the approximation gave a wrong sign.
    """

    evaluations: int
    exact_evaluations: int
    grad_evaluations: int
    flood_rounds: int
    retries: int


def extract_dense(
    sdf: SDF, lattice: BCCLattice, offset: Float[Tensor, "3"], explicit: ExplicitLattice | None = None
) -> tuple[Float[Tensor, "vert 3"], Int[Tensor, "face 3"]]:
    """The same mesh from every lattice point of both halves, with gradient: the reference, slow and large.

    Args:
        sdf: as in :func:`extract_sparse`.
        lattice: where to look.
        offset: shift of the lattice, world units.
        explicit: ``explicit_lattice(lattice)`` when it is at hand.
    """
    explicit = explicit or explicit_lattice(lattice)
    points = explicit.positions(lattice, offset)
    values = lattice.close(lattice.half_steps(explicit.points), in_chunks(sdf, points))
    return marching_tets(points, values, explicit.tets)


def extract_sparse(
    sdf: SDF,
    lattice: BCCLattice,
    offset: Float[Tensor, "3"],
    *,
    lipschitz: float,
    coarse_cells: int,
    approximation: SDF | None = None,
) -> tuple[Float[Tensor, "vert 3"], Int[Tensor, "face 3"], ExtractionStats]:
    """Zero level of ``sdf`` on the lattice shifted by ``offset``, exactly mirror symmetric.

    Vertices of x >= 0 come first, ordered by the ends of their edges, then the mirror images of those off the plane.
    Mirrored faces are mirror images up to the diagonals of quads that straddle the plane. The mesh is closed, also at
    the border.

    Args:
        sdf: differentiable in whatever it closes over; must be even in x.
        lattice: where to look.
        offset: shift of the lattice, world units; x must be 0. Its dtype and device are those of the mesh.
        lipschitz: assumed bound of the gradient norm.
        coarse_cells: number of blocks along the longest axis to start from, at least.
        approximation: of ``sdf``, cheaper; used without gradient and only where it decides the sign.

    Raises:
        FaunaError: when ``offset`` moves the mirror plane.
        EmptyMeshError: when the lattice sees no surface, even with a bound of 4.
    """
    if float(offset[0]) != 0.0:
        raise FaunaError(f"lattice offset along x must be 0 to keep the mesh symmetric, got {float(offset[0])}")
    evaluations = exact = 0
    for retry, (bound, cheap) in enumerate(((lipschitz, approximation), (max(lipschitz, RETRY_LIPSCHITZ), None))):
        with torch.no_grad():
            source = SignSource(sdf, cheap, offset.new_zeros(()))
            band = NarrowBand(source, lattice, offset)
            band.find_cells(bound, coarse_cells)
            rounds = band.flood()
            surface = march(band)
        evaluations, exact = evaluations + source.evaluations, exact + source.exact_evaluations
        mesh = None if surface is None else _attach_gradient(sdf, band, surface)
        if mesh is not None:
            verts, faces, count = mesh
            return verts, faces, ExtractionStats(evaluations, exact, count, rounds, retry)
    raise EmptyMeshError(
        f"expected a surface inside the box of half extents {lattice.box}, found none; "
        "check the ellipsoid prior, lower the learning rate or enlarge the box"
    )


def _attach_gradient(sdf: SDF, band: NarrowBand, surface: HalfSurface) -> tuple[Tensor, Tensor, int] | None:
    """Evaluate the end points with gradient, interpolate and mirror: vertices, faces, number of points.

    ``None`` when values contradict the signs that an approximation gave.
    """
    lattice = band.lattice
    used = torch.zeros_like(band.known)
    used[surface.ends] = True
    steps = half_steps(used.nonzero()[:, 0], band.bricks)
    row = (used.cumsum(0) - 1)[surface.ends]
    positions = lattice.embed(steps, band.offset)
    values = lattice.close(steps, in_chunks(sdf, positions)).index_select(0, row.flatten()).view(-1, 2)
    if band.source.approximate and bool(
        (values.detach() * values.new_tensor((-1.0, 1.0)) > ROUND_OFF * lattice.cell_size).any()
    ):
        return None
    half = interpolate_zeros(positions[row], values)

    off_plane = (steps[:, 0] > 0)[row].any(dim=1)
    mirrored = off_plane.nonzero()[:, 0]
    place = torch.arange(len(half), device=half.device)
    image = torch.where(off_plane, len(half) - 1 + off_plane.cumsum(0), place)
    verts = torch.cat((half, half.index_select(0, mirrored) * half.new_tensor((-1.0, 1.0, 1.0))))
    both = torch.cat((place, image))
    faces = torch.cat((surface.faces, both[surface.straddling], image[surface.faces].flip(1)))
    return verts, faces, len(steps)
