"""What animals do: stand, look around, graze, walk, trot, gallop and sit, as joint angles."""

from collections.abc import Callable

import numpy as np

from fauna.zoo.body import Body
from fauna.zoo.skinning import bone_transforms

Angles = dict[str, tuple[float, float, float]]
"""Rotations about x, y, z per bone, radians. Positive x: the head goes down, a hanging leg goes back."""

LIMBS = ("left_front", "right_front", "left_back", "right_back")
GAITS = {
    "walk": ((0.0, 0.5, 0.75, 0.25), 0.34),
    "trot": ((0.0, 0.5, 0.5, 0.0), 0.44),
    "gallop": ((0.0, 0.12, 0.5, 0.6), 0.52),
}
"""Phase of each limb, in cycles, and the swing of the shoulder, radians."""
SITTERS = frozenset({"dog", "wolf", "fox", "cat", "lion", "tiger", "bear", "rabbit"})
GRAZERS = frozenset({"horse", "zebra", "cow", "deer", "sheep", "goat", "rabbit", "rhino", "pig", "camel"})


def sample_pose(body: Body, species: str, rng: np.random.Generator) -> tuple[str, Angles]:
    """Draw an activity and its joint angles.

    Args:
        body: individual at rest.
        species: decides which activities are possible.
        rng: consumed.

    Returns:
        Name of the activity and the angles.
    """
    chances = {"stand": 0.34, "walk": 0.26, "trot": 0.12, "gallop": 0.08, "graze": 0.20}
    if species not in GRAZERS:
        chances["graze"] = 0.05 if species in SITTERS else 0.0
    if species in SITTERS:
        chances["sit"] = 0.06
    if species in ("elephant", "rhino"):
        chances["gallop"] = 0.0
    share = np.array(list(chances.values()))
    activity = str(rng.choice(list(chances), p=share / share.sum()))
    angles = _look(rng)
    if activity in GAITS:
        angles |= _gait(activity, rng, stiff=0.6 if species in ("elephant", "rhino", "pig") else 1.0)
    else:
        angles |= {
            f"{limb}_{'shoulder' if 'front' in limb else 'hip'}": (rng.normal(0, 0.07), 0.0, 0.0) for limb in LIMBS
        }
    if activity == "graze":
        angles |= _graze(body, angles, rng)
    if activity == "sit":
        angles |= _sit(body, rng)
    return activity, angles


def _look(rng: np.random.Generator) -> Angles:
    turn, tilt, lift = rng.normal(0, 0.22), rng.normal(0, 0.05), rng.normal(0, 0.09)
    angles: Angles = {f"neck{i}": (lift / 2, turn / 3, 0.0) for i in range(3)}
    angles["head"] = (rng.normal(0, 0.1), 0.5 * turn, tilt)
    wag, raise_ = rng.normal(0, 0.10), rng.normal(0, 0.08)
    angles |= {f"tail{i}": (raise_, wag, 0.0) for i in range(4)}
    sway, curl = rng.normal(0, 0.06), rng.normal(-0.03, 0.13)
    angles |= {f"proboscis{i}": (curl * (1 + 0.4 * i), 0.0, sway) for i in range(5)}
    for side, sign in (("left", 1), ("right", -1)):
        angles[f"{side}_ear"] = (rng.normal(0, 0.12), sign * rng.normal(0, 0.12), 0.0)
    angles["loin"] = (rng.normal(0, 0.02), rng.normal(0, 0.04), 0.0)
    return angles


