"""Loop subdivision (Loop, 1987) as a sparse matrix: low-polygon models become smooth animals, whatever their pose."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int
from scipy.sparse import coo_array, csr_array, eye_array

from fauna.errors import FaunaError

TARGET_FACES = 12_000
"""Faces after refinement: a crop of 256 pixels then shows about one per pixel pair."""
WELD = 1e-5
"""Vertices closer than this share of the model's longest side are one."""


@dataclass(frozen=True)
class Refinement:
    """A fine mesh over a coarse one.

    Attributes:
        fine_from_coarse: (fine, vert) the first rows belong to the places; rows sum to 1; applies to positions at rest and in any pose.
        faces: (face, 3) of the fine mesh.
        corner_faces: (face,) coarse face each fine face lies in.
        chosen: one given vertex of each place.
        coarse_faces: (face, 3) places of the coarse mesh.
        corner_shares: (face, 3, 3) barycentric coordinates, within that coarse face, of the fine face's corners.
    """

    fine_from_coarse: csr_array
    faces: Int[np.ndarray, "face 3"]
    chosen: Int[np.ndarray, " place"]
    coarse_faces: Int[np.ndarray, "coarse 3"]
    corner_faces: Int[np.ndarray, " face"]
    corner_shares: Float[np.ndarray, "face 3 3"]


def weld(verts: Float[np.ndarray, "vert 3"]) -> Int[np.ndarray, " vert"]:
    """Number of the place of each vertex: vertices that differ in their normal or colour only share a place."""
    step = WELD * np.ptp(verts, axis=0).max()
    return np.unique(np.rint(verts / step).astype(np.int64), axis=0, return_inverse=True)[1].reshape(-1)


def refine(
    verts: Float[np.ndarray, "vert 3"], faces: Int[np.ndarray, "face 3"], *, target_faces: int = TARGET_FACES
) -> Refinement:
    """Weld, drop what has no area, subdivide until there are ``target_faces``.

    Control points are moved so that the smooth surface passes near the given vertices: without that, limbs of four or five
    sides would lose a quarter of their girth.

    Args:
        verts: at rest.
        faces: as stored; corners may be split between faces.
        target_faces: least number of fine faces.

    Raises:
        FaunaError: when no triangle has an area.
    """
    place = weld(verts)
    chosen = np.unique(place, return_index=True)[1]  # one vertex of each place stands for all
    joined = place[faces]
    kept = np.flatnonzero((joined != np.roll(joined, 1, axis=1)).all(1))
    mesh, count = joined[kept], len(chosen)
    matrix = csr_array(eye_array(count))
    owner, shares = kept, np.tile(np.eye(3), (len(kept), 1, 1))
    if not len(mesh):
        raise FaunaError("a model expects triangles that have an area, got none; export it again")
    fine = count
    while len(mesh) < target_faces:
        step, mesh, owner, shares = _subdivide(mesh, fine, owner, shares)
        matrix, fine = step @ matrix, len(step.indptr) - 1
    smooth = matrix[:count]
    toward = 2 * csr_array(eye_array(count)) - smooth  # one step of fitting the control points
    pick = coo_array((np.ones(count), (np.arange(count), chosen)), (count, len(verts))).tocsr()
    return Refinement((matrix @ toward @ pick).tocsr(), mesh, chosen, joined[kept], owner, shares)


def _subdivide(
    faces: np.ndarray, count: int, owner: np.ndarray, shares: np.ndarray
) -> tuple[csr_array, np.ndarray, np.ndarray, np.ndarray]:
    """One round: old vertices keep their numbers, edges add new ones."""
    sides = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    across = np.concatenate([faces[:, 2], faces[:, 0], faces[:, 1]])
    edges, edge_of = np.unique(np.sort(sides, axis=1), axis=0, return_inverse=True)
    edge_of = edge_of.reshape(-1)
    uses = np.bincount(edge_of, minlength=len(edges))
    middle = count + edge_of.reshape(3, -1).T  # (face, side)
    a, b, c = faces.T
    ab, bc, ca = middle.T
    children = np.concatenate([np.stack(each, 1) for each in ((a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca))])
    sa, sb, sc = shares[:, 0], shares[:, 1], shares[:, 2]
    sab, sbc, sca = (sa + sb) / 2, (sb + sc) / 2, (sc + sa) / 2
    corners = ((sa, sab, sca), (sab, sb, sbc), (sca, sbc, sc), (sab, sbc, sca))
    fine_shares = np.concatenate([np.stack(each, 1) for each in corners])
    return _stencil(edges, uses, edge_of, across, count), children, np.tile(owner, 4), fine_shares


def _stencil(edges: np.ndarray, uses: np.ndarray, edge_of: np.ndarray, across: np.ndarray, count: int) -> csr_array:
    """Loop's weights; edges that are not between two faces follow the rule for borders."""
    inner = uses == 2
    number = count + np.arange(len(edges))
    along = np.where(inner, 3 / 8, 1 / 2)
    opposite = inner[edge_of]
    rows = [number, number, number[edge_of[opposite]]]
    columns = [edges[:, 0], edges[:, 1], across[opposite]]
    values = [along, along, np.full(int(opposite.sum()), 1 / 8)]
    border_ends = edges[~inner]
    border_degree = np.bincount(border_ends.ravel(), minlength=count)
    degree = np.bincount(edges.ravel(), minlength=count)
    smooth, crease = border_degree == 0, border_degree == 2
    beta = np.where(smooth, np.where(degree == 3, 3 / 16, 3 / (8 * np.maximum(degree, 1))), 0.0)
    own = np.where(smooth, 1 - degree * beta, np.where(crease, 3 / 4, 1.0))
    rows.append(np.arange(count))
    columns.append(np.arange(count))
    values.append(own)
    for start, end in ((0, 1), (1, 0)):
        rows += [edges[:, start], border_ends[:, start]]
        columns += [edges[:, end], border_ends[:, end]]
        values += [beta[edges[:, start]], np.where(crease[border_ends[:, start]], 1 / 8, 0.0)]
    shape = (count + len(edges), count)
    return coo_array((np.concatenate(values), (np.concatenate(rows), np.concatenate(columns))), shape).tocsr()
