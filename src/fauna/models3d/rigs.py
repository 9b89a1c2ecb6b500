"""Skeleton families: which joint carries which keypoint, which leg a joint belongs to, what may be varied.

A keypoint is either a *joint place*, a point between two joints that rides on the first, or a *skin place*, the vertex seen from
such a point in a given direction. ``{S}`` in a joint's name stands for the side, spelled as the rig does.
"""

from dataclasses import dataclass
from typing import Literal

from fauna.zoo.body import KEYPOINTS


@dataclass(frozen=True)
class Place:
    """A point between two joints at rest.

    Attributes:
        start: joint it rides on.
        end: joint it lies towards.
        share: 0 at ``start``, 1 at ``end``.
        forward: moved towards +z, in lengths of the way from start to end.
        toward: direction in which the skin is looked for, animal frame; ``"under"`` points out of the underside of the way from
            start to end, and somewhat back along it; ``None`` = stay inside.
    """

    start: str
    end: str
    share: float = 0.0
    forward: float = 0.0
    toward: tuple[float, float, float] | Literal["under"] | None = None


@dataclass(frozen=True)
class Rig:
    """One skeleton family.

    Attributes:
        name: of the family.
        sides: spelling of left and right.
        head: joint at the back of the head.
        snout: other joints that move the nose.
        places: keypoints by name without the side; eyes, ears and nose are placed by the head.
        front_leg: joints of a front leg from the shoulder's end down.
        back_leg: joints of a back leg from the hip down.
        neck: joints whose distance to their parents makes the neck long or short.
        tail: the tail's first joint, empty without one.
        loose: beginnings of the names of joints that never rest on the ground.
        eye: default place of the eye in the frame of the head, see :class:`fauna.models3d.catalogue.Entry`.
        ear: likewise.
    """

    name: str
    sides: tuple[str, str]
    head: str
    snout: tuple[str, ...]
    places: dict[str, Place]
    front_leg: tuple[str, ...]
    back_leg: tuple[str, ...]
    neck: tuple[str, ...]
    tail: str
    loose: tuple[str, ...]
    eye: tuple[float, float, float] = (0.35, 0.2, 0.2)
    ear: tuple[float, float, float] = (-0.05, 0.45, 0.25)

    def joint_names(self) -> set[str]:
        """Joints that a model needs to fit this rig."""
        names = {self.head, *self.neck}
        for place in self.places.values():
            names |= {place.start, place.end}
        names |= {*self.front_leg, *self.back_leg}
        return {name.replace("{S}", side) for name in names for side in self.sides}


def _hoofed_animals(front: dict[str, Place], name: str) -> Rig:
    return Rig(
        name=name, sides=("L", "R"), head="Head", snout=(),
        places={
            **front,
            "front_paw": Place("FF.{S}", "FF.{S}"),
            "back_elbow": Place("BackUpperLeg.{S}", "BackLowerLeg.{S}", 0.05),
            "back_knee": Place("BackLowerLeg.{S}", "BackLowerLeg.{S}"),
            "back_paw": Place("FFB.{S}", "FFB.{S}"),
            "throat": Place("Neck3", "Head", 0.75, toward="under"),
            "withers": Place("Torso3", "Neck1", 0.4, toward=(0.0, 1.0, 0.0)),
            "tailbase": Place("Tail2", "Tail2", toward=(0.0, 1.0, 0.0)),
        },
        front_leg=("FrontUpperLeg.{S}", "FrontLowerLeg.{S}", "IKFrontLeg.{S}", "FF.{S}"),
        back_leg=("BackLeg.{S}", "BackUpperLeg.{S}", "BackLowerLeg.{S}", "IKBackLeg.{S}", "FFB.{S}"),
        neck=("Neck2", "Neck3", "Head"), tail="Tail1", loose=("Neck", "Head", "Ear", "Tail"),
    )  # fmt: skip


