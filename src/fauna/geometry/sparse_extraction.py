"""Zero level of a signed distance on a BCC lattice while evaluating it near the surface only.

1. Blocks of cells whose centre value rules a zero out (Lipschitz bound) are dropped, the others split, down to cells.
2. Lattice values are computed around the cells that are left.
3. Flood: a cell sharing a face with an active one is activated when the surface passes through that face. This repairs
   every violation of the bound on a component that was found at all.
4. Marching tetrahedra on the crossed tetrahedra around active cells.
5. Only the end points of edges that carry a vertex are evaluated with gradient.

Everything happens at x >= 0; the other half is the mirror image. Steps 1 to 3 are in ``narrow_band``.
"""

from dataclasses import dataclass

import torch
from jaxtyping import Float, Int
from torch import Tensor

from fauna.errors import FaunaError
from fauna.geometry.lattice import BCCLattice, ExplicitLattice, explicit_lattice, face_ring, face_tets
from fauna.geometry.marching_tets import TET_EDGES, interpolate_zeros, marching_tets, tet_triangles
from fauna.geometry.narrow_band import SDF, NarrowBand

RETRY_LIPSCHITZ = 4.0
"""Bound of the second attempt when the first one finds nothing."""


class EmptyMeshError(FaunaError):
    """The signed distance has no zero level on the lattice."""


@dataclass(frozen=True)
class ExtractionStats:
    """What an extraction cost.

    Attributes:
        evaluations: points evaluated without gradient.
        grad_evaluations: points evaluated with gradient.
        flood_rounds: rounds in which the flood activated cells; much above 3 the signed distance is not one.
        retries: 1 when the first bound found nothing.
    """

    evaluations: int
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
    return marching_tets(points, lattice.close(explicit.points, sdf(points)), explicit.tets)


def extract_sparse(
    sdf: SDF,
    lattice: BCCLattice,
    offset: Float[Tensor, "3"],
    *,
    lipschitz: float,
    coarse_cells: int,
    coarse_sdf: SDF | None = None,
    coarse_margin: float = 0.0,
) -> tuple[Float[Tensor, "vert 3"], Int[Tensor, "face 3"], ExtractionStats]:
    """Zero level of ``sdf`` on the lattice shifted by ``offset``, exactly mirror symmetric.

    Vertices of x >= 0 come first, ordered by edge, then the mirror images of those off the plane. Mirrored faces are
    mirror images up to the diagonals of quads that straddle the plane. The mesh is closed, also at the border.

    Args:
        sdf: differentiable in whatever it closes over; must be even in x.
        lattice: where to look.
        offset: shift of the lattice, world units; x must be 0. Its dtype and device are those of the mesh.
        lipschitz: assumed bound of the gradient norm.
        coarse_cells: number of blocks along the longest axis to start from, at least.
        coarse_sdf: cheaper approximation for blocks larger than a cell.
        coarse_margin: largest error of ``coarse_sdf``, world units.

    Raises:
        FaunaError: when ``offset`` moves the mirror plane.
        EmptyMeshError: when the lattice sees no surface, even with a bound of 4.
    """
    if float(offset[0]) != 0.0:
        raise FaunaError(f"lattice offset along x must be 0 to keep the mesh symmetric, got {float(offset[0])}")
    evaluations = 0
    for retry, bound in enumerate((lipschitz, max(lipschitz, RETRY_LIPSCHITZ))):
        with torch.no_grad():
            field = NarrowBand(sdf, lattice, offset)
            field.find_cells(bound, coarse_cells, coarse_sdf or sdf, coarse_margin if coarse_sdf else 0.0)
            rounds = field.flood()
            surface = _march(field)
        evaluations += field.evaluations
        if surface is not None:
            verts, faces, count = _attach_gradient(sdf, lattice, offset, field, surface)
            return verts, faces, ExtractionStats(evaluations, count, rounds, retry)
    raise EmptyMeshError(
        f"expected a surface inside the box of half extents {lattice.box}, found none; "
        "check the ellipsoid prior, lower the learning rate or enlarge the box"
    )


