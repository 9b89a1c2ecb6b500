"""Legs for animation: where each stands, and how its three bones bend so that its sole is where it has to be."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Complex, Float
from scipy.spatial.transform import Rotation

from fauna.export.animal import RiggedAnimal
from fauna.export.joints import LEGS, LegJoints

_SOLE_BAND = 0.03
"""What the foot carries so little above its lowest vertex is the sole; share of the leg's length."""

_SOLE_REACH = 0.35
"""Vertices farther from the end of the foot bone are something else; share of the leg's length."""

_MAX_BEND = 2.4
"""Largest angle of a knee, radians."""

_HALVINGS = 40


@dataclass(frozen=True, eq=False)
class Leg:
    """A leg at rest, metres.

    Attributes:
        joints: its name and joints.
        parent: the joint it hangs from.
        points: (4, 3) hip, knee, ankle and sole. The sole moves with the foot bone.
        axis: (3,) what the joints bend about, towards the animal's left.
    """

    joints: LegJoints
    parent: int
    points: Float[np.ndarray, "4 3"]
    axis: Float[np.ndarray, " 3"]

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


def legs_of(animal: RiggedAnimal) -> tuple[Leg, ...]:
    """The four legs in the order of :data:`fauna.export.joints.LEGS`."""
    return tuple(_leg(animal, joints) for joints in LEGS)


def _leg(animal: RiggedAnimal, joints: LegJoints) -> Leg:
    upper, _, foot = joints.joints
    sole = animal.ends[foot]
    length = np.linalg.norm(sole - animal.starts[upper])
    carried = animal.vertices[animal.influences[:, 0] == foot]
    carried = carried[np.linalg.norm(carried - sole, axis=1) < _SOLE_REACH * length]
    if len(carried):
        lowest = carried[:, 1].min()
        band = carried[carried[:, 1] <= lowest + _SOLE_BAND * length]
        sole = np.array([band[:, 0].mean(), lowest, band[:, 2].mean()])
    points = np.concatenate((animal.starts[list(joints.joints)], sole[None]))
    return Leg(joints, int(animal.parents[upper]), points, animal.frames[upper][:, 0])


def bend(
    leg: Leg, targets: Float[np.ndarray, "frame 3"], bends: Float[np.ndarray, "frame 2"]
) -> Float[np.ndarray, "frame 3 3 3"]:
    """Turn the upper, lower and foot bone so that the sole comes to a target.

    Knee and ankle bend in a given proportion, as far as the distance asks; the hip turns the bent leg towards the
    target on the shortest way. A target out of reach is only pointed at.

    Args:
        leg: at rest.
        targets: of the sole seen from the hip, in the rest axes as the parent carries them, metres.
        bends: proportion of the angles of knee and ankle; a positive one turns what is below it backwards.

    Returns:
        Rotation of each bone against its parent, in rest axes.
    """
    plane, along = _in_plane(leg)
    wanted = np.linalg.norm(targets, axis=1) ** 2 - along.sum() ** 2
    low, high = np.zeros(len(targets)), _MAX_BEND / np.abs(bends).max(axis=1)
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        too_long = np.abs(_folded(plane, middle[:, None] * bends)) ** 2 > wanted
        low, high = np.where(too_long, middle, low), np.where(too_long, high, middle)
    angles = low[:, None] * bends
    folded = _folded(plane, angles)
    upright = np.cross(leg.axis, _across(leg))
    sole = np.outer(np.real(folded), _across(leg)) + np.outer(np.imag(folded), upright) + along.sum() * leg.axis
    knee, ankle = (Rotation.from_rotvec(angles[:, [joint]] * leg.axis).as_matrix() for joint in range(2))
    return np.stack((shortest_turn(sole, targets), knee, ankle), axis=1)


def _across(leg: Leg) -> Float[np.ndarray, " 3"]:
    """A unit vector perpendicular to the axis: the direction from hip to ankle, which lies so up to rounding."""
    line = leg.points[2] - leg.points[0]
    line = line - leg.axis * (leg.axis @ line)
    return line / max(float(np.linalg.norm(line)), 1e-12)


def _in_plane(leg: Leg) -> tuple[Complex[np.ndarray, " 3"], Float[np.ndarray, " 3"]]:
    """The three bones as complex numbers in the plane they bend in (a turn is a factor), and along the axis."""
    bones = np.diff(leg.points, axis=0)
    across = _across(leg)
    return bones @ across + 1j * (bones @ np.cross(leg.axis, across)), bones @ leg.axis


def _folded(plane: Complex[np.ndarray, " 3"], angles: Float[np.ndarray, "frame 2"]) -> Complex[np.ndarray, " frame"]:
    """From the hip to the sole after bending knee and ankle only."""
    turns = np.exp(1j * angles)
    return plane[0] + turns[:, 0] * (plane[1] + turns[:, 1] * plane[2])


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
