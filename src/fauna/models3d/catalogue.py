"""What is known of model files beyond their content: species, kinship, licence, where eyes and ears are."""

from dataclasses import dataclass

from fauna.errors import FaunaError
from fauna.models3d.model import Model
from fauna.models3d.rigs import (
    CANINE,
    FARM,
    FARM_PUG,
    FARM_TAILED,
    HOOFED,
    MESH2MOTION_FOX,
    MESH2MOTION_HORSE,
    RIGS,
    Rig,
)

CC0 = "CC0-1.0"
CC_BY = "CC-BY-4.0"


@dataclass(frozen=True)
class Entry:
    """One model file.

    Attributes:
        species: name, the zoo's where it has the species.
        family: models that were made from one mesh; what is learned from one says little about another of its family.
        rig: skeleton family.
        licence: SPDX name, ``unknown`` for files that are not in the table.
        eye: forward, up, sideways from the head's joint, in lengths from there to the nose.
        ear: likewise.
        donor: stem of the file whose clips it borrows, empty for none.
        unlike: words in the names of clips that are no behaviour of this species.
        twin: stem of a file with the same mesh that is used in its place, empty for none.
    """

    species: str
    family: str
    rig: Rig
    licence: str
    eye: tuple[float, float, float]
    ear: tuple[float, float, float]
    donor: str = ""
    unlike: tuple[str, ...] = ()
    twin: str = ""


def _entry(
    species: str, family: str, rig: Rig, eye: tuple[float, float, float], ear: tuple[float, float, float],
    *, licence: str = CC0, donor: str = "", unlike: tuple[str, ...] = (), twin: str = "",
) -> Entry:  # fmt: skip
    return Entry(species, family, rig, licence, eye, ear, donor, unlike, twin)


CATALOGUE: dict[str, Entry] = {
    "Alpaca": _entry("alpaca", "alpaca", HOOFED, (0.46, 0.29, 0.23), (0.05, 0.49, 0.25)),
    "Bull": _entry("cow", "cattle", HOOFED, (0.23, 0.13, 0.43), (-0.1, 0.14, 0.52)),
    "Cow": _entry("cow", "cattle", HOOFED, (0.23, 0.13, 0.39), (-0.1, 0.14, 0.52)),
    "Deer": _entry("deer", "deer", HOOFED, (0.23, 0.15, 0.28), (-0.15, 0.13, 0.41)),
    "Donkey": _entry("donkey", "donkey", HOOFED, (0.29, 0.14, 0.24), (-0.19, 0.34, 0.21)),
    "Fox": _entry("fox", "wild dog", CANINE, (0.25, 0.1, 0.34), (-0.18, 0.4, 0.48)),
    "Horse": _entry("horse", "horse", HOOFED, (0.32, 0.17, 0.23), (-0.13, 0.26, 0.22)),
    "Horse_White": _entry("horse", "horse", HOOFED, (0.32, 0.17, 0.23), (-0.13, 0.26, 0.22)),
    "Husky": _entry("dog", "dog", CANINE, (0.22, 0.07, 0.35), (0.04, 0.31, 0.46)),
    "ShibaInu": _entry("dog", "dog", CANINE, (0.38, 0.13, 0.33), (0.08, 0.34, 0.48)),
    "Stag": _entry("deer", "stag", HOOFED, (0.33, 0.18, 0.29), (-0.12, 0.25, 0.55)),
    "Wolf": _entry("wolf", "wild dog", CANINE, (0.28, 0.18, 0.34), (0.12, 0.58, 0.5)),
    "Cow_Farm_A": _entry("cow", "farm cow", FARM_TAILED, (0.42, 0.15, 0.27), (0.02, 0.14, 0.42)),
    "Horse_Farm_A": _entry("horse", "farm horse", FARM_TAILED, (0.35, 0.22, 0.24), (0.03, 0.41, 0.27)),
    "Llama_Farm_A": _entry("llama", "farm llama", FARM, (0.38, 0.15, 0.26), (-0.15, 0.26, 0.33), donor="Horse_Farm_A"),
    "Pig_Farm_A": _entry("pig", "farm pig", FARM, (0.55, 0.05, 0.24), (0.37, 0.25, 0.3), donor="Cow_Farm_A"),
    "Pug_Farm_A": _entry("dog", "farm pug", FARM_PUG, (0.68, 0.25, 0.35), (-0.15, 0.4, 0.62), donor="Cow_Farm_A"),
    "Sheep_Farm_A": _entry("sheep", "farm sheep", FARM, (0.4, 0.18, 0.3), (-0.09, 0.06, 0.36), donor="Cow_Farm_A"),
    "Zebra_Farm_A": _entry("zebra", "farm horse", FARM_TAILED, (0.38, 0.2, 0.24), (0.12, 0.31, 0.24)),
    "fox-animations": _entry("fox", "fox", MESH2MOTION_FOX, (0.46, 0.21, 0.24), (-0.01, 0.39, 0.4)),
    "fox-fox": _entry("fox", "fox", MESH2MOTION_FOX, (0.46, 0.21, 0.24), (-0.01, 0.39, 0.4),
                      donor="fox-animations", twin="fox-animations"),
    "fox-cat": _entry("cat", "cat", MESH2MOTION_FOX, (0.8, 0.28, 0.29), (0.2, 0.78, 0.64),
                      licence=CC_BY, donor="fox-animations"),
    "fox-dog": _entry("dog", "small dog", MESH2MOTION_FOX, (0.45, 0.22, 0.3), (0.07, 0.68, 0.51), donor="fox-animations"),
    "fox-horse": _entry("horse", "light horse", MESH2MOTION_FOX, (0.28, 0.27, 0.21), (0.01, 0.44, 0.23),
                        donor="fox-animations", unlike=("sit", "howl", "sneak", "fetch")),
    "fox-panda": _entry("panda", "panda", MESH2MOTION_FOX, (0.69, 0.2, 0.17), (0.02, 0.4, 0.43), donor="fox-animations"),
    "horse-animations": _entry("horse", "bay horse", MESH2MOTION_HORSE, (0.43, 0.3, 0.18), (0.0, 0.43, 0.19)),
}  # fmt: skip
"""Known files by stem: Quaternius' animals and farm animals, and the models of Mesh2Motion (``fox-cat`` by David Revoy)."""


def lookup(model: Model) -> Entry:
    """What is known of a model; for an unknown file a guess from its joints, with its name as species and family.

    Raises:
        FaunaError: when its joints fit no rig.
    """
    if model.name in CATALOGUE:
        return CATALOGUE[model.name]
    joints = set(model.node_names)
    for rig in RIGS:
        if rig.joint_names() <= joints:
            name = model.name.lower()
            return Entry(name, name, rig, "unknown", rig.eye, rig.ear)
    missing = min((sorted(rig.joint_names() - joints) for rig in RIGS), key=len)
    raise FaunaError(
        f"{model.name}.glb expects the joints of one of {len(RIGS)} known rigs, got none complete (the nearest lacks "
        f"{', '.join(missing[:3])}); add a rig to fauna.models3d.rigs or take the file out of the folder"
    )


def maker(name: str) -> str:
    """Who made a model of the catalogue, for attribution."""
    if name == "fox-cat":
        return "David Revoy"
    return "Mesh2Motion" if CATALOGUE[name].rig in (MESH2MOTION_FOX, MESH2MOTION_HORSE) else "Quaternius"
