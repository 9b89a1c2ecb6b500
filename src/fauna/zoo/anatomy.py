"""Proportions of an animal. Unit: height at the withers = 1. Rest frame: y up from the ground, z towards the head, +x the animal's left.

Everything the head carries is given in head coordinates ``(side, up, along)`` in head lengths: ``along`` runs from the
poll (0) to the tip of the nose (1), ``up`` is perpendicular to it in the mirror plane.
"""

from dataclasses import dataclass

Vector = tuple[float, float, float]


@dataclass(frozen=True, kw_only=True)
class Ear:
    """One flat ear; the other is its mirror image.

    Attributes:
        place: where it grows, head coordinates.
        direction: where it points, head coordinates, any length.
        length: head lengths.
        width: full width, head lengths.
        profile: ``"leaf"``, ``"triangle"`` or ``"round"``.
        thickness: half thickness, head lengths.
        facing: where its opening looks, head coordinates.
    """

    place: Vector
    direction: Vector
    length: float
    width: float
    profile: str
    thickness: float = 0.03
    facing: Vector = (0.5, 0.1, 1.0)


@dataclass(frozen=True, kw_only=True)
class Horn:
    """A curved tapering rod on the head: horn, tusk, antler, knob or beard.

    Attributes:
        path: points in head coordinates, root first.
        radius: at the root, head lengths.
        tip: radius at the tip as a fraction of ``radius``.
        paired: whether it is repeated mirrored.
        material: name of the material.
    """

    path: tuple[Vector, ...]
    radius: float
    tip: float = 0.15
    paired: bool = True
    material: str = "horn"


@dataclass(frozen=True, kw_only=True)
class Tail:
    """A tail as a tube.

    Attributes:
        length: withers heights.
        angle_deg: of the root, above the horizontal (negative hangs).
        curl_deg: added along the length (negative bends down).
        radii: at the root, middle, three quarters and tip.
        tuft: fraction of the length, at the tip, made of the tuft material.
    """

    length: float
    angle_deg: float
    curl_deg: float
    radii: tuple[float, float, float, float]
    tuft: float = 0.0


@dataclass(frozen=True, kw_only=True)
class Bump:
    """A ball or rod added to the trunk, neck or head: hump, ruff, crest, udder.

    Attributes:
        bone: bone that carries it.
        start: (y, z) relative to the bone's joint, withers heights.
        end: likewise.
        radii: at start and end.
        width: sideways scale of the section.
        material: name of the material.
        side: x of the bump; not 0 adds the mirror image.
    """

    bone: str
    start: tuple[float, float]
    end: tuple[float, float]
    radii: tuple[float, float]
    width: float = 1.0
    material: str = "skin"
    side: float = 0.0


@dataclass(frozen=True, kw_only=True)
class Anatomy:
    """A quadruped in 40 numbers and its ornaments.

    Attributes:
        length: chest to buttock.
        chest: depth of the trunk behind the elbow.
        belly: depth at mid-trunk.
        rump: depth at the hips.
        croup: height of the hips' top.
        arch: how much the mid-back rises over the line withers-croup.
        width: width of the trunk over its depth.
        neck_length: withers-side root to poll.
        neck_deg: angle of the neck above the horizontal.
        neck_arch: sideways bow of the neck line, positive is convex on top.
        neck_root: radius at the root.
        neck_top: radius at the poll.
        neck_width: width of the neck over its depth.
        neck_drop: depth of the neck's root below the withers over chest depth.
        head: length poll to nose.
        head_deg: angle of the head below the horizontal.
        skull: radius, head lengths.
        muzzle: radii at the eyes' end and at the nose, head lengths.
        muzzle_drop: how far the muzzle axis lies below the skull's, head lengths.
        muzzle_start: where the muzzle begins along the head, 0 to 1.
        jaw: radius of the cheeks, head lengths.
        head_width: width of the head over its depth.
        eye: (up, along) of the eyes.
        eye_radius: head lengths.
        stance: half the distance between the feet.
        knee: height of the front knee (carpus).
        hock: height of the hock.
        fetlock: height of the fetlock, where the foot begins.
        angulation: 0 for pillars, 1 for a horse, more for crouching animals.
        thigh: radius at the hip.
        gaskin: radius above the hock.
        shoulder: radius at the shoulder.
        forearm: radius at the elbow.
        cannon: radius below knee and hock.
        foot: radius of the foot.
        foot_length: how far the toes reach forward.
        hoof: whether the foot is a hoof.
        proboscis: length of an elephant's trunk, 0 without.
        crest: radius of the mane standing along the neck, 0 without.
        fleece: height of the curls of the wool, 0 without.
    """

    length: float
    chest: float
    belly: float
    rump: float
    croup: float
    arch: float
    width: float
    neck_length: float
    neck_deg: float
    neck_arch: float
    neck_root: float
    neck_top: float
    neck_width: float
    neck_drop: float
    head: float
    head_deg: float
    skull: float
    muzzle: tuple[float, float]
    muzzle_drop: float
    muzzle_start: float
    jaw: float
    head_width: float
    eye: tuple[float, float]
    eye_radius: float
    stance: float
    knee: float
    hock: float
    fetlock: float
    angulation: float
    thigh: float
    gaskin: float
    shoulder: float
    forearm: float
    cannon: float
    foot: float
    foot_length: float
    hoof: bool
    ear: Ear
    tail: Tail
    horns: tuple[Horn, ...] = ()
    bumps: tuple[Bump, ...] = ()
    proboscis: float = 0.0
    crest: float = 0.0
    fleece: float = 0.0
