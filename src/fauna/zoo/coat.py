"""Coats: colours of every material and patterns painted in the rest frame, so that they stick to the animal."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.spatial import KDTree

from fauna.kernels.zoo_raster import value_noise
from fauna.zoo.anatomy import Anatomy
from fauna.zoo.body import Body
from fauna.zoo.products import dot
from fauna.zoo.surface import Surface


@dataclass(frozen=True, kw_only=True)
class Coat:
    """Colours as ``#rrggbb``; what is empty takes the colour of the skin.

    Attributes:
        skin: back and sides.
        belly: underside, faded in.
        belly_height: where the fade ends, -1 (only straight below) to 1 (everywhere).
        legs: below elbow and stifle, faded in.
        parts: colour by material.
        pattern: ``"plain"`` or the name of a painter of this module.
        marks: colour of the pattern.
        scale: size of the pattern, withers heights.
    """

    skin: str
    belly: str = ""
    belly_height: float = -0.35
    legs: str = ""
    parts: tuple[tuple[str, str], ...] = ()
    pattern: str = "plain"
    marks: str = "#181410"
    scale: float = 0.1


EYE, PUPIL = "#2c1a0c", "#060504"


def linear(colour: str) -> np.ndarray:
    """Linear RGB of ``#rrggbb``."""
    return (np.array([int(colour[i : i + 2], 16) for i in (1, 3, 5)]) / 255.0) ** 2.2


def smoothstep(low: float, high: float, value: np.ndarray) -> np.ndarray:
    """0 below ``low``, 1 above ``high``, smooth between."""
    t = np.clip((value - low) / (high - low), 0, 1)
    return t * t * (3 - 2 * t)


def paint(
    coat: Coat, body: Body, surface: Surface, anatomy: Anatomy, normals: np.ndarray, rng: np.random.Generator
) -> Float[np.ndarray, "vert 3"]:
    """Linear albedo of every vertex of an individual.

    Args:
        coat: what to paint.
        body: its joints give the lengths along limbs.
        surface: rest mesh.
        anatomy: proportions.
        normals: (vert, 3) of the rest mesh.
        rng: consumed: individual shade, place of the patches.
    """
    verts = surface.verts
    skin = linear(coat.skin) * rng.uniform(0.82, 1.18) * rng.uniform(0.95, 1.05, 3)
    seed = int(rng.integers(2**30))
    mottle = value_noise(verts * 9.0, 3, seed)[:, None]
    colour = skin * (0.8 + 0.4 * mottle)
    leg = _weight_of(surface, body, ("elbow", "knee", "foot", "stifle", "hock"))
    if coat.legs:
        low = smoothstep(0.62, 0.12, verts[:, 1] / max(1 - anatomy.chest, 0.3))[:, None] * leg[:, None]
        colour = colour + (linear(coat.legs) - colour) * low
    if coat.pattern != "plain":
        amount = PATTERNS[coat.pattern](verts, leg, body, surface, coat.scale, seed)[:, None]
        colour = colour + (linear(coat.marks) * (0.85 + 0.3 * mottle) - colour) * amount
    if coat.belly:
        under = smoothstep(
            coat.belly_height + 0.35, coat.belly_height - 0.25, normals[:, 1] + 0.25 * (mottle[:, 0] - 0.5)
        )
        under *= smoothstep(0.05, 0.25, verts[:, 1]) * (1 - 0.8 * leg)
        colour = colour + (linear(coat.belly) - colour) * under[:, None]
    parts = {"eye": EYE, "pupil": PUPIL} | dict(coat.parts)
    for index, name in enumerate(surface.material_names):
        if name in parts:
            colour[surface.materials == index] = linear(parts[name]) * (0.85 + 0.3 * mottle[surface.materials == index])
    return np.clip(colour, 0.002, 0.95)


def _weight_of(surface: Surface, body: Body, parts: tuple[str, ...]) -> np.ndarray:
    chosen = [i for i, name in enumerate(body.joints) if name.rsplit("_", 1)[-1] in parts]
    return surface.weights[:, chosen].sum(1)


def _head_and_neck(surface: Surface, body: Body) -> tuple[np.ndarray, np.ndarray]:
    chosen = [i for i, name in enumerate(body.joints) if name.startswith("neck")]
    head = [i for i, name in enumerate(body.joints) if name == "head" or name.endswith("ear")]
    return surface.weights[:, head].sum(1), surface.weights[:, chosen].sum(1)


def _bands(coordinate: np.ndarray, scale: float, width: float) -> np.ndarray:
    wave = np.sin(2 * np.pi * coordinate / scale)
    return smoothstep(-width - 0.25, -width + 0.25, wave)


