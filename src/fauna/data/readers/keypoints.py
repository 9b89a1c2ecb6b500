"""Keypoints of the published sets under common names, so that sets can be compared and mirrored.

The canonical names are those of Animal-Pose (:data:`fauna.zoo.body.KEYPOINTS`): ``left_`` and ``right_`` of the animal, ``elbow`` of
a back leg is the stifle, ``knee`` of a back leg the hock. A keypoint that has no counterpart there keeps its own name in the same
spelling. Only keypoints that were seen to lie at the same place of the body are renamed: in AP-10K and APT-36K the points called
shoulder and hip lie where the leg leaves the trunk, elbow and knee in its middle, which are Animal-Pose's elbow and knee. Animal
Kingdom numbers joints as on a human body and marks other places, so its limbs keep their names.
"""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

LEFT, RIGHT = "left_", "right_"


@dataclass(frozen=True)
class KeypointSet:
    """The keypoints of one dataset, in its order.

    Attributes:
        names: as its files spell them.
        renamed: canonical names of those that :func:`plain_name` alone would not give, by their name in ``names``.
    """

    names: tuple[str, ...]
    renamed: Mapping[str, str]

    @property
    def canonical(self) -> tuple[str, ...]:
        """Canonical names, in the order of ``names``."""
        return tuple(self.renamed.get(name, plain_name(name)) for name in self.names)


def _legs(pairs: Mapping[str, str]) -> dict[str, str]:
    """``pairs`` for both sides; ``{}`` stands for the side."""
    return {a.format(side): f"{side}_{b}" for a, b in pairs.items() for side in ("left", "right")}


_AP10K = _legs({"{}_shoulder": "front_elbow", "{}_elbow": "front_knee", "{}_hip": "back_elbow", "{}_knee": "back_knee"})
_ATRW = _legs({"{}_shoulder": "front_elbow", "{}_hip": "back_elbow", "{}_knee": "back_knee"})
_HORSE10 = {
    f"{near}{part}": f"{side}_{name}"
    for near, side in (("Near", "left"), ("Off", "right"))
    for part, name in {
        "knee": "front_knee", "frontfetlock": "front_fetlock", "frontfoot": "front_paw",
        "hindhock": "back_knee", "hindfetlock": "back_fetlock", "hindfoot": "back_paw",
    }.items()
}  # fmt: skip
_STANFORD = (
    *((f"{side}_{end}_{part}") for side in ("left", "right") for end in ("front", "back") for part in ("paw", "knee", "elbow")),
    "tailbase", "tail_tip", "left_ear", "right_ear", "nose", "chin", "left_ear_tip", "right_ear_tip",
    "left_eye", "right_eye", "withers", "throat",
)  # fmt: skip

