"""The same architecture before training: what the ellipsoid, the skeleton rule and the framing are worth."""

import torch

from fauna.data.photos import Photo
from fauna.evaluation.baselines.base import Bench, MeshBaseline, Reconstruct
from fauna.evaluation.predict import predict
from fauna.evaluation.prediction import Prediction

SEED = 0


class Untrained(MeshBaseline):
    """Random weights from a fixed seed; the feature statistics, which are measured and not learned, are the checkpoint's."""

    description = "The same architecture, random initialisation (seed 0), in the stage the checkpoint was trained to."
    of_all_photos = False

    def prepare(self, bench: Bench) -> Reconstruct:
        """The model is built once."""
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(SEED)
            model = bench.fresh_model()
        model.feature_space.load_state_dict(bench.model.feature_space.state_dict())
        model.set_stage(bench.model.stage)
        model.to(bench.model.device).eval()

        def reconstruct(photo: Photo) -> Prediction:
            batch = bench.data.single(photo).to(model.device)
            return predict(model, batch, category=photo.category, size=bench.size)[0]

        return reconstruct


BASELINE = Untrained()
