"""Coats of rigged models: what the file says, made into something that looks like an animal rather than a toy."""

import numpy as np
from jaxtyping import Float, Int

from fauna.kernels.zoo_raster import value_noise
from fauna.models3d.model import Model
from fauna.models3d.refine import Refinement
from fauna.zoo.coat import linear, smoothstep
from fauna.zoo.products import dot
from fauna.zoo.render import FUR_GLOSS

COATS = ("#201c19", "#3b2a1e", "#6b3f24", "#8a5f3c", "#b08d5f", "#d3c29f", "#8d8984", "#5c5a58", "#d8d4cb", "#e6e2da")
"""Colours that domestic animals come in."""
PIGS = ("#d9a79b", "#e0b7a6", "#c99487", "#4a3b36", "#7a5648", "#d8cfc4")
SHEEP = ("#d8d0bf", "#e2dccd", "#c9bfa9", "#5a4a3c", "#8d8478")
CHOICES = {
    **dict.fromkeys(("horse", "cow", "dog", "cat", "alpaca", "llama"), COATS),
    "donkey": COATS[:2] + COATS[6:8], "pig": PIGS, "sheep": SHEEP,
}  # fmt: skip
"""Species whose coat is sometimes replaced, and the colours to choose from."""
PATCHED = ("horse", "cow", "dog", "cat", "pig", "alpaca", "llama")
SHINY = {"eye": 0.5, "nose": 0.25, "muzzle": 0.08, "hoo": 0.12, "horn": 0.15, "antler": 0.12}
"""Strength of the highlight by the beginning of a material's name."""
EYE = "#1c110a"
CHUNK = 256
"""Vertices whose openness is computed at once."""
DARKEST, LIGHTEST = 0.016, 0.78


def base_colours(model: Model, refinement: Refinement) -> tuple[Float[np.ndarray, "vert 3"], Int[np.ndarray, " vert"]]:
    """Linear colour of every fine vertex, the mean of its faces' corners, and its material (of the last face that has it)."""
    corners = model.faces[refinement.corner_faces]
    uv = np.einsum("fcb,fbk->fck", refinement.corner_shares, model.uv[corners])
    colours = np.einsum("fcb,fbk->fck", refinement.corner_shares, model.colours[corners])
    materials = model.face_materials[refinement.corner_faces] % len(model.materials)
    for index, material in enumerate(model.materials):
        chosen = materials == index
        colours[chosen] *= material.at(uv[chosen].reshape(-1, 2)).reshape(-1, 3, 3)
    flat, count = refinement.faces.ravel(), refinement.faces.max() + 1
    summed = np.stack([np.bincount(flat, colours[..., i].ravel(), count) for i in range(3)], 1)
    owner = np.zeros(count, np.int64)
    owner[flat] = np.repeat(materials, 3)
    return summed / np.bincount(flat, minlength=count)[:, None], owner


def base_gloss(model: Model, owner: Int[np.ndarray, " vert"]) -> Float[np.ndarray, " vert"]:
    """Highlight of every fine vertex by the name of its material."""
    by_material = [
        max((gloss for start, gloss in SHINY.items() if material.name.lower().startswith(start)), default=FUR_GLOSS)
        for material in model.materials
    ]
    return np.array(by_material)[owner]


def openness(
    verts: Float[np.ndarray, "vert 3"], normals: Float[np.ndarray, "vert 3"], faces: Int[np.ndarray, "face 3"]
) -> Float[np.ndarray, " vert"]:
    """1 where the sky is free, 0 in a crease: every triangle is a disc that hides its solid angle (Bunnell, 2005)."""
    a, b, c = (verts[faces[:, i]] for i in range(3))
    crossed = np.cross(b - a, c - a)
    area = 0.5 * np.linalg.norm(crossed, axis=1)
    centre, facing = (a + b + c) / 3, crossed / np.maximum(2 * area, 1e-12)[:, None]
    hidden = np.empty(len(verts))
    for first in range(0, len(verts), CHUNK):
        place, normal = verts[first : first + CHUNK], normals[first : first + CHUNK]
        receive = dot(normal, centre.T) - (place * normal).sum(1)[:, None]
        emit = dot(place, facing.T) - (centre * facing).sum(1)
        squared = (place**2).sum(1)[:, None] - 2 * dot(place, centre.T) + (centre**2).sum(1)
        squared = np.maximum(squared, 1e-9)
        seen = np.clip(receive, 0, None) * np.clip(emit, 0, None) * area
        hidden[first : first + CHUNK] = (seen / (squared * (np.pi * squared + area))).sum(1)
    return np.clip(1 - hidden, 0.05, 1)


