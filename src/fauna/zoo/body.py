"""From proportions to a skeleton with flesh: joints, round cones, tubes, eyes and keypoints of one individual at rest."""

from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float

from fauna.zoo.anatomy import Anatomy, Ear, Horn

KEYPOINTS = (
    "left_eye", "right_eye", "nose", "left_ear", "right_ear",
    "left_front_elbow", "right_front_elbow", "left_back_elbow", "right_back_elbow",
    "left_front_knee", "right_front_knee", "left_back_knee", "right_back_knee",
    "left_front_paw", "right_front_paw", "left_back_paw", "right_back_paw",
    "throat", "withers", "tailbase",
)  # fmt: skip
"""The twenty keypoints of Animal-Pose, in its order. ``elbow`` of a back leg is the stifle, ``knee`` the hock."""

SIDES = (("left", 1.0), ("right", -1.0))
"""The animal's own left is +x: it faces +z with y up."""


@dataclass(frozen=True)
class Cone:
    """A round cone of flesh: ``group`` 0 is trunk, neck and head; 1 to 4 the legs, which never blend with each other."""

    start: Float[np.ndarray, "3"]
    end: Float[np.ndarray, "3"]
    radii: tuple[float, float]
    width: float
    blend: float
    group: int
    bone: str
    material: str


@dataclass(frozen=True)
class Tube:
    """A closed swept tube: ``path`` (ring, 3), half axes (ring, 2) along ``wide`` and across, and the bones along it."""

    path: Float[np.ndarray, "ring 3"]
    axes: Float[np.ndarray, "ring 2"]
    wide: Float[np.ndarray, "3"]
    bones: tuple[str, ...]
    materials: tuple[str, ...]


@dataclass
class Body:
    """A skeleton under construction: joints by name, parents by name, and what is hung on it."""

    joints: dict[str, np.ndarray] = field(default_factory=dict)
    parents: dict[str, str | None] = field(default_factory=dict)
    cones: list[Cone] = field(default_factory=list)
    tubes: list[Tube] = field(default_factory=list)
    eyes: list[tuple[np.ndarray, float]] = field(default_factory=list)
    keypoints: dict[str, tuple[np.ndarray, str, float]] = field(default_factory=dict)

    def joint(self, name: str, parent: str | None, place: np.ndarray) -> None:
        """Add a bone that turns about ``place``."""
        self.joints[name], self.parents[name] = np.asarray(place, float), parent

    def mark(self, name: str, place: np.ndarray, bone: str, depth: float) -> None:
        """Record a keypoint; ``depth`` is how deep it may lie under the surface and still count as visible."""
        self.keypoints[name] = (np.asarray(place, float), bone, depth)

    def flesh(
        self, bone: str, start: np.ndarray, end: np.ndarray, radii: tuple[float, float], *,
        width: float = 1.0, blend: float = 0.1, group: int = 0, material: str = "skin",
    ) -> None:  # fmt: skip
        """Add a round cone."""
        start, end = np.asarray(start, float), np.asarray(end, float)
        self.cones.append(Cone(start, end, radii, width, blend, group, bone, material))


def point(side: float, up: float, forward: float) -> np.ndarray:
    """(x, y, z)."""
    return np.array([side, up, forward], float)


def build_body(anatomy: Anatomy) -> Body:
    """Skeleton and flesh of one individual, standing at rest on y = 0."""
    body = Body()
    _trunk(body, anatomy)
    _neck_and_head(body, anatomy)
    for side, sign in SIDES:
        _front_leg(body, anatomy, side, sign)
        _back_leg(body, anatomy, side, sign)
    _tail(body, anatomy)
    for bump in anatomy.bumps:
        root = body.joints[bump.bone]
        for sign in (1.0, -1.0) if bump.side else (1.0,):
            start, end = (root * (0, 1, 1) + point(sign * bump.side, *offset) for offset in (bump.start, bump.end))
            body.flesh(bump.bone, start, end, bump.radii, width=bump.width, blend=0.08, material=bump.material)
    return body


