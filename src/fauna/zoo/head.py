"""From proportions to a neck and a head: skull, muzzle, eyes, ears, horns and an elephant's trunk."""

from dataclasses import dataclass

import numpy as np

from fauna.zoo.anatomy import Anatomy, Ear, Horn
from fauna.zoo.body import SIDES, Body, Tube, point


@dataclass(frozen=True)
class HeadFrame:
    """Head coordinates ``(side, up, along)`` in head lengths -> rest frame."""

    poll: np.ndarray
    up: np.ndarray
    along: np.ndarray
    scale: float

    def direction(self, side: float, up: float, along: float) -> np.ndarray:
        """A vector of the rest frame, still in head lengths."""
        return point(side, 0.0, 0.0) + up * self.up + along * self.along

    def place(self, side: float, up: float, along: float) -> np.ndarray:
        """A point of the rest frame."""
        return self.poll + self.scale * self.direction(side, up, along)


def head_frame(a: Anatomy, poll: np.ndarray) -> HeadFrame:
    """The frame in which ears, horns and eyes are placed."""
    angle = np.radians(a.head_deg)
    along = point(0.0, -np.sin(angle), np.cos(angle))
    up = point(0.0, np.cos(angle), np.sin(angle))
    return HeadFrame(poll, up, along, a.head)


def neck_and_head(body: Body, a: Anatomy) -> None:
    """Add everything in front of the withers; the chest must be there."""
    angle = np.radians(a.neck_deg)
    root = point(0.0, 1 - a.neck_drop * a.chest, 0.5 * a.length - 0.45 * a.chest)
    axis, normal = point(0.0, np.sin(angle), np.cos(angle)), point(0.0, np.cos(angle), -np.sin(angle))
    steps = np.linspace(0, 1, 4)
    line = [root + a.neck_length * (t * axis + 4 * t * (1 - t) * a.neck_arch * normal) for t in steps]
    parent = "chest"
    for i in range(3):
        body.joint(f"neck{i}", parent, line[i])
        near, far = (a.neck_root + (a.neck_top - a.neck_root) * steps[j] ** 0.8 for j in (i, i + 1))
        body.flesh(f"neck{i}", line[i], line[i + 1], (near, far), width=a.neck_width, blend=0.8 * a.neck_root)
        if a.crest:
            start, end = line[i] + normal * (near + 0.25 * a.crest), line[i + 1] + normal * (far + 0.25 * a.crest)
            body.flesh(f"neck{i}", start, end, (a.crest, a.crest), width=0.4, blend=0.02, material="mane")
        parent = f"neck{i}"
    body.joint("head", "neck2", line[3])
    frame = head_frame(a, line[3])
    _head(body, a, frame)
    body.mark("throat", 0.8 * line[3] + 0.2 * line[2], "neck2", 0.5 * a.neck_top)
    for horn in a.horns:
        _horn(body, frame, horn)
    _ears(body, frame, a.ear)


def _head(body: Body, a: Anatomy, frame: HeadFrame) -> None:
    scale, width, blend = a.head, a.head_width, 0.22 * a.head
    skull = frame.place(0.0, 0.0, 0.8 * a.skull)
    brow = frame.place(0.0, -0.2 * a.muzzle_drop, a.muzzle_start)
    tip = frame.place(0.0, -a.muzzle_drop, 1 - a.muzzle[1])
    body.flesh("head", skull, brow, (a.skull * scale, 0.8 * a.skull * scale), width=width, blend=blend, material="face")
    start = frame.place(0.0, -a.muzzle_drop * 0.75, a.muzzle_start)
    radii = (a.muzzle[0] * scale, a.muzzle[1] * scale)
    body.flesh("head", start, tip, radii, width=width, blend=0.6 * blend, material="muzzle")
    cheek = frame.place(0.0, -0.5 * a.skull, a.skull + 0.12)
    body.flesh("head", cheek, start - 0.3 * a.muzzle[0] * scale * frame.up, (a.jaw * scale, 0.8 * radii[0]), width=width, blend=blend,
               material="face")  # fmt: skip
    button = 0.72 * a.muzzle[1] if a.hoof else min(0.72 * a.muzzle[1], 0.085)
    nose = frame.place(0.0, -a.muzzle_drop + 0.45 * (a.muzzle[1] - 0.5 * button), 1 - 0.5 * button)
    body.flesh(
        "head",
        nose,
        nose,
        (button * scale, button * scale),
        width=0.9 * width,
        blend=0.4 * button * scale,
        material="nose",
    )
    body.mark(
        "nose", frame.place(0.0, -a.muzzle_drop + 0.3 * a.muzzle[1], 1.0), "head", 0.4 * a.muzzle[1] * scale + 0.02
    )
    for _ in SIDES:
        body.eyes.append((frame.place(0.0, *a.eye), a.eye_radius * scale))
    _proboscis(body, a, tip, radii[1])


def _proboscis(body: Body, a: Anatomy, tip: np.ndarray, radius: float) -> None:
    previous, parent = tip, "head"
    lengths = np.linspace(0, a.proboscis, 6)
    for i in range(5 if a.proboscis else 0):
        body.joint(f"proboscis{i}", parent, previous)
        parent = f"proboscis{i}"
        following = tip + point(0.0, -lengths[i + 1], 0.16 * np.sqrt(lengths[i + 1]))
        r = [radius * (1 - 0.62 * t / 5) for t in (i, i + 1)]
        body.flesh(parent, previous, following, (r[0], r[1]), blend=0.05, material="trunk")
        previous = following


def _horn(body: Body, frame: HeadFrame, horn: Horn) -> None:
    for sign in (1.0, -1.0) if horn.paired else (1.0,):
        path = np.stack([frame.place(sign * s, u, f) for s, u, f in horn.path])
        path = _resample(path, 4 * len(path))
        fade = np.linspace(1, 0, len(path)) ** 0.8
        radius = horn.radius * frame.scale * (horn.tip + (1 - horn.tip) * fade)
        axes = np.stack([radius, radius], -1)
        body.tubes.append(Tube(path, axes, point(1.0, 0.01, 0.02), ("head",), (horn.material,)))


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
        body.mark(
            f"{side}_ear", root + 0.3 * ear.length * frame.scale * direction, f"{side}_ear", 0.05 * frame.scale + 0.02
        )


def _resample(path: np.ndarray, count: int) -> np.ndarray:
    """Smooth curve through the points (Catmull-Rom) at ``count`` even parameters."""
    padded = np.concatenate([2 * path[:1] - path[1:2], path, 2 * path[-1:] - path[-2:-1]])
    at = np.linspace(0, len(path) - 1, count)
    i = np.minimum(at.astype(int), len(path) - 2)
    t = (at - i)[:, None]
    p0, p1, p2, p3 = (padded[i + j] for j in range(4))
    return 0.5 * (2 * p1 + (p2 - p0) * t + (2 * p0 - 5 * p1 + 4 * p2 - p3) * t**2 + (3 * p1 - p0 - 3 * p2 + p3) * t**3)
