"""One rigid animal for all: what is left of the prediction when only the viewpoint depends on the photograph."""

import numpy as np
import torch

from fauna.data.photos import Photo
from fauna.evaluation.baselines.base import Bench, MeshBaseline, Reconstruct
from fauna.evaluation.predict import assemble, bone_coordinates
from fauna.evaluation.prediction import Prediction
from fauna.types import Camera, InstanceShape, PosedMesh


class MeanShape(MeshBaseline):
    """The base shape of the mean shape code, at rest, in each photograph's predicted camera."""

    description = (
        "The base shape of the mean shape code over the photographs of training species, without deformation and "
        "articulation, seen from each photograph's predicted viewpoint. One mesh for all photographs."
    )
    of_all_photos = True

    @torch.no_grad()
    def prepare(self, bench: Bench) -> Reconstruct:
        """The shape is made once."""
        model = bench.model
        known = [code for name, code in bench.codes.items() if bench.samples[name].category in bench.species]
        codes = np.stack(known or list(bench.codes.values()))
        base = model.shape(torch.from_numpy(codes.mean(axis=0)).to(model.device), None)
        rest = InstanceShape(base.verts[None])
        bones = model.rig.rest(rest, legs_attached=model.stage.legs_attached) if model.stage.articulation else None
        place = bone_coordinates(model.rig, rest.verts, base.verts, bones)
        posed = PosedMesh(rest.verts, base.faces, base.verts)

        def reconstruct(photo: Photo) -> Prediction:
            theirs = bench.predictions[photo.name]
            matrices = (theirs.camera_from_world, theirs.clip_from_world)
            return assemble(
                model.renderer,
                posed,
                Camera(*(torch.from_numpy(matrix)[None].to(model.device) for matrix in matrices)),
                place,
                name=photo.name,
                category=photo.category,
                size=bench.size,
                probabilities=theirs.probabilities,
                forwards=theirs.forwards,
                angles=np.zeros_like(theirs.angles),
            )

        return reconstruct


BASELINE = MeanShape()
