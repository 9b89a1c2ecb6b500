"""Legs for animation: where each stands, and how its three bones bend so that its sole is where it has to be."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int
from scipy.spatial.transform import Rotation

from fauna.export.animal import RiggedAnimal
from fauna.export.joints import LEGS, LegJoints

_SOLE_BAND = 0.03
"""What the foot carries so little above its lowest vertex is the sole; share of the leg's length."""

_SOLE_REACH = 0.35
"""Vertices farther from the end of the foot bone are something else; share of the leg's length."""

_MAX_BEND = 2.4
"""Largest angle of a knee, radians."""


@dataclass(frozen=True, eq=False)
class Leg:
    """A leg at rest, metres.

    Attributes:
        joints: its name and joints.
        parent: the joint it hangs from.
        points: (4, 3) hip, knee, ankle and sole. The sole moves with the foot bone.
        axis: (3,) what the joints bend about, towards the animal's left.
        sole_vertices: the vertices of the sole, none where the foot bone carries nothing.
    """

    joints: LegJoints
    parent: int
    points: Float[np.ndarray, "4 3"]
    axis: Float[np.ndarray, " 3"]
    sole_vertices: Int[np.ndarray, " sole"]

    @property
    def hip(self) -> Float[np.ndarray, " 3"]:
        """Where it hangs from the spine."""
        return self.points[0]

    @property
    def sole(self) -> Float[np.ndarray, " 3"]:
        """What touches the ground."""
        return self.points[3]

    @property
    def length(self) -> float:
        """From hip to sole at rest, where the leg is straight."""
        return float(np.linalg.norm(self.sole - self.hip))

    @property
    def reach(self) -> float:
        """From hip to ankle with a straight knee."""
        return float(np.linalg.norm(np.diff(self.points[:3], axis=0), axis=1).sum())

    @property
    def ankle_over_sole(self) -> Float[np.ndarray, " 3"]:
        """The ankle seen from the sole at rest."""
        return self.points[2] - self.points[3]


def legs_of(animal: RiggedAnimal) -> tuple[Leg, ...]:
    """The four legs in the order of :data:`fauna.export.joints.LEGS`."""
    return tuple(_leg(animal, joints) for joints in LEGS)


def _leg(animal: RiggedAnimal, joints: LegJoints) -> Leg:
    upper, _, foot = joints.joints
    sole = animal.ends[foot]
    length = np.linalg.norm(sole - animal.starts[upper])
    near = np.linalg.norm(animal.vertices - sole, axis=1) < _SOLE_REACH * length
    carried = np.flatnonzero((animal.influences[:, 0] == foot) & near)
    if len(carried):
        heights = animal.vertices[carried, 1]
        carried = carried[heights <= heights.min() + _SOLE_BAND * length]
        band = animal.vertices[carried]
        sole = np.array([band[:, 0].mean(), band[:, 1].min(), band[:, 2].mean()])
    points = np.concatenate((animal.starts[list(joints.joints)], sole[None]))
    return Leg(joints, int(animal.parents[upper]), points, animal.frames[upper][:, 0], carried)


def bend(
    leg: Leg, targets: Float[np.ndarray, "frame 3"], feet: Float[np.ndarray, "frame 3 3"], *, knee_forward: bool
) -> Float[np.ndarray, "frame 3 3 3"]:
    """Turn the upper and the lower bone so that the ankle comes to a target, and the foot bone as asked.

    The knee bends as far as the distance asks; the hip turns the bent leg towards the target on the shortest way. A target
    out of reach is only pointed at. Upper and lower bone lie in one line at rest (:func:`fauna.geometry.skeleton.rest_skeleton`).

    Args:
        leg: at rest.
        targets: of the ankle seen from the hip, in the rest axes as the parent carries them, metres.
        feet: turns of the foot bone against rest, in the same axes.
        knee_forward: as in hind legs; elbows point backwards.

    Returns:
        Rotation of each bone against its parent, in rest axes.
    """
    upper, lower, _ = np.linalg.norm(np.diff(leg.points, axis=0), axis=1)
    cosine = (np.square(targets).sum(axis=1) - upper**2 - lower**2) / (2.0 * upper * lower)
    angles = np.arccos(cosine.clip(np.cos(_MAX_BEND), 1.0)) * (1.0 if knee_forward else -1.0)
    knees = Rotation.from_rotvec(angles[:, None] * leg.axis).as_matrix()
    first, second, _ = np.diff(leg.points, axis=0)
    hips = shortest_turn(first + knees @ second, targets)
    ankles = (hips @ knees).swapaxes(1, 2) @ feet
    return np.stack((hips, knees, ankles), axis=1)


def shortest_turn(
    source: Float[np.ndarray, "frame 3"], target: Float[np.ndarray, "frame 3"]
) -> Float[np.ndarray, "frame 3 3"]:
    """Rotations by the smallest angle from one direction to another; opposite ones turn about x."""
    source = source / np.linalg.norm(source, axis=1, keepdims=True).clip(1e-12)
    target = target / np.linalg.norm(target, axis=1, keepdims=True).clip(1e-12)
    cross, dot = np.cross(source, target), np.einsum("fk,fk->f", source, target)
    quaternions = np.concatenate((cross, 1.0 + dot[:, None]), axis=1)
    quaternions[np.linalg.norm(quaternions, axis=1) < 1e-9] = (1.0, 0.0, 0.0, 0.0)
    return Rotation.from_quat(quaternions).as_matrix()
