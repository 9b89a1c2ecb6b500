"""Corresponding points on meshes of different topology: same bone, same side, nearest in the bone's own coordinates.

Reconstructions of different photos have surfaces of their own, so a vertex index means nothing across photos. What does carry over
is the skeleton: a place is named by its bone, its side of the mirror plane and its position in the bone's frame in bone lengths.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Float, Int

from fauna.evaluation.prediction import Prediction
from fauna.kernels.closest_point import nearest_in_group

MIDDLE = 1e-6
"""Half width of the mirror plane, which belongs to both sides, in half extents of the base shape."""
LEFT, RIGHT, BOTH = 0, 1, 2
SIDES = 3


@dataclass(frozen=True)
class Places:
    """Points of a surface, described so that they can be found on another one.

    Attributes:
        bone: strongest bone, -1 without bones.
        side: ``LEFT`` (x > 0), ``RIGHT`` or ``BOTH`` (on the mirror plane).
        local: position in the bone's frame, bone lengths.
        general: position in the base shape, scaled to [-1, 1] by its bounding box; for points whose bone is missing elsewhere.
    """

    bone: Int[np.ndarray, " place"]
    side: Int[np.ndarray, " place"]
    local: Float[np.ndarray, "place 3"]
    general: Float[np.ndarray, "place 3"]

    def rows(self, index: Int[np.ndarray, " new"]) -> "Places":
        """Gather places by index."""
        return Places(self.bone[index], self.side[index], self.local[index], self.general[index])


def vertex_places(prediction: Prediction) -> Places:
    """The place of every vertex. Without bones the position in the base shape's box stands for the local one."""
    canonical = prediction.canonical.astype(np.float64)
    low, high = canonical.min(axis=0), canonical.max(axis=0)
    half = np.maximum(0.5 * (high - low), 1e-12)
    general = (canonical - 0.5 * (low + high)) / half
    x = canonical[:, 0]
    side = np.where(np.abs(x) <= MIDDLE * half[0], BOTH, np.where(x > 0, LEFT, RIGHT))
    bone = prediction.bone.astype(np.int64)
    local = np.where(bone[:, None] < 0, general, prediction.local.astype(np.float64))
    return Places(bone, side, local, general)


@dataclass(frozen=True)
class SurfaceIndex:
    """The triangles of a mesh by bone and side, ready for :meth:`find`.

    Attributes:
        faces: the mesh's triangles, followed by vertices that belong to no triangle of their bone, as (v, v, v).
        places: of the vertices.
    """

    faces: Int[np.ndarray, "element 3"]
    places: Places

    @classmethod
    def of(cls, prediction: Prediction) -> "SurfaceIndex":
        """Index the surface of a prediction."""
        places, faces = vertex_places(prediction), prediction.faces.astype(np.int64)
        inside = _equal(places.bone[faces])
        lonely = np.ones(len(places.bone), bool)
        lonely[faces[inside]] = False
        return cls(np.concatenate([faces, np.flatnonzero(lonely)[:, None].repeat(3, axis=1)]), places)

    def find(self, wanted: Places) -> tuple[Int[np.ndarray, "place 3"], Float[np.ndarray, "place 3"]]:
        """The nearest point of this surface to each place, among the triangles that lie in the same bone and on the same side.

        Where the bone has nothing on that side, the nearest point in the bounding box of the base shape on the same side; where
        the side has nothing either, of the whole surface.

        Returns:
            Vertex indices and barycentrics of the points.
        """
        corner = np.zeros((len(wanted.bone), 3), np.int64)
        weights = np.zeros((len(wanted.bone), 3))
        missing = np.ones(len(wanted.bone), bool)
        stages = (
            (lambda: self._by_bone, wanted.bone * SIDES + wanted.side, wanted.local),
            (lambda: self._by_side, wanted.side, wanted.general),
            (lambda: self._by_side, np.full_like(wanted.side, BOTH), wanted.general),
        )
        for groups, group, points in stages:
            rows = np.flatnonzero(missing)
            if not len(rows):
                break
            found, shares = groups().nearest(points[rows], group[rows])
            rows, found, shares = rows[found >= 0], found[found >= 0], shares[found >= 0]
            corner[rows], weights[rows], missing[rows] = self.faces[found], shares, False
        return corner, weights

    @cached_property
    def _sided(self) -> tuple[Int[np.ndarray, " entry"], Int[np.ndarray, " entry"]]:
        """(element, side) of every side an element may be searched on; one that crosses the mirror plane is on all."""
        side = self.places.side[self.faces]
        has_left, has_right = _any(side == LEFT), _any(side == RIGHT)
        left, right = has_left | ~has_right, has_right | ~has_left
        lists = [np.flatnonzero(left), np.flatnonzero(right), np.arange(len(side))]
        return np.concatenate(lists), np.repeat((LEFT, RIGHT, BOTH), list(map(len, lists)))

    @cached_property
    def _by_bone(self) -> "_Groups":
        element, side = self._sided
        bones = self.places.bone[self.faces]
        pure = _equal(bones)[element]
        element, side = element[pure], side[pure]
        return _Groups.of(self.places.local[self.faces], element, bones[element, 0] * SIDES + side)

    @cached_property
    def _by_side(self) -> "_Groups":
        element, side = self._sided
        return _Groups.of(self.places.general[self.faces], element, side)


@dataclass(frozen=True)
class _Groups:
    """Triangles sorted by group, with bounding balls."""

    element: Int[np.ndarray, " entry"]
    group: Int[np.ndarray, " entry"]
    corners: Float[np.ndarray, "entry 3 3"]
    centres: Float[np.ndarray, "entry 3"]
    radii: Float[np.ndarray, " entry"]

    @classmethod
    def of(cls, corners: np.ndarray, element: np.ndarray, group: np.ndarray) -> "_Groups":
        order = np.argsort(group, kind="stable")
        element, group = element[order], group[order]
        corners = np.ascontiguousarray(corners[element])
        centres = (corners[:, 0] + corners[:, 1] + corners[:, 2]) / 3
        away = (corners - centres[:, None]) ** 2
        radii = np.sqrt(_max(away[..., 0] + away[..., 1] + away[..., 2])) * (1 + 1e-9) + 1e-12
        return cls(element, group, corners, centres, radii)

    def nearest(self, points: np.ndarray, group: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Element (-1 for an empty group) and barycentrics."""
        starts, stops = (np.searchsorted(self.group, group, side=side) for side in ("left", "right"))
        entry, weights = nearest_in_group(points, starts, stops, self.corners, self.centres, self.radii)
        return np.where(entry >= 0, self.element[entry] if len(self.element) else -1, -1), weights


def _any(columns: np.ndarray) -> np.ndarray:
    """Over three columns; several times faster than a reduction of so short an axis."""
    return columns[:, 0] | columns[:, 1] | columns[:, 2]


def _equal(columns: np.ndarray) -> np.ndarray:
    return (columns[:, 0] == columns[:, 1]) & (columns[:, 0] == columns[:, 2])


def _max(columns: np.ndarray) -> np.ndarray:
    return np.maximum(np.maximum(columns[:, 0], columns[:, 1]), columns[:, 2])