HOOFED = _hoofed_animals(
    {
        "front_elbow": Place("FrontUpperLeg.{S}", "FrontLowerLeg.{S}", 0.12),
        "front_knee": Place("FrontLowerLeg.{S}", "FrontLowerLeg.{S}"),
    },
    "quaternius hoofed",
)
CANINE = _hoofed_animals(
    {
        "front_elbow": Place("FrontLowerLeg.{S}", "FrontLowerLeg.{S}"),
        "front_knee": Place("FrontLowerLeg.{S}", "IKFrontLeg.{S}", 0.85),
    },
    "quaternius canine",
)
FARM = Rig(
    name="quaternius farm", sides=("L", "R"), head="Head", snout=(),
    places={
        "front_elbow": Place("FrontUpLeg.{S}", "FrontLowLeg.{S}", 0.4),
        "front_knee": Place("FrontLowLeg.{S}", "FrontFoot.{S}", 0.1, forward=-0.1),
        "front_paw": Place("FrontFoot.{S}", "FrontFoot.{S}", toward=(0.0, -0.2, 1.0)),
        "back_elbow": Place("BackUpLeg.{S}", "BackLowLeg.{S}", 0.35, forward=0.3),
        "back_knee": Place("BackLowLeg.{S}", "BackLowLeg.{S}"),
        "back_paw": Place("BackFoot.{S}", "BackFoot.{S}", toward=(0.0, -0.2, 1.0)),
        "throat": Place("Neck", "Head", 0.85, toward="under"),
        "withers": Place("Shoulders", "Neck", 0.3, toward=(0.0, 1.0, 0.0)),
        "tailbase": Place("Back", "Back", toward=(0.0, 0.6, -1.0)),
    },
    front_leg=("FrontUpLeg.{S}", "FrontLowLeg.{S}", "FrontFoot.{S}"),
    back_leg=("BackUpLeg.{S}", "BackLowLeg.{S}", "BackFoot.{S}"),
    neck=("Neck", "Head"), tail="Tail1", loose=("Neck", "Head", "Tail"),
)  # fmt: skip
FARM_TAILED = Rig(
    **{
        **{name: getattr(FARM, name) for name in Rig.__dataclass_fields__},
        "name": "quaternius farm with tail",
        "places": {**FARM.places, "tailbase": Place("Tail1", "Tail2", 0.75, toward=(0.0, 1.0, 0.0))},
    }
)
FARM_PUG = Rig(
    **{
        **{name: getattr(FARM, name) for name in Rig.__dataclass_fields__},
        "name": "quaternius farm pug",  # its feet's joints lie on the soles, and its tail has none
        "places": {
            **FARM.places,
            "front_paw": Place("FrontFoot.{S}", "FrontFoot.{S}_end", 0.6, toward=(0.0, 0.6, 1.0)),
            "back_paw": Place("BackFoot.{S}", "BackFoot.{S}_end", 0.8, toward=(0.0, 0.6, 1.0)),
            "tailbase": Place("Back", "Neck", 0.85, forward=-0.94),  # above and behind the hip, where no joint is
        },
    }
)
MESH2MOTION_FOX = Rig(
    name="mesh2motion fox", sides=("L", "R"), head="Head", snout=("Nose", "Head.tip", "Chin"),
    places={
        "front_elbow": Place("Front_Leg_Upper_{S}", "Front_Leg_Lower_{S}", 0.6),
        "front_knee": Place("Front_Leg_Lower_{S}", "Front_Leg_Ankle_{S}", 0.7),
        "front_paw": Place("Front_Leg_Foot_{S}", "Front_Leg_Foot_{S}"),
        "back_elbow": Place("Back_Leg_Lower_{S}", "Back_Leg_Lower_{S}"),
        "back_knee": Place("Back_Leg_Ankle_{S}", "Back_Leg_Ankle_{S}"),
        "back_paw": Place("Back_Leg_Foot_1_{S}", "Back_Leg_Foot_1_{S}"),
        "throat": Place("Spine_4", "Head", 0.75, toward="under"),
        "withers": Place("Spine_2.001", "Spine_2.001", toward=(0.0, 1.0, 0.0)),
        "tailbase": Place("Tail_Base", "Tail_Base", toward=(0.0, 1.0, -0.3)),
    },
    front_leg=tuple(f"Front_Leg_{part}_{{S}}" for part in ("Upper", "Lower", "Ankle", "Foot", "Tip")),
    back_leg=tuple(f"Back_Leg_{part}_{{S}}" for part in ("Upper", "Lower", "Ankle", "Foot", "Foot_1", "Tip")),
    neck=("Spine_4", "Head"), tail="Tail_Base", loose=("Spine_3", "Spine_4", "Head", "Nose", "Chin", "Ear", "Tail"),
)  # fmt: skip
MESH2MOTION_HORSE = Rig(
    name="mesh2motion horse", sides=("l", "r"), head="head", snout=("nose", "head_leaf", "mouth"),
    places={
        "front_elbow": Place("front_leg_upper_{S}", "front_leg_upper_{S}"),
        "front_knee": Place("front_leg_lower_{S}", "front_leg_lower_{S}"),
        "front_paw": Place("front_leg_foot_{S}", "front_leg_leaf_{S}", 0.7),
        "back_elbow": Place("back_leg_lower_{S}", "back_leg_lower_{S}"),
        "back_knee": Place("back_leg_ankle_{S}", "back_leg_ankle_{S}"),
        "back_paw": Place("back_leg_toe_{S}", "back_leg_leaf_{S}", 0.5),
        "throat": Place("spine_6", "head", 0.6, toward="under"),
        "withers": Place("spine_3", "spine_4", 0.7, toward=(0.0, 1.0, 0.0)),
        "tailbase": Place("tail_1", "tail_1", toward=(0.0, 1.0, 0.0)),
    },
    front_leg=tuple(f"front_leg_{part}_{{S}}" for part in ("upper", "lower", "ankle", "foot", "leaf")),
    back_leg=tuple(f"back_leg_{part}_{{S}}" for part in ("upper", "lower", "ankle", "foot", "toe", "leaf")),
    neck=("spine_5", "spine_6", "head"), tail="tail_1",
    loose=("spine_5", "spine_6", "head", "nose", "mouth", "ear", "tail"),
)  # fmt: skip
RIGS = (HOOFED, CANINE, FARM_TAILED, FARM, MESH2MOTION_FOX, MESH2MOTION_HORSE)
"""In the order in which a model of unknown rig is tried."""

BY_HEAD = ("eye", "ear", "nose")
assert {name.split("_", 1)[-1] if name.startswith(("left", "right")) else name for name in KEYPOINTS} == {
    *HOOFED.places,
    *BY_HEAD,
}