def paint(
    species: str,
    base: Float[np.ndarray, "vert 3"],
    gloss: Float[np.ndarray, " vert"],
    rest: Float[np.ndarray, "vert 3"],
    normals: Float[np.ndarray, "vert 3"],
    rng: np.random.Generator,
) -> Float[np.ndarray, "vert 3"]:
    """Albedo of an individual: sometimes another coat or patches, always its own shade, paler below, mottled.

    Args:
        species: decides what coats occur.
        base: linear colours of the file.
        gloss: tells fur from horn, hoof and eye.
        rest: positions at rest, withers heights.
        normals: at rest.
        rng: consumed, the same number of draws whatever happens.
    """
    recolour, choice, second = rng.random(), rng.random(), rng.random()
    patched, share, seed = rng.random(), rng.uniform(0.45, 0.6), int(rng.integers(2**20))
    greyness, gain, tint = rng.uniform(0.05, 0.5), np.exp(rng.normal(0, 0.2)), np.exp(rng.normal(0, 0.03, 3))
    shade, mottle, warmth = rng.uniform(0.0, 0.4), rng.uniform(0.15, 0.55), rng.uniform(0.0, 0.12)
    fur = (gloss <= FUR_GLOSS)[:, None]
    albedo, colours = base, CHOICES.get(species, ())
    if colours and recolour < 0.5:
        grey = _luminance(albedo)
        ratio = np.clip(grey / max(float(np.median(grey[fur])) if fur.any() else 0.0, 0.02), 0.1, 8.0) ** 0.75
        albedo = np.where(fur, linear(colours[int(choice * len(colours))]) * ratio, albedo)
    if species in PATCHED and patched < 0.3:
        noise = value_noise(rest * 2.4, 3, seed)
        mask = smoothstep(share - 0.012, share + 0.012, noise + 0.02 * (value_noise(rest * 30, 2, seed + 1) - 0.5))
        other = linear(colours[int(second * len(colours))]) if colours else albedo
        albedo = np.where(fur, albedo + (other - albedo) * mask[:, None], albedo)
    albedo = albedo + greyness * (_luminance(albedo) - albedo)
    albedo *= gain * tint * (1 - shade * 0.5 * normals[:, 1:2] * fur)
    coarse = value_noise(rest * 4.0, 3, seed + 2) - 0.5
    fine = value_noise(rest * [26, 14, 26], 2, seed + 3) - 0.5
    hue = (value_noise(rest * 3.0, 2, seed + 4) - 0.5)[:, None] * np.array([1.0, 0.1, -1.0])
    albedo *= 1 + np.where(fur, mottle * (coarse + 0.7 * fine)[:, None] + 2 * warmth * hue, 0.0)
    albedo[:, 2] = np.where(fur[:, 0], np.minimum(albedo[:, 2], 0.93 * albedo[:, 1]), albedo[:, 2])  # no fur is blue
    return np.clip(albedo, DARKEST, LIGHTEST)


def _luminance(colour: np.ndarray) -> np.ndarray:
    return dot(colour, np.array([0.3, 0.6, 0.1]))[:, None]


def paint_eyes(
    albedo: Float[np.ndarray, "vert 3"],
    gloss: Float[np.ndarray, " vert"],
    rest: Float[np.ndarray, "vert 3"],
    eyes: Float[np.ndarray, "eye 3"],
    radius: float,
) -> tuple[Float[np.ndarray, "vert 3"], Float[np.ndarray, " vert"]]:
    """Dark, shining eyes: half of the models have none or drawn ones."""
    near = np.linalg.norm(rest[:, None] - eyes[None], axis=-1).min(1)
    share = smoothstep(1.2 * radius, 0.8 * radius, near)
    return albedo + (linear(EYE) - albedo) * share[:, None], gloss + (0.6 - gloss) * share