KEYPOINT_SETS: dict[str, KeypointSet] = {
    "animalpose": KeypointSet(
        (
            "left_eye", "right_eye", "nose", "left_ear", "right_ear",
            "left_front_elbow", "right_front_elbow", "left_back_elbow", "right_back_elbow",
            "left_front_knee", "right_front_knee", "left_back_knee", "right_back_knee",
            "left_front_paw", "right_front_paw", "left_back_paw", "right_back_paw", "throat", "withers", "tailbase",
        ),
        {},
    ),
    "ap10k": KeypointSet(  # APT-36K uses the same
        (
            "left_eye", "right_eye", "nose", "neck", "root_of_tail",
            "left_shoulder", "left_elbow", "left_front_paw", "right_shoulder", "right_elbow", "right_front_paw",
            "left_hip", "left_knee", "left_back_paw", "right_hip", "right_knee", "right_back_paw",
        ),
        {"root_of_tail": "tailbase", **_AP10K},
    ),
    "atrw": KeypointSet(
        (
            "left_ear", "right_ear", "nose", "right_shoulder", "right_front_paw", "left_shoulder", "left_front_paw",
            "right_hip", "right_knee", "right_back_paw", "left_hip", "left_knee", "left_back_paw", "tail", "center",
        ),
        {"tail": "tailbase", **_ATRW},
    ),
    "horse10": KeypointSet(  # near is the horse's left side, off its right
        (
            "Nose", "Eye", "Nearknee", "Nearfrontfetlock", "Nearfrontfoot", "Offknee", "Offfrontfetlock", "Offfrontfoot",
            "Shoulder", "Midshoulder", "Elbow", "Girth", "Wither", "Nearhindhock", "Nearhindfetlock", "Nearhindfoot",
            "Hip", "Stifle", "Offhindhock", "Offhindfetlock", "Offhindfoot", "Ischium",
        ),
        {"Wither": "withers", **_HORSE10},
    ),
    "zebra": KeypointSet(  # seen from above
        ("snout", "head", "neck", "forelegL1", "forelegR1", "hindlegL1", "hindlegR1", "tailbase", "tailtip"),
        {
            "snout": "nose", "tailtip": "tail_tip", "forelegL1": "left_foreleg", "forelegR1": "right_foreleg",
            "hindlegL1": "left_hindleg", "hindlegR1": "right_hindleg",
        },
    ),
    "animal_kingdom": KeypointSet(
        (
            "Head_Mid_Top", "Eye_Left", "Eye_Right", "Mouth_Front_Top", "Mouth_Back_Left", "Mouth_Back_Right",
            "Mouth_Front_Bottom", "Shoulder_Left", "Shoulder_Right", "Elbow_Left", "Elbow_Right", "Wrist_Left", "Wrist_Right",
            "Torso_Mid_Back", "Hip_Left", "Hip_Right", "Knee_Left", "Knee_Right", "Ankle_Left", "Ankle_Right",
            "Tail_Top_Back", "Tail_Mid_Back", "Tail_End_Back",
        ),
        {"Tail_Top_Back": "tailbase", "Tail_Mid_Back": "tail_middle", "Tail_End_Back": "tail_tip"},
    ),
    "stanfordextra": KeypointSet(_STANFORD, {}),
}  # fmt: skip
"""By the name that ``data.source.keypoint_set`` takes."""

_WORDS = {"earbase": "ear", "l": "left", "r": "right", "f": "front", "b": "back"}


def plain_name(name: str) -> str:
    """A name in lower case with its side in front and abbreviations of side, end and ear base written out.

    >>> [plain_name(name) for name in ("L_F_Elbow", "R_EarBase", "Eye_Left", "TailBase", "Ankle_Left ")]
    ['left_front_elbow', 'right_ear', 'left_eye', 'tailbase', 'left_ankle']
    """
    words = [_WORDS.get(word, word) for word in re.split(r"[^a-z0-9]+", name.strip().lower()) if word]
    sides = [word for word in words if word in ("left", "right")]
    return "_".join([*sides, *(word for word in words if word not in ("left", "right"))])


def canonical_names(names: Sequence[str]) -> tuple[str, ...]:
    """Canonical names of a dataset's keypoints; the dataset is recognised by its set of names, in any order.

    Args:
        names: as its files spell them.

    Returns:
        One name each, different from each other.

    >>> canonical_names(["L_Eye", "R_Eye", "Nose"])
    ('left_eye', 'right_eye', 'nose')
    """
    stripped = [name.strip() for name in names]
    for known in KEYPOINT_SETS.values():
        if sorted(known.names) == sorted(stripped):
            by_name = dict(zip(known.names, known.canonical, strict=True))
            return tuple(by_name[name] for name in stripped)
    plain = tuple(plain_name(name) for name in stripped)
    return plain if len(set(plain)) == len(plain) else tuple(stripped)


def mirror_indices(names: Sequence[str]) -> tuple[int, ...]:
    """For each keypoint the index of its left-right counterpart, itself where it has none.

    >>> mirror_indices(["left_eye", "nose", "right_eye", "left_ear"])
    (2, 1, 0, 3)
    """
    places = {name: place for place, name in enumerate(names)}
    return tuple(places.get(_other_side(name), place) for place, name in enumerate(names))


def _other_side(name: str) -> str:
    if name.startswith(LEFT):
        return RIGHT + name.removeprefix(LEFT)
    if name.startswith(RIGHT):
        return LEFT + name.removeprefix(RIGHT)
    return name


def shared_keypoints(first: Sequence[str], second: Sequence[str]) -> tuple[str, ...]:
    """Canonical names that both sets have, in the order of the first."""
    return tuple(name for name in first if name in set(second))