def _gait(name: str, rng: np.random.Generator, stiff: float) -> Angles:
    phases, swing = GAITS[name]
    swing = stiff * swing * rng.uniform(0.75, 1.1)
    start, lead = rng.uniform(0, 1), rng.integers(2)
    angles: Angles = {}
    for limb, offset in zip(LIMBS, phases if lead else (phases[1], phases[0], phases[3], phases[2]), strict=True):
        cycle = 2 * np.pi * (start + offset)
        back = swing * np.sin(cycle)  # positive: the leg is behind
        lifted = max(0.0, -np.cos(cycle)) * swing / 0.45  # while the leg swings forward
        if "front" in limb:
            angles[f"{limb}_shoulder"] = (back - 0.15 * lifted, 0.0, 0.0)
            angles[f"{limb}_elbow"] = (-0.55 * lifted, 0.0, 0.0)
            angles[f"{limb}_knee"] = (1.0 * lifted, 0.0, 0.0)
            angles[f"{limb}_foot"] = (0.5 * lifted - 0.3 * min(back, 0), 0.0, 0.0)
        else:
            angles[f"{limb}_hip"] = (0.95 * back - 0.2 * lifted, 0.0, 0.0)
            angles[f"{limb}_stifle"] = (0.7 * lifted, 0.0, 0.0)
            angles[f"{limb}_hock"] = (-0.55 * lifted, 0.0, 0.0)
            angles[f"{limb}_foot"] = (0.55 * lifted, 0.0, 0.0)
    if name == "gallop":
        rock = 0.08 * np.sin(2 * np.pi * start + 0.5)
        angles["pelvis"] = (rock, 0.0, 0.0)
        angles["tail0"] = (0.35, 0.0, 0.0)
    return angles


def _graze(body: Body, angles: Angles, rng: np.random.Generator) -> Angles:
    """Bend the neck until the nose is near the ground."""
    height = rng.uniform(0.03, 0.3)
    nose = np.append(body.keypoints["nose"][0], 1.0)
    steep = np.radians(rng.uniform(62, 85))  # final slope of the head below the horizontal

    def bent(amount: float) -> Angles:
        change = {f"neck{i}": (share * amount, angles[f"neck{i}"][1], 0.0) for i, share in enumerate((0.5, 0.3, 0.2))}
        return change | {"head": (steep + _slope(body, "head", "nose") - amount, angles["head"][1], angles["head"][2])}

    def excess(amount: float) -> float:
        chain = {"chest": None, "neck0": "chest", "neck1": "neck0", "neck2": "neck1", "head": "neck2"}
        transforms = bone_transforms({name: body.joints[name] for name in chain}, chain, bent(amount))
        return float((transforms["head"] @ nose)[1] - height)

    return bent(_bisect(excess, 0.0, _slope(body, "neck0", "throat") + 1.05))


def _slope(body: Body, joint: str, keypoint: str) -> float:
    """Angle of the line from a joint to a keypoint above the horizontal, at rest."""
    line = body.keypoints[keypoint][0] - body.joints[joint]
    return float(np.arctan2(line[1], line[2]))


def _bisect(function: Callable[[float], float], low: float, high: float) -> float:
    """Root of a decreasing function, or the nearer end."""
    for _ in range(24):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if function(middle) > 0 else (low, middle)
    return 0.5 * (low + high)


def _sit(body: Body, rng: np.random.Generator) -> Angles:
    """Haunches down, as steep as the front legs are long."""
    heels = [body.keypoints[f"left_{end}_paw"] for end in ("back", "front")]

    def lead(pitch: float) -> float:
        transforms = bone_transforms(body.joints, body.parents, _haunches(body, pitch))
        back, front = ((transforms[bone] @ np.append(place, 1.0))[1] for place, bone, _ in heels)
        return float(back - front)

    pitch = _bisect(lead, 0.1, 0.75)
    return _haunches(body, pitch) | {f"neck{i}": (0.2 * pitch, rng.normal(0, 0.08), 0.0) for i in range(3)}


def _haunches(body: Body, pitch: float) -> Angles:
    tail = body.joints["tail3"] - body.joints["tail0"]
    hang = float(np.arctan2(-tail[1], -tail[2]))  # the tail is laid on the ground
    angles: Angles = {"pelvis": (-pitch, 0.0, 0.0), "tail0": (pitch + hang - 0.2, 0.0, 0.0)}
    for limb in LIMBS:
        if "front" in limb:
            angles[f"{limb}_shoulder"] = (pitch - 0.1, 0.0, 0.0)
            angles[f"{limb}_elbow"] = (0.1, 0.0, 0.0)
        else:
            angles[f"{limb}_hip"] = (-0.75, 0.0, 0.0)
            angles[f"{limb}_stifle"] = (1.75, 0.0, 0.0)
            angles[f"{limb}_hock"] = (-1.85 + pitch, 0.0, 0.0)
            angles[f"{limb}_foot"] = (0.15, 0.0, 0.0)
    return angles