def _trunk(body: Body, a: Anatomy) -> None:
    front, rear = 0.5 * a.length, -0.5 * a.length
    chest = point(0, 1 - 0.5 * a.chest, front - 0.42 * a.chest)
    hips = point(0, a.croup - 0.5 * a.rump, rear + 0.5 * a.rump)
    back = 0.5 * (1 + a.croup) + a.arch
    belly = point(0, back - 0.5 * a.belly, 0.5 * (chest[2] + hips[2]))
    body.joint("pelvis", None, hips)
    body.joint("loin", "pelvis", belly * (0, 1, 1) + point(0, 0.15 * a.belly, -0.1 * a.length))
    body.joint("chest", "loin", 0.6 * chest + 0.4 * belly)
    blend = 0.25 * a.chest
    body.flesh("chest", chest, 0.45 * chest + 0.55 * belly, (0.5 * a.chest, 0.25 * (a.chest + a.belly)), width=a.width, blend=blend)
    body.flesh("loin", 0.45 * chest + 0.55 * belly, belly, (0.25 * (a.chest + a.belly), 0.5 * a.belly), width=a.width, blend=blend)
    body.flesh("pelvis", belly, hips, (0.49 * a.belly, 0.5 * a.rump), width=a.width, blend=blend)
    withers = point(0, 1 - 0.25 * a.chest, front - 0.62 * a.chest)
    body.flesh("chest", withers, withers + point(0, 0, -0.2 * a.chest), (0.25 * a.chest, 0.2 * a.chest), width=0.7, blend=blend)
    body.mark("withers", point(0, 1.0, front - 0.6 * a.chest), "chest", 0.06)


def head_frame(a: Anatomy, poll: np.ndarray) -> "HeadFrame":
    """The frame in which ears, horns and eyes are placed."""
    angle = np.radians(a.head_deg)
    along = point(0, -np.sin(angle), np.cos(angle))
    up = point(0, np.cos(angle), np.sin(angle))
    return HeadFrame(poll, up, along, a.head)


@dataclass(frozen=True)
class HeadFrame:
    """Head coordinates ``(side, up, along)`` in head lengths -> rest frame."""

    poll: np.ndarray
    up: np.ndarray
    along: np.ndarray
    scale: float

    def direction(self, side: float, up: float, along: float) -> np.ndarray:
        """A vector of the rest frame, still in head lengths."""
        return point(side, 0, 0) + up * self.up + along * self.along

    def place(self, side: float, up: float, along: float) -> np.ndarray:
        """A point of the rest frame."""
        return self.poll + self.scale * self.direction(side, up, along)


def _neck_and_head(body: Body, a: Anatomy) -> None:
    angle = np.radians(a.neck_deg)
    root = point(0, 1 - a.neck_drop * a.chest, 0.5 * a.length - 0.45 * a.chest)
    axis, normal = point(0, np.sin(angle), np.cos(angle)), point(0, np.cos(angle), -np.sin(angle))
    steps = np.linspace(0, 1, 4)
    line = [root + a.neck_length * (t * axis + 4 * t * (1 - t) * a.neck_arch * normal) for t in steps]
    parent = "chest"
    for i in range(3):
        body.joint(f"neck{i}", parent, line[i])
        radii = tuple(a.neck_root + (a.neck_top - a.neck_root) * steps[j] ** 0.8 for j in (i, i + 1))
        body.flesh(f"neck{i}", line[i], line[i + 1], radii, width=a.neck_width, blend=0.8 * a.neck_root)
        if a.crest:
            ridge = [line[j] + normal * (r + 0.25 * a.crest) for j, r in zip((i, i + 1), radii, strict=True)]
            body.flesh(f"neck{i}", *ridge, (a.crest, a.crest), width=0.4, blend=0.02, material="mane")
        parent = f"neck{i}"
    body.joint("head", "neck2", line[3])
    frame = head_frame(a, line[3])
    _head(body, a, frame)
    throat = 0.75 * line[3] + 0.25 * line[2] - normal * a.neck_top * 0.95
    body.mark("throat", throat, "neck2", 0.08 * (a.neck_top / 0.1))
    for horn in a.horns:
        _horn(body, frame, horn)
    _ears(body, frame, a.ear)


