"""Half a turn about the vertical, between the canonical frame and the frame a model has learned in.

Training is symmetric in z: a run settles with the head at +z or at -z, and nothing it looks at tells the two apart. A run
with the head at -z is *turned* afterwards: each part goes on computing in the frame it has learned in, and turns what it
takes from and hands to the canonical frame (``docs/conventions.md``). The turn is its own inverse and only changes signs
and the order of bones, so nothing else changes, neither pictures nor gradients.
"""

from jaxtyping import Float
from torch import Tensor

from fauna.geometry.constants import constant, constant_index
from fauna.geometry.skeleton import BONES_PER_LEG, NUM_BODY_BONES, NUM_LEGS
from fauna.types import Skeleton

_HALF_SPINE = NUM_BODY_BONES // 2

OTHER_END = tuple((bone + _HALF_SPINE) % NUM_BODY_BONES for bone in range(NUM_BODY_BONES)) + tuple(
    NUM_BODY_BONES + BONES_PER_LEG * ((leg + 2) % NUM_LEGS) + bone
    for leg in range(NUM_LEGS)
    for bone in range(BONES_PER_LEG)
)
"""The bone that lies, after half a turn, where each bone lies before: front and rear, left and right change places."""


def half_turn(points: Float[Tensor, "*batch 3"], turned: bool = True) -> Float[Tensor, "*batch 3"]:
    """``(x, y, z) -> (-x, y, -z)`` of positions or directions; as they are where not ``turned``."""
    return points * constant((-1.0, 1.0, -1.0), points) if turned else points


def other_end(per_bone: Float[Tensor, "row bone chan"]) -> Float[Tensor, "row bone chan"]:
    """Values per bone under the names of the turned skeleton, see :data:`OTHER_END`."""
    return per_bone.index_select(1, constant_index(OTHER_END, per_bone))


def turn_skeleton(skeleton: Skeleton) -> Skeleton:
    """The bones of the turned mesh: what was named after one end of the body is named after the other."""
    names = constant_index(OTHER_END, skeleton.starts)
    parents = skeleton.parents.index_select(1, names)
    parents = names[parents.clamp(min=0)].where(parents >= 0, parents)
    return Skeleton(half_turn(other_end(skeleton.starts)), half_turn(other_end(skeleton.ends)), parents)


def turn_angles(angles: Float[Tensor, "row bone 3"]) -> Float[Tensor, "row bone 3"]:
    """Euler angles of :func:`turn_skeleton`'s bones that move the turned mesh as ``angles`` move the other.

    The turn reverses right and up of a bone's rest frame (both contain the x axis an odd number of times) and keeps its
    direction, so swing and sideways change their sign and the twist does not. A bone exactly along x, whose frame is a
    matter of convention, would be an exception; none lies so.
    """
    return other_end(angles) * constant((-1.0, -1.0, 1.0), angles)
