"""The joints every exported animal has: ``skeleton.json`` beside this file is their one home."""

import json
from dataclasses import dataclass
from importlib.resources import files

from fauna.geometry.skeleton import NUM_BONES

_DOCUMENT = json.loads(files("fauna.export").joinpath("skeleton.json").read_text(encoding="utf-8"))

SKELETON_VERSION: str = _DOCUMENT["version"]
"""Changes whenever names, order, axes or parents do."""

JOINT_NAMES: tuple[str, ...] = tuple(joint["name"] for joint in _DOCUMENT["joints"])
"""In the order of the file; a joint comes after its parent."""

JOINT: dict[str, int] = {name: index for index, name in enumerate(JOINT_NAMES)}
"""Index of each name."""

ROOT = JOINT["root"]
NUM_JOINTS = len(JOINT_NAMES)
FRONT_CHAIN = tuple(JOINT[name] for name in ("spine_front", "chest", "neck", "head"))
REAR_CHAIN = tuple(JOINT[name] for name in ("spine_rear", "loin", "pelvis", "tail"))

BONE_OF_JOINT: tuple[int | None, ...] = tuple(joint["bone"] for joint in _DOCUMENT["joints"])
"""The model's bone (``docs/conventions.md``, section "Skeleton") of each joint; the root is none."""

JOINT_OF_BONE: tuple[int, ...] = tuple(BONE_OF_JOINT.index(bone) for bone in range(NUM_BONES))


@dataclass(frozen=True)
class LegJoints:
    """A leg by its joints.

    Attributes:
        name: ``front_left`` and so on.
        joints: indices of upper, lower and foot joint.
        front: whether it is a front leg.
    """

    name: str
    joints: tuple[int, int, int]
    front: bool


LEGS: tuple[LegJoints, ...] = tuple(
    LegJoints(
        f"{end}_{side}",
        (JOINT[f"{end}_{side}_upper"], JOINT[f"{end}_{side}_lower"], JOINT[f"{end}_{side}_foot"]),
        end == "front",
    )
    for end in ("front", "hind")
    for side in ("left", "right")
)
"""Front left, front right, hind left, hind right."""
