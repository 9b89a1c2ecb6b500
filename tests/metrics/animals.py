"""A toy quadruped: a body and four legs with bones, bone-local coordinates, keypoints and a camera, in closed form."""

from dataclasses import replace

import numpy as np

from fauna.data.truth import LEGS, Truth3D
from fauna.evaluation.prediction import Prediction
from fauna.metrics.sample import Sample
from fauna.metrics.visibility import keypoint_vertices, to_ndc

SKELETON_LEG = {"left_front": 0, "left_back": 1, "right_back": 2, "right_front": 3}
NAMES = ("nose", "tailbase", *(f"{leg}_{part}" for leg in LEGS for part in ("paw", "knee")), "withers")
SIZE = 64
FOCAL = 1 / np.tan(np.radians(12.5))


def tube(rings, around):
    """A closed tube through (ring, 3) centres with (ring, 2) half axes in x and the axis across; first and last ring are caps."""
    centres, halves, across = rings
    angle = 2 * np.pi * np.arange(around) / around
    verts = [
        c + np.outer(np.cos(angle), [h[0], 0, 0]) + np.outer(np.sin(angle), h[1] * np.asarray(across))
        for c, h in zip(centres, halves, strict=True)
    ]
    count = len(verts)
    verts = np.concatenate([*verts, centres[[0, -1]]])
    a = (np.arange(count - 1)[:, None] * around + np.arange(around)).ravel()
    b = (np.arange(count - 1)[:, None] * around + (np.arange(around) + 1) % around).ravel()
    first, turn, last = np.arange(around), (np.arange(around) + 1) % around, (count - 1) * around
    faces = [
        np.stack([a, b, b + around], 1), np.stack([a, b + around, a + around], 1),
        np.stack([np.full(around, count * around), turn, first], 1),
        np.stack([np.full(around, count * around + 1), last + first, last + turn], 1),
    ]  # fmt: skip
    faces = np.concatenate(faces)
    a, b, c = (verts[faces[:, i]] for i in range(3))
    outwards = np.einsum("ij,ij->", np.cross(b - a, c - a), (a + b + c) / 3 - verts.mean(axis=0))
    return verts, faces if outwards > 0 else faces[:, ::-1]


