"""From proportions to a body: trunk, legs and tail; see ``head`` for the rest."""

import numpy as np

from fauna.kernels.zoo_raster import cone_distances
from fauna.zoo.anatomy import Anatomy
from fauna.zoo.body import SIDES, Body, Tube, point
from fauna.zoo.head import neck_and_head


def build_body(anatomy: Anatomy) -> Body:
    """Skeleton and flesh of one individual, standing at rest on y = 0."""
    body = Body()
    _trunk(body, anatomy)
    neck_and_head(body, anatomy)
    for side, sign in SIDES:
        _front_leg(body, anatomy, side, sign)
        _back_leg(body, anatomy, side, sign)
    _tail(body, anatomy)
    for bump in anatomy.bumps:
        root = body.joints[bump.bone]
        for sign in (1.0, -1.0) if bump.side else (1.0,):
            start, end = (root * (0, 1, 1) + point(sign * bump.side, *offset) for offset in (bump.start, bump.end))
            body.flesh(bump.bone, start, end, bump.radii, width=bump.width, blend=0.08, material=bump.material)
    _seat(body, anatomy)
    return body


def _seat(body: Body, a: Anatomy) -> None:
    """Move eyes and skin keypoints out to the surface of the flesh."""
    for (side, sign), (place, radius) in zip(SIDES, tuple(body.eyes), strict=True):
        edge = _exit(body, place * (0, 1, 1), point(sign, 0.0, 0.0), ("head",))
        body.eyes[0 if sign > 0 else 1] = (edge - point(sign * 0.25 * radius, 0.0, 0.0), radius)
        body.mark(f"{side}_eye", edge, "head", radius)
    neck = body.joints["head"] - body.joints["neck2"]
    down = point(0.0, -neck[2], neck[1]) / np.linalg.norm(neck)
    for name, direction, bones in (
        ("withers", point(0.0, 1.0, 0.0), ("chest", "loin")),
        ("throat", down, ("neck1", "neck2", "head")),
    ):
        place, bone, depth = body.keypoints[name]
        body.mark(name, _exit(body, place, direction, bones), bone, depth)


def _exit(body: Body, start: np.ndarray, direction: np.ndarray, bones: tuple[str, ...]) -> np.ndarray:
    """Where a ray from inside the flesh of some bones leaves it; ``start`` when it begins outside."""
    rows = np.array([[*c.start, *c.end, *c.radii, c.width] for c in body.cones if c.bone in bones])
    line = start + np.linspace(0, 0.8, 801)[:, None] * direction
    outside = cone_distances(line, rows).min(1) > 0
    return line[outside.argmax()]


def _trunk(body: Body, a: Anatomy) -> None:
    front, rear = 0.5 * a.length, -0.5 * a.length
    chest = point(0.0, 1 - 0.5 * a.chest, front - 0.42 * a.chest)
    hips = point(0.0, a.croup - 0.5 * a.rump, rear + 0.5 * a.rump)
    back = 0.5 * (1 + a.croup) + a.arch
    belly = point(0.0, back - 0.5 * a.belly, 0.5 * (chest[2] + hips[2]))
    body.joint("pelvis", None, hips)
    body.joint("loin", "pelvis", belly * (0, 1, 1) + point(0.0, 0.15 * a.belly, -0.1 * a.length))
    body.joint("chest", "loin", 0.6 * chest + 0.4 * belly)
    blend = 0.25 * a.chest
    body.flesh(
        "chest",
        chest,
        0.45 * chest + 0.55 * belly,
        (0.5 * a.chest, 0.25 * (a.chest + a.belly)),
        width=a.width,
        blend=blend,
    )
    body.flesh(
        "loin",
        0.45 * chest + 0.55 * belly,
        belly,
        (0.25 * (a.chest + a.belly), 0.5 * a.belly),
        width=a.width,
        blend=blend,
    )
    body.flesh("pelvis", belly, hips, (0.49 * a.belly, 0.5 * a.rump), width=a.width, blend=blend)
    withers = point(0.0, 1 - 0.25 * a.chest, front - 0.62 * a.chest)
    body.flesh(
        "chest",
        withers,
        withers + point(0.0, 0.0, -0.2 * a.chest),
        (0.25 * a.chest, 0.2 * a.chest),
        width=0.7,
        blend=blend,
    )
    body.mark("withers", point(0.0, 1 - 0.25 * a.chest, front - 0.6 * a.chest), "chest", 0.18 * a.chest)


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
    stifle = point(
        sign * 0.95 * max(0.75 * half, a.stance), max(0.9 * top, a.hock + 0.4 * (hip[1] - a.hock)), z + 0.8 * bent
    )
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
        body.flesh(bone, toe, toe * (1, 0, 1) + point(0.0, 0.5 * a.foot, 0.4 * a.foot_length), (0.9 * a.foot, a.foot),
                   blend=0.01, group=group, material="hoof")  # fmt: skip
        return toe
    heel = point(fetlock[0], 0.8 * a.foot, fetlock[2])
    toe = point(fetlock[0], 0.62 * a.foot, fetlock[2] + a.foot_length)
    body.flesh(bone, fetlock, heel, (a.cannon, a.foot), blend=0.05, group=group, material="sock")
    body.flesh(bone, heel, toe, (0.95 * a.foot, 0.8 * a.foot), width=1.15, blend=0.04, group=group, material="sock")
    return toe


def _tail(body: Body, a: Anatomy) -> None:
    tail = a.tail
    root = point(0.0, a.croup - 0.2 * a.rump, -0.5 * a.length + 0.07 * a.rump)
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
    body.tubes.append(Tube(path, np.stack([radius, radius], -1), point(1.0, 0.0, 0.0), bones, materials))
    body.mark("tailbase", root + point(0.0, 0.3 * tail.radii[0], 0.0), "pelvis", 0.09 * a.rump / 0.4 + tail.radii[0])
