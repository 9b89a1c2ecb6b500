"""A model prepared once for all its photographs: smooth mesh, keypoints, coat and clips, in withers heights."""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int

from fauna.errors import FaunaError
from fauna.models3d.catalogue import Entry, lookup
from fauna.models3d.clips import Clip
from fauna.models3d.coat import base_colours, base_gloss, openness
from fauna.models3d.keypoints import Binding, bind, leg_shares, loose_share
from fauna.models3d.load import load_model
from fauna.models3d.model import Model, skin
from fauna.models3d.refine import Refinement, refine
from fauna.models3d.retarget import Skeleton, borrow, local_from_world
from fauna.zoo.body import KEYPOINTS
from fauna.zoo.products import dot
from fauna.zoo.surface import vertex_normals

LEFT_OUT = ("death", "die", "fall", "jump", "lay", "rest", "turn")
"""Clips whose names contain one of these words are left out: dead or on its side, in the air for long, no pose of
life, or bent so far that a direction of view means little."""
WITHERS, TAILBASE, NOSE = (KEYPOINTS.index(name) for name in ("withers", "tailbase", "nose"))


@dataclass(frozen=True)
class Animal:
    """A prepared model. World is the animal's frame: x to its left, y up from the ground, z to the head, withers at height 1.

    Attributes:
        entry: species, family, licence.
        model: the file.
        refinement: fine mesh over the file's.
        binding: keypoints.
        clips: usable animations, its own and borrowed ones, by name.
        animal_from_file: similarity.
        rest: fine vertices in the bound pose.
        normals: of them.
        keypoints: in the bound pose.
        legs: of each fine vertex, see :class:`fauna.data.truth.Truth3D`.
        girth: share of the trunk and of the legs in each fine vertex.
        colours: linear, as the file has them.
        gloss: strength of the highlight.
        openness: ambient occlusion.
    """

    entry: Entry
    model: Model
    refinement: Refinement
    binding: Binding
    clips: dict[str, Clip]
    animal_from_file: Float[np.ndarray, "4 4"]
    rest: Float[np.ndarray, "vert 3"]
    normals: Float[np.ndarray, "vert 3"]
    keypoints: Float[np.ndarray, "20 3"]
    legs: Int[np.ndarray, " vert"]
    girth: Float[np.ndarray, "vert 2"]
    colours: Float[np.ndarray, "vert 3"]
    gloss: Float[np.ndarray, " vert"]
    openness: Float[np.ndarray, " vert"]


def prepare(path: Path) -> Animal:
    """Read and prepare a model.

    Raises:
        FaunaError: for a broken file, an unknown rig, or a model that does not stand with its head towards +z.
    """
    model = load_model(path)
    entry = lookup(model)
    coarse = skin(model, model.bind_world)
    refinement = refine(coarse, model.faces)
    try:
        binding = bind(model, entry.rig, refinement, entry.eye, entry.ear)
    except KeyError as error:
        raise FaunaError(
            f"{path} expects the joint {error} of its rig, got none; export it with its skeleton"
        ) from error
    fine = refinement.fine_from_coarse @ coarse
    keypoints = binding.at(fine, model.bind_world)
    if keypoints[NOSE, 2] <= keypoints[TAILBASE, 2] or keypoints[WITHERS, 1] <= fine[:, 1].min():
        raise FaunaError(
            f"{path} expects a standing animal with y up and its head at +z, got another; turn it and export again"
        )
    frame = _animal_from_file(fine, keypoints)
    rest = apply(frame, fine)
    colours, owner = base_colours(model, refinement)
    legs, loose = leg_shares(model, entry.rig, refinement), loose_share(model, entry.rig, refinement)
    refined = rest[: len(refinement.chosen)]  # the places of the coarse mesh
    occlusion = openness(refined, vertex_normals(rest, refinement.faces)[: len(refined)], refinement.coarse_faces)
    plain = tuple(
        replace(material, texture=None) for material in model.materials
    )  # the colours are known, pictures are large
    return Animal(
        entry=entry, model=replace(model, materials=plain), refinement=refinement, binding=binding, clips=_clips(path, model, entry),
        animal_from_file=frame, rest=rest, normals=vertex_normals(rest, refinement.faces), keypoints=apply(frame, keypoints),
        legs=np.where(legs.max(1) > 0.5, legs.argmax(1), -1),
        girth=np.stack([np.clip(1 - loose - legs.sum(1), 0, 1), legs.sum(1)], 1),
        colours=colours, gloss=base_gloss(model, owner), openness=np.clip(refinement.fine_from_coarse[:, refinement.chosen] @ occlusion, 0.0, 1.0),
    )  # fmt: skip


def apply(matrix: Float[np.ndarray, "4 4"], points: Float[np.ndarray, "point 3"]) -> Float[np.ndarray, "point 3"]:
    """Points under an affine map."""
    return dot(points, matrix[:3, :3].T) + matrix[:3, 3]


def _animal_from_file(verts: np.ndarray, keypoints: np.ndarray) -> np.ndarray:
    """Scale and shift: withers at height 1, feet at 0, the mirror plane stays."""
    floor = verts[:, 1].min()
    paws = [place for name, place in zip(KEYPOINTS, keypoints, strict=True) if name.endswith("paw")]
    scale = 1.0 / (keypoints[WITHERS, 1] - floor)
    matrix = np.diag([scale, scale, scale, 1.0])
    matrix[:3, 3] = -scale * np.array([0.0, floor, np.mean(paws, axis=0)[2]])
    return matrix


def _clips(path: Path, model: Model, entry: Entry) -> dict[str, Clip]:
    """The model's own clips and, where its makers ship them in another file beside it, those of its donor."""
    found = dict(model.clips)
    donor = path.with_name(f"{entry.donor}.glb")
    if entry.donor and donor.is_file():
        giver = load_model(donor)
        theirs, ours = _skeleton(giver, entry), _skeleton(model, entry)
        found |= {name: borrow(clip, theirs, ours) for name, clip in giver.clips.items() if name not in found}
    return {
        name: clip
        for name, clip in sorted(found.items())
        if clip.channels and not any(word in name.lower() for word in (*LEFT_OUT, *entry.unlike))
    }


def _skeleton(model: Model, entry: Entry) -> Skeleton:
    """Bound pose and, as a height, that of the joint where the hind legs begin above the lowest vertex."""
    hip = model.node(entry.rig.back_leg[0].replace("{S}", entry.rig.sides[0]))
    height = model.bind_world[hip, 1, 3] - skin(model, model.bind_world)[:, 1].min()
    return Skeleton(model.node_names, local_from_world(model.bind_world, model.parents), float(height))