def _head(body: Body, a: Anatomy, frame: HeadFrame) -> None:
    scale, width, blend = a.head, a.head_width, 0.22 * a.head
    skull = frame.place(0, 0, 0.8 * a.skull)
    brow = frame.place(0, -0.2 * a.muzzle_drop, a.muzzle_start)
    tip = frame.place(0, -a.muzzle_drop, 1 - a.muzzle[1])
    body.flesh("head", skull, brow, (a.skull * scale, 0.8 * a.skull * scale), width=width, blend=blend, material="face")
    start = frame.place(0, -a.muzzle_drop * 0.75, a.muzzle_start)
    radii = (a.muzzle[0] * scale, a.muzzle[1] * scale)
    body.flesh("head", start, tip, radii, width=width, blend=0.6 * blend, material="muzzle")
    cheek = frame.place(0, -0.5 * a.skull, a.skull + 0.12)
    body.flesh("head", cheek, start - 0.3 * a.muzzle[0] * scale * frame.up, (a.jaw * scale, 0.8 * radii[0]), width=width, blend=blend,
               material="face")  # fmt: skip
    button = 0.72 * a.muzzle[1] if a.hoof else min(0.72 * a.muzzle[1], 0.085)
    nose = frame.place(0, -a.muzzle_drop + 0.45 * (a.muzzle[1] - 0.5 * button), 1 - 0.5 * button)
    body.flesh("head", nose, nose, (button * scale,) * 2, width=0.9 * width, blend=0.4 * button * scale, material="nose")
    body.mark("nose", frame.place(0, -a.muzzle_drop + 0.3 * a.muzzle[1], 1.0), "head", 0.25 * a.muzzle[1] * scale + 0.02)
    for side, sign in SIDES:
        place = frame.place(sign * 0.02, *a.eye)
        body.eyes.append((place, sign * a.eye_radius * scale))
        body.mark(f"{side}_eye", place, "head", 1.5 * a.eye_radius * scale + 0.01)
    previous, parent = tip, "head"
    lengths = np.linspace(0, a.proboscis, 6)
    for i in range(5 if a.proboscis else 0):
        body.joint(f"proboscis{i}", parent, previous)
        parent = f"proboscis{i}"
        following = tip + point(0, -lengths[i + 1], 0.16 * np.sqrt(lengths[i + 1]))
        r = [radii[1] * (1 - 0.62 * t / 5) for t in (i, i + 1)]
        body.flesh(parent, previous, following, (r[0], r[1]), blend=0.05, material="trunk")
        previous = following


def _horn(body: Body, frame: HeadFrame, horn: Horn) -> None:
    for sign in (1.0, -1.0) if horn.paired else (1.0,):
        path = np.stack([frame.place(sign * s, u, f) for s, u, f in horn.path])
        path = _resample(path, 4 * len(path))
        fade = np.linspace(1, 0, len(path)) ** 0.8
        radius = horn.radius * frame.scale * (horn.tip + (1 - horn.tip) * fade)
        axes = np.stack([radius, radius], -1)
        body.tubes.append(Tube(path, axes, point(1, 0.01, 0.02), ("head",), (horn.material,)))


PROFILES = {
    "leaf": lambda t: np.sin(np.pi * (0.12 + 0.83 * t)) ** 0.8,
    "triangle": lambda t: 1.0 - 0.9 * t,
    "round": lambda t: np.sqrt(np.clip(1 - (1.5 * t - 0.55) ** 2, 0.02, 1)),
}
"""Half width of an ear along its length, relative to half its width."""