def _stripes(verts: np.ndarray, leg: np.ndarray, body: Body, surface: Surface, scale: float, seed: int) -> np.ndarray:
    """Zebra: upright on the trunk, leaning over the rump, across neck and legs, along nothing."""
    wobble = scale * 1.1 * (value_noise(verts * 3.5, 2, seed) - 0.5)
    hips, neck, poll = body.joints["pelvis"], body.joints["neck0"], body.joints["head"]
    lean = np.clip((hips[2] + 0.12 - verts[:, 2]) / 0.3, 0, 1)
    trunk = _bands(verts[:, 2] - lean * 0.9 * (verts[:, 1] - hips[1]) + wobble, 1.05 * scale, 0.0)
    axis = (poll - neck) / np.linalg.norm(poll - neck)
    on_neck = _bands(dot(verts - neck, axis) + wobble, 0.8 * scale, 0.0)
    nose = body.keypoints["nose"][0] - poll
    along = dot(verts - poll, nose / np.linalg.norm(nose))
    on_head = _bands(along + 0.8 * np.abs(verts[:, 0]) + 0.3 * wobble, 0.42 * scale, 0.0)
    on_leg = _bands(verts[:, 1] + 0.5 * wobble, 0.6 * scale, 0.1)
    head_share, neck_share = _head_and_neck(surface, body)
    rest = np.clip(1 - leg - head_share - neck_share, 0, 1)
    return smoothstep(0.3, 0.7, rest * trunk + neck_share * on_neck + head_share * on_head + leg * on_leg)


def _tiger(verts: np.ndarray, leg: np.ndarray, body: Body, surface: Surface, scale: float, seed: int) -> np.ndarray:
    """Narrow broken upright stripes, stronger on the back."""
    wobble = scale * 1.7 * (value_noise(verts * 3.0, 2, seed) - 0.5)
    coordinate = np.where(leg > 0.5, 0.8 * verts[:, 1], verts[:, 2]) + wobble
    gaps = smoothstep(0.28, 0.42, value_noise(verts * np.array([5.0, 4.0, 4.0]), 2, seed + 9))
    nose = np.linalg.norm(verts - body.keypoints["nose"][0], axis=1)
    return (
        _bands(coordinate, scale, 0.12)
        * gaps
        * (0.55 + 0.45 * smoothstep(0.25, 0.7, verts[:, 1]))
        * smoothstep(0.12, 0.24, nose)
    )


def _patches(verts: np.ndarray, leg: np.ndarray, body: Body, surface: Surface, scale: float, seed: int) -> np.ndarray:
    """Cow: a few large blots."""
    return smoothstep(0.495, 0.515, value_noise(verts / scale * np.array([0.8, 1, 1]), 2, seed)) * (
        1 - 0.9 * smoothstep(0.35, 0.15, verts[:, 1])
    )


def _net(verts: np.ndarray, leg: np.ndarray, body: Body, surface: Surface, scale: float, seed: int) -> np.ndarray:
    """Giraffe: polygons with pale seams, fading down the legs."""
    distance = _cells(verts, scale, seed)
    head_share, _ = _head_and_neck(surface, body)
    fade = smoothstep(0.12, 0.35, verts[:, 1]) * (1 - 0.7 * head_share)
    return smoothstep(0.10, 0.2, distance[:, 1] - distance[:, 0]) * fade


def _spots(verts: np.ndarray, leg: np.ndarray, body: Body, surface: Surface, scale: float, seed: int) -> np.ndarray:
    """Small round dots."""
    return smoothstep(0.36, 0.28, _cells(verts, scale, seed)[:, 0])


def _dapples(verts: np.ndarray, leg: np.ndarray, body: Body, surface: Surface, scale: float, seed: int) -> np.ndarray:
    """Fallow deer: pale dots on the back only."""
    head_share, neck_share = _head_and_neck(surface, body)
    back = smoothstep(0.62, 0.74, verts[:, 1]) * (1 - leg) * (1 - head_share) * (1 - 0.8 * neck_share)
    return smoothstep(0.33, 0.24, _cells(verts, scale, seed)[:, 0]) * back


def _cells(verts: np.ndarray, scale: float, seed: int) -> np.ndarray:
    """Distances to the two nearest of random seeds on the surface, in units of ``scale``."""
    rng = np.random.default_rng(seed)
    order = rng.permutation(len(verts))
    chosen: list[int] = []
    tree = KDTree(verts)
    free = np.ones(len(verts), bool)
    for i in order:
        if free[i]:
            chosen.append(int(i))
            free[tree.query_ball_point(verts[i], 0.8 * scale)] = False
    return KDTree(verts[chosen]).query(verts, k=2)[0] / scale


def _saddle(verts: np.ndarray, leg: np.ndarray, body: Body, surface: Surface, scale: float, seed: int) -> np.ndarray:
    """Dark back that frays down the sides."""
    noise = value_noise(verts / scale, 3, seed) - 0.5
    return smoothstep(0.70, 0.92, verts[:, 1] + 0.35 * noise) * 0.85 * (1 - leg)


def _points(verts: np.ndarray, leg: np.ndarray, body: Body, surface: Surface, scale: float, seed: int) -> np.ndarray:
    """Dark face and feet."""
    nose = body.keypoints["nose"][0]
    face = smoothstep(2.2 * scale, 0.8 * scale, np.linalg.norm(verts - nose, axis=1))
    return np.maximum(face, smoothstep(0.45, 0.1, verts[:, 1]) * leg)


PATTERNS = {
    "stripes": _stripes, "tiger": _tiger, "patches": _patches, "net": _net, "spots": _spots, "dapples": _dapples,
    "saddle": _saddle, "points": _points,
}  # fmt: skip
