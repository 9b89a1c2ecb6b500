"""Rest surface of an individual: flesh by marching cubes, thin parts as swept tubes, eyes as balls, skinning by diffusion."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int
from scipy.sparse import coo_matrix
from skimage.measure import marching_cubes

from fauna.kernels.zoo_raster import cone_distances, merge_fields, union_field, value_noise
from fauna.zoo.body import Body, Cone, Tube

FAR = 1.0
"""Field value where no flesh is near, withers heights."""
RING = 10
"""Vertices around a tube."""
WOOL_LINE = 0.28
"""Height down to which wool grows, withers heights."""
LEG_BLEND = 0.10
"""Length over which a leg's flesh joins the trunk's, withers heights."""


@dataclass(frozen=True)
class Surface:
    """Rest mesh with everything attached to its vertices.

    Attributes:
        verts: (vert, 3) rest frame.
        faces: (face, 3) counter-clockwise seen from outside.
        weights: (vert, bone) skinning weights, rows sum to 1.
        materials: (vert,) index into ``material_names``.
        material_names: names of the materials.
        openness: (vert,) 1 where the sky is free, 0 in a crease.
    """

    verts: Float[np.ndarray, "vert 3"]
    faces: Int[np.ndarray, "face 3"]
    weights: Float[np.ndarray, "vert bone"]
    materials: Int[np.ndarray, " vert"]
    material_names: tuple[str, ...]
    openness: Float[np.ndarray, " vert"]


def build_surface(body: Body, *, cells: int, fleece: float) -> Surface:
    """Mesh a body.

    Args:
        body: skeleton and flesh at rest.
        cells: samples of the distance field along the animal's longest side.
        fleece: height of the curls of the wool, 0 for none.
    """
    bones = {name: i for i, name in enumerate(body.joints)}
    names = tuple(
        dict.fromkeys(
            [c.material for c in body.cones] + [m for t in body.tubes for m in t.materials] + ["eye", "pupil"]
        )
    )
    index = {name: i for i, name in enumerate(names)}
    parts = [_flesh(body, bones, index, cells, fleece)]
    parts += [_tube(tube, bones, index) for tube in body.tubes]
    parts += [_eye(centre, radius, bones, index) for centre, radius in body.eyes]
    offsets = np.cumsum([0] + [len(part[0]) for part in parts[:-1]])
    verts, faces, weights, materials, openness = (
        np.concatenate([part[i] + (offset if i == 1 else 0) for part, offset in zip(parts, offsets, strict=True)])
        for i in range(5)
    )
    return Surface(verts, faces, weights, materials, names, openness)


def vertex_normals(verts: Float[np.ndarray, "vert 3"], faces: Int[np.ndarray, "face 3"]) -> Float[np.ndarray, "vert 3"]:
    """Area-weighted unit normals."""
    a, b, c = (verts[faces[:, i]] for i in range(3))
    crossed = np.cross(b - a, c - a)
    corners = faces.T.ravel()
    normals = np.stack([np.bincount(corners, np.tile(crossed[:, i], 3), len(verts)) for i in range(3)], 1)
    return normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)


def _rows(cones: list[Cone]) -> tuple[np.ndarray, np.ndarray]:
    rows = np.array([[*c.start, *c.end, *c.radii, c.width] for c in cones])
    return rows, np.array([c.blend for c in cones])


def _flesh(
    body: Body, bones: dict[str, int], index: dict[str, int], cells: int, fleece: float
) -> tuple[np.ndarray, ...]:
    rows, _ = _rows(body.cones)
    reach = np.concatenate(
        [
            rows[:, :3] - rows[:, 6:7],
            rows[:, 3:6] - rows[:, 7:8],
            rows[:, :3] + rows[:, 6:7],
            rows[:, 3:6] + rows[:, 7:8],
        ]
    )
    low, high = reach.min(0), reach.max(0)
    cell = float((high - low).max() / cells)
    pad = 3 + int(
        np.ceil(0.25 * max(c.blend for c in body.cones) / cell)
    )  # a smooth union bulges by a quarter of its blend
    origin = low - pad * cell
    shape = tuple(np.ceil((high - low) / cell).astype(int) + 2 * pad)
    field = np.full(shape, FAR)
    union_field(field, origin, cell, *_rows([c for c in body.cones if c.group == 0]))
    trunk = field.copy()
    for group in range(1, 5):
        leg = np.full(shape, FAR)
        union_field(leg, origin, cell, *_rows([c for c in body.cones if c.group == group]))
        merge_fields(leg, trunk, LEG_BLEND)
        np.minimum(field, leg, out=field)
    verts, faces, _, _ = marching_cubes(field, 0.0, gradient_direction="descent")
    verts, faces = verts.astype(float), faces.astype(np.int64)
    openness = _openness(field, verts, vertex_normals(verts, faces), cell)
    verts = verts * cell + origin
    verts[:, 1] = np.maximum(verts[:, 1], 0.0)  # flat soles
    nearest = cone_distances(verts, rows).argmin(1)
    owner = np.array([bones[c.bone] for c in body.cones])[nearest]
    material = np.array([index[c.material] for c in body.cones])[nearest]
    woolly = np.isin(material, [i for name, i in index.items() if name in ("skin", "wool")]) & (verts[:, 1] > WOOL_LINE)
    curls = np.abs(value_noise(verts * 16.0, 2, 1) - 0.5) * woolly
    verts = verts - 4.0 * fleece * curls[:, None] * vertex_normals(verts, faces)
    weights = _diffuse(np.eye(len(bones))[owner], faces, rounds=max(4, round(14 * cells / 100)))
    return verts, faces, weights, material, openness


def _openness(field: np.ndarray, verts: np.ndarray, normals: np.ndarray, cell: float) -> np.ndarray:
    """Free distance along the normal over the distance walked: a cheap ambient occlusion."""
    total = np.zeros(len(verts))
    limit = np.array(field.shape) - 1
    for steps in (3.0, 6.0, 12.0):
        at = np.clip(np.rint(verts + steps * normals).astype(int), 0, limit)
        total += np.clip(field[tuple(at.T)] / (steps * cell), 0, 1)
    return total / 3


def _diffuse(weights: np.ndarray, faces: np.ndarray, rounds: int) -> np.ndarray:
    """Spread bone ownership over the surface: ``rounds`` averages over neighbours."""
    count = len(weights)
    i, j = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]).T
    graph = coo_matrix((np.ones(2 * len(i)), (np.r_[i, j], np.r_[j, i])), (count, count)).tocsr()
    graph.data[:] = 1.0
    degree = np.asarray(graph.sum(1))
    for _ in range(rounds):
        weights = 0.5 * weights + 0.5 * (graph @ weights) / np.maximum(degree, 1)
    return weights / weights.sum(1, keepdims=True)


def _tube(tube: Tube, bones: dict[str, int], index: dict[str, int]) -> tuple[np.ndarray, ...]:
    path, count = tube.path, len(tube.path)
    tangent = np.gradient(path, axis=0)
    tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
    wide = tube.wide - (tangent @ tube.wide)[:, None] * tangent
    wide /= np.linalg.norm(wide, axis=1, keepdims=True)
    across = np.cross(tangent, wide)
    angle = 2 * np.pi * np.arange(RING) / RING
    ring = (
        np.cos(angle)[:, None] * (tube.axes[:, :1] * wide)[:, None]
        + np.sin(angle)[:, None] * (tube.axes[:, 1:] * across)[:, None]
    )
    cap = 0.5 * tube.axes.min(1)[[0, -1], None] * tangent[[0, -1]] * [[-1], [1]]
    verts = np.concatenate([(path[:, None] + ring).reshape(-1, 3), path[[0, -1]] + cap])
    a = (np.arange(count - 1)[:, None] * RING + np.arange(RING)).ravel()
    b = (np.arange(count - 1)[:, None] * RING + (np.arange(RING) + 1) % RING).ravel()
    first, turn = np.arange(RING), (np.arange(RING) + 1) % RING
    last = (count - 1) * RING
    faces = np.concatenate([
        np.stack([a, b, b + RING], 1), np.stack([a, b + RING, a + RING], 1),
        np.stack([np.full(RING, count * RING), turn, first], 1),
        np.stack([np.full(RING, count * RING + 1), last + first, last + turn], 1),
    ]).astype(np.int64)  # fmt: skip
    spot = np.linspace(0, len(tube.bones) - 1e-6, count) - 0.5 if len(tube.bones) > 1 else np.zeros(count)
    weights = np.zeros((count, len(bones)))
    for k, name in enumerate(tube.bones):
        weights[:, bones[name]] = np.clip(1 - np.abs(np.clip(spot, 0, len(tube.bones) - 1) - k), 0, 1)
    materials = np.resize([index[m] for m in tube.materials], count)  # one per ring, or one for all
    rows = np.concatenate([np.repeat(np.arange(count), RING), [0, count - 1]])
    return verts, faces, weights[rows], materials[rows], np.full(len(rows), 0.85)


def _eye(centre: np.ndarray, radius: float, bones: dict[str, int], index: dict[str, int]) -> tuple[np.ndarray, ...]:
    """A ball looking to its side and forward."""
    sign = np.sign(centre[0])
    ring, stack = 12, 9
    theta, phi = np.pi * np.arange(1, stack) / stack, 2 * np.pi * np.arange(ring) / ring
    ball = np.stack([
        np.outer(np.cos(theta), np.ones(ring)), np.outer(np.sin(theta), np.cos(phi)), np.outer(np.sin(theta), np.sin(phi)),
    ], -1).reshape(-1, 3)  # fmt: skip
    ball = np.concatenate([ball, [[1, 0, 0], [-1, 0, 0]]])
    verts = centre + radius * ball * [sign, 1, 1]
    a = (np.arange(stack - 2)[:, None] * ring + np.arange(ring)).ravel()
    b = (np.arange(stack - 2)[:, None] * ring + (np.arange(ring) + 1) % ring).ravel()
    first, turn, last = np.arange(ring), (np.arange(ring) + 1) % ring, (stack - 2) * ring
    top = (stack - 1) * ring
    faces = np.concatenate([
        np.stack([a, a + ring, b + ring], 1), np.stack([a, b + ring, b], 1),
        np.stack([np.full(ring, top), first, turn], 1), np.stack([np.full(ring, top + 1), last + turn, last + first], 1),
    ]).astype(np.int64)  # fmt: skip
    faces = faces if sign > 0 else faces[:, ::-1]
    weights = np.zeros((len(verts), len(bones)))
    weights[:, bones["head"]] = 1.0
    material = np.where(ball @ [0.85, 0.0, 0.53] > 0.55, index["pupil"], index["eye"])
    return verts, faces, weights, material, np.ones(len(verts))