def _ears(body: Body, frame: HeadFrame, ear: Ear) -> None:
    steps = np.linspace(0, 1, 12)
    half = 0.5 * ear.width * PROFILES[ear.profile](steps)
    for side, sign in SIDES:
        root = frame.place(sign * ear.place[0], *ear.place[1:])
        direction = frame.direction(sign * ear.direction[0], *ear.direction[1:])
        direction /= np.linalg.norm(direction)
        body.joint(f"{side}_ear", "head", root)
        facing = frame.direction(sign * ear.facing[0], *ear.facing[1:])
        wide = np.cross(direction, facing)
        path = root + steps[:, None] * direction * ear.length * frame.scale
        thick = ear.thickness * np.sqrt(np.clip(half / half.max(), 0, 1))
        axes = frame.scale * np.stack([half, thick], -1)
        body.tubes.append(Tube(path, axes, wide, (f"{side}_ear",), ("ear",)))
        body.mark(f"{side}_ear", root + 0.3 * ear.length * frame.scale * direction, f"{side}_ear", 0.05 * frame.scale + 0.02)


def _front_leg(body: Body, a: Anatomy, side: str, sign: float) -> None:
    group = 1 if sign > 0 else 2
    clearance = 1 - a.chest
    bent = 0.09 * a.angulation
    z = 0.5 * a.length - 0.45 * a.chest
    half = 0.5 * a.chest * a.width
    shoulder = point(sign * 0.72 * half, 1 - 0.5 * a.chest, z + 0.6 * bent)
    elbow = point(sign * 0.8 * max(half, a.stance), clearance + 0.04, z - bent)
    knee = point(sign * a.stance, a.knee, z - 0.35 * bent)
    fetlock = point(sign * a.stance, a.fetlock, z - 0.45 * bent)
    names = [f"{side}_front_{part}" for part in ("shoulder", "elbow", "knee", "foot")]
    for name, parent, place in zip(names, ("chest", *names[:3]), (shoulder, elbow, knee, fetlock), strict=True):
        body.joint(name, parent, place)
    body.flesh(names[0], shoulder, elbow, (a.shoulder, 1.05 * a.forearm), width=0.62, blend=0.12, group=group)
    body.flesh(names[1], elbow, knee, (a.forearm, 1.2 * a.cannon), width=0.85, blend=0.06, group=group)
    body.flesh(names[2], knee, fetlock, (1.2 * a.cannon, a.cannon), blend=0.04, group=group)
    toe = _foot(body, a, names[3], fetlock, group)
    body.mark(f"{side}_front_elbow", elbow, names[1], 1.3 * a.forearm)
    body.mark(f"{side}_front_knee", knee, names[2], 1.8 * a.cannon)
    body.mark(f"{side}_front_paw", toe, names[3], 1.6 * a.foot)


def _back_leg(body: Body, a: Anatomy, side: str, sign: float) -> None:
    group = 3 if sign > 0 else 4
    z, half = -0.5 * a.length + 0.5 * a.rump, 0.5 * a.rump * a.width
    bent = 0.13 * a.angulation
    hip = point(sign * 0.62 * half, a.croup - 0.52 * a.rump, z)
    top = a.croup - a.rump
    stifle = point(sign * 0.95 * max(0.75 * half, a.stance), max(0.9 * top, a.hock + 0.4 * (hip[1] - a.hock)), z + 0.8 * bent)
    hock = point(sign * a.stance, a.hock, z - 0.9 * bent)
    fetlock = point(sign * a.stance, a.fetlock, z - 0.55 * bent)
    names = [f"{side}_back_{part}" for part in ("hip", "stifle", "hock", "foot")]
    for name, parent, place in zip(names, ("pelvis", *names[:3]), (hip, stifle, hock, fetlock), strict=True):
        body.joint(name, parent, place)
    body.flesh(names[0], hip, stifle, (a.thigh, 0.68 * a.thigh), width=0.62, blend=0.12, group=group)
    body.flesh(names[1], stifle, hock, (0.62 * a.thigh, a.gaskin), width=0.75, blend=0.08, group=group)
    body.flesh(names[2], hock, fetlock, (1.15 * a.gaskin, 1.05 * a.cannon), blend=0.04, group=group)
    toe = _foot(body, a, names[3], fetlock, group)
    body.mark(f"{side}_back_elbow", stifle, names[1], 0.9 * a.thigh)
    body.mark(f"{side}_back_knee", hock, names[2], 1.8 * a.gaskin)
    body.mark(f"{side}_back_paw", toe, names[3], 1.6 * a.foot)