def rest(*, length=2.4, height=1.0, rings=16, around=12):
    """Rest mesh with bones and local coordinates: (verts, faces, bone, local, keypoint positions by name)."""
    z = length * 0.5 * np.sin(np.linspace(-1, 1, rings) * np.pi / 2)
    radius = 0.45 * np.sqrt(np.maximum(1 - (z / (0.5 * length)) ** 2, 0.02)) * np.where(z > 0.3 * length, 0.7, 1.0)
    centres = np.stack([0 * z, 0 * z + 0.4 * np.maximum(z / length, 0), z], 1)
    verts, faces = tube((centres, np.stack([0.8 * radius, radius], 1), (0, 1, 0)), around)
    step = length / 8
    number = np.clip(np.floor(verts[:, 2] / step + 4), 0, 7).astype(int)  # 0 at the tail .. 7 at the head
    bone = np.where(number >= 4, 7 - number, 4 + number)
    start = np.where(number >= 4, (number - 4) * step, (number - 3) * step)
    along = np.where(number >= 4, verts[:, 2] - start, start - verts[:, 2]) / step
    parts = [(verts, faces, bone, np.stack([along, verts[:, 0] / step, verts[:, 1] / step], 1))]
    keys = {"nose": verts[-1], "tailbase": verts[-2], "withers": np.array([0, 0.45, 0.1 * length])}
    for name, leg in SKELETON_LEG.items():
        x, z = (0.25 if "left" in name else -0.25), (0.3 if "front" in name else -0.3) * length
        y = -0.2 - height * np.linspace(0, 1, 3 * max(rings // 5, 3) + 1)
        centres = np.stack([x + 0 * y, y, z + 0 * y], 1)
        verts, faces = tube((centres, np.full((len(y), 2), 0.11), (0, 0, 1)), max(around // 2, 5))
        part = np.clip(np.floor(3 * (-0.2 - verts[:, 1]) / height), 0, 2).astype(int)
        third = height / 3
        along = (-0.2 - part * third - verts[:, 1]) / third
        local = np.stack([along, (verts[:, 0] - x) / third, (verts[:, 2] - z) / third], 1)
        parts.append((verts, faces, 8 + 3 * leg + 2 - part, local))
        keys[f"{name}_paw"] = np.array([x, -0.2 - height, z])
        keys[f"{name}_knee"] = np.array([x + np.sign(x) * 0.11, -0.2 - height * 2 / 3, z])
    offsets = np.cumsum([0] + [len(p[0]) for p in parts[:-1]])
    verts, bone, local = (np.concatenate([p[i] for p in parts]) for i in (0, 2, 3))
    faces = np.concatenate([p[1] + o for p, o in zip(parts, offsets, strict=True)])
    return verts, faces, bone, local, np.stack([keys[name] for name in NAMES])


def pose(points, legs, angles):
    """Swing each leg about its hip in the sagittal plane."""
    out = points.copy()
    for leg, angle in enumerate(angles):
        mine = legs == leg
        pivot = np.array([0, -0.2, points[mine, 2].mean()])
        c, s = np.cos(angle), np.sin(angle)
        turn = np.array([[1, 0, 0], [0, c, -s], [0, s, c]])
        out[mine] = (points[mine] - pivot) @ turn.T + pivot
    return out


def camera(azimuth_deg, elevation_deg=5.0, *, shift=(0.0, 0.0), distance=10.0, focal=FOCAL):
    """(camera_from_world, clip_from_world) of a camera around the origin."""
    a, e = np.radians([azimuth_deg, elevation_deg])
    back = np.array([-np.sin(a) * np.cos(e), np.sin(e), np.cos(a) * np.cos(e)])
    right = np.cross([0, 1, 0], back) / np.cos(e)
    view = np.eye(4)
    view[:3, :3] = np.stack([right, np.cross(back, right), back])
    view[:3, 3] = [*shift, -distance]
    far, near = 1000, 0.1
    clip = np.array(
        [[focal, 0, 0, 0], [0, -focal, 0, 0], [0, 0, -(far + near) / (far - near), -2 * far * near / (far - near)], [0, 0, -1, 0]]
    )  # fmt: skip
    return view, clip @ view


def animal(name, category="dog", *, azimuth_deg=70.0, angles=(0.0, 0.0, 0.0, 0.0), shift=(0.0, 0.0), **shape):
    """A perfect prediction and its sample: keypoints are annotated where the surface near them is seen."""
    verts, faces, bone, local, keys = rest(**shape)
    legs = np.array(
        [LEGS.index(next(k for k, v in SKELETON_LEG.items() if v == (b - 8) // 3)) if b >= 8 else -1 for b in bone]
    )
    key_legs = np.array([next((i for i, leg in enumerate(LEGS) if n.startswith(leg)), -1) for n in NAMES])
    posed = pose(verts, legs, angles)
    stacked = pose(np.concatenate([verts, keys]), np.concatenate([legs, key_legs]), angles)
    posed, keys = stacked[: len(verts)], stacked[len(verts) :]
    view, clip = camera(azimuth_deg, shift=shift)
    prediction = Prediction(
        name, category, posed, verts, faces, bone, local, view, clip, np.zeros((SIZE, SIZE), np.uint8),
        np.array([1.0]), view[:3, 2][None], np.zeros((20, 3)),
    )  # fmt: skip
    mask = covered(prediction)
    prediction = replace(prediction, silhouette=(mask * 255).astype(np.uint8))
    seen = keypoint_vertices(prediction, np.column_stack([to_ndc(clip, keys), np.ones(len(keys))]))
    near = np.linalg.norm(posed[seen] - keys, axis=1) < 0.3
    truth = Truth3D(view, clip, float(azimuth_deg), 5.0, posed, faces, legs, keys)
    return prediction, Sample(name, category, mask, np.column_stack([to_ndc(clip, keys), near]), NAMES, truth)


def covered(prediction):
    import torch

    from fauna.metrics.visibility import project
    from fauna.renderer.numba_backend import NumbaRenderer

    clip = torch.from_numpy(project(prediction.clip_from_world, prediction.verts))[None]
    faces = torch.from_numpy(np.ascontiguousarray(prediction.faces))
    return NumbaRenderer().rasterize(clip, faces, SIZE, SIZE).covered[0].numpy()


def herd(count, category="dog", seed=0, **shape):
    """Different animals of one species in different poses and views, as (predictions, samples)."""
    rng = np.random.default_rng(seed)
    found = [
        animal(
            f"{category}/{i:03d}", category, azimuth_deg=rng.uniform(-180, 180), angles=rng.normal(0, 0.2, 4),
            length=shape.get("length") or rng.uniform(2.2, 2.7), height=shape.get("height") or rng.uniform(0.9, 1.2),
            rings=shape.get("rings") or int(rng.integers(14, 19)), around=shape.get("around") or 2 * int(rng.integers(5, 8)),
        )
        for i in range(count)
    ]  # fmt: skip
    return [p for p, _ in found], [s for _, s in found]