@dataclass(frozen=True)
class _Surface:
    """Triangles of the half as places of their vertices.

    Attributes:
        ends: (vert, 2) lattice points at the ends of each vertex's edge, x >= 0.
        faces: (face, 3) triangles at x >= 0.
        straddling: (face, 3) triangles across the plane, ``vert + i`` standing for the mirror image of vertex ``i``.
    """

    ends: Tensor
    faces: Tensor
    straddling: Tensor


def _march(field: NarrowBand) -> _Surface | None:
    """Triangles of the tetrahedra touching active cells; ``None`` when there are none."""
    one_sided, straddling = _mixed_tets(field)
    num_points = len(field.known)
    keys = _edge_keys(one_sided, num_points)
    faces, _ = tet_triangles(field.inside[one_sided], keys)
    keys = _edge_keys(straddling, num_points)
    keys[:, 1:3] += num_points**2  # edges from the mirror image of a centre to the two corners on the plane
    crossing, _ = tet_triangles(field.inside[straddling], keys)

    places = torch.cat((faces, crossing))
    if len(places) == 0:
        return None
    keys, vertex = torch.unique(places % num_points**2, return_inverse=True)
    vertex = vertex + len(keys) * (places // num_points**2)
    ends = torch.stack((keys // num_points, keys % num_points), dim=1)
    return _Surface(ends, vertex[: len(faces)], vertex[len(faces) :])


def _edge_keys(tets: Tensor, num_points: int) -> Tensor:
    """(tet, 6) one number per edge, ordered by (lower, higher) end."""
    first, second = (tets[:, list(ends)] for ends in zip(*TET_EDGES, strict=True))
    return torch.minimum(first, second) * num_points + torch.maximum(first, second)


def _mixed_tets(field: NarrowBand) -> tuple[Tensor, Tensor]:
    """(tet, 4) lattice points of crossed tetrahedra touching active cells: those at x >= 0, those across the plane.

    The latter start with the centre at x > 0 standing for its mirror image, then the centre itself.
    """
    lattice = field.lattice
    active = lattice.cell_index(field.active.nonzero()[:, 0])
    one_sided = []
    for axis in range(3):
        step = torch.eye(3, dtype=torch.long, device=active.device)[axis]
        below = active - step
        below = below[(below[:, axis] >= 0)]
        below = below[~field.active[lattice.cell_number(below)]]
        low = torch.cat((active[active[:, axis] + 1 < lattice.shape[axis]], below))
        one_sided.append(face_tets(lattice, low, low + step, face_ring(axis).to(step.device) + step))
    at_plane = active[active[:, 0] == 0]
    straddling = face_tets(lattice, at_plane, at_plane, face_ring(0).to(active.device))
    return _mixed(field, torch.cat(one_sided)), _mixed(field, straddling)


def _mixed(field: NarrowBand, tets: Tensor) -> Tensor:
    inside = field.inside[tets]
    return tets[inside.any(1) & ~inside.all(1)]


def _attach_gradient(
    sdf: SDF, lattice: BCCLattice, offset: Tensor, field: NarrowBand, surface: _Surface
) -> tuple[Tensor, Tensor, int]:
    """Evaluate the end points with gradient, interpolate and mirror: vertices, faces, number of points."""
    points, row = torch.unique(surface.ends, return_inverse=True)
    positions = lattice.positions(points, offset)
    values = lattice.close(points, sdf(positions))
    half = interpolate_zeros(positions[row], values[row], field.inside[surface.ends[:, 0]])

    off_plane = (lattice.half_steps(surface.ends.flatten())[:, 0].view(-1, 2) > 0).any(dim=1)
    count = len(half)
    image = torch.where(off_plane, count - 1 + off_plane.cumsum(0), torch.arange(count, device=half.device))
    verts = torch.cat((half, half[off_plane] * half.new_tensor((-1.0, 1.0, 1.0))))
    both = torch.cat((torch.arange(count, device=half.device), image))
    faces = torch.cat((surface.faces, both[surface.straddling], image[surface.faces].flip(1)))
    return verts, faces, len(points)