def _foot(body: Body, a: Anatomy, bone: str, fetlock: np.ndarray, group: int) -> np.ndarray:
    if a.hoof:
        toe = point(fetlock[0], 0.75 * a.foot, fetlock[2] + a.foot_length)
        body.flesh(bone, fetlock, toe, (1.12 * a.cannon, 0.9 * a.foot), blend=0.03, group=group)
        body.flesh(bone, toe, toe * (1, 0, 1) + point(0, 0.25 * a.foot, 0.4 * a.foot_length), (0.9 * a.foot, a.foot),
                   blend=0.01, group=group, material="hoof")  # fmt: skip
        return toe
    heel = point(fetlock[0], 0.8 * a.foot, fetlock[2])
    toe = point(fetlock[0], 0.62 * a.foot, fetlock[2] + a.foot_length)
    body.flesh(bone, fetlock, heel, (a.cannon, a.foot), blend=0.05, group=group, material="sock")
    body.flesh(bone, heel, toe, (0.95 * a.foot, 0.8 * a.foot), width=1.15, blend=0.04, group=group, material="sock")
    return toe


def _tail(body: Body, a: Anatomy) -> None:
    tail = a.tail
    root = point(0, a.croup - 0.2 * a.rump, -0.5 * a.length + 0.07 * a.rump)
    angles = np.radians(tail.angle_deg + tail.curl_deg * np.linspace(0, 1, 16))
    steps = tail.length / 16 * np.stack([0 * angles, np.sin(angles), -np.cos(angles)], -1)
    path = np.concatenate([root[None], root + np.cumsum(steps, 0)])
    parent = "pelvis"
    for i in range(4):
        body.joint(f"tail{i}", parent, path[4 * i])
        parent = f"tail{i}"
    radius = np.interp(np.linspace(0, 1, 17), (0, 0.5, 0.75, 1.0), tail.radii)
    materials = tuple("tuft" if t >= 1 - tail.tuft else "skin" for t in np.linspace(0, 1, 17))
    bones = tuple(f"tail{i}" for i in range(4))
    body.tubes.append(Tube(path, np.stack([radius, radius], -1), point(1, 0, 0), bones, materials))
    body.mark("tailbase", root + point(0, 0.3 * tail.radii[0], 0), "pelvis", 0.09 * a.rump / 0.4 + tail.radii[0])


def _resample(path: np.ndarray, count: int) -> np.ndarray:
    """Smooth curve through the points (Catmull-Rom) at ``count`` even parameters."""
    padded = np.concatenate([2 * path[:1] - path[1:2], path, 2 * path[-1:] - path[-2:-1]])
    at = np.linspace(0, len(path) - 1, count)
    i = np.minimum(at.astype(int), len(path) - 2)
    t = (at - i)[:, None]
    p0, p1, p2, p3 = (padded[i + j] for j in range(4))
    return 0.5 * (2 * p1 + (p2 - p0) * t + (2 * p0 - 5 * p1 + 4 * p2 - p3) * t**2 + (3 * p1 - p0 - 3 * p2 + p3) * t**3)
