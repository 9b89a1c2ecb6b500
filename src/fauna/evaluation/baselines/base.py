"""What a baseline offers: predictions like those of a model, or keypoint positions without any geometry."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from fauna.data.datamodule import PhotoDataModule
from fauna.data.photos import Photo
from fauna.evaluation.prediction import Prediction
from fauna.metrics.sample import Sample
from fauna.model import FaunaModel

Transfer = Callable[[Sample, Sample], Float[np.ndarray, "key 2"]]
"""(source, target) -> predicted NDC of the source's keypoints on the target; NaN where a keypoint cannot be transferred."""

Reconstruct = Callable[[Photo], Prediction]
"""One photograph -> its prediction."""


@dataclass(frozen=True)
class Bench:
    """All that baselines and probes may look at.

    Attributes:
        model: under evaluation, in evaluation mode.
        fresh_model: builds a model of the same architecture with new random weights.
        data: makes batches of one photo.
        photos: that have a sample, in order.
        samples: of these photos, by name.
        predictions: of the model, by name; a photo that it failed on has none.
        codes: the shape code the model read from its bank, by name of the photo; likewise.
        size: side of silhouettes, pixels.
        species: the model was trained on.
    """

    model: FaunaModel
    fresh_model: Callable[[], FaunaModel]
    data: PhotoDataModule
    photos: Sequence[Photo]
    samples: Mapping[str, Sample]
    predictions: Mapping[str, Prediction]
    codes: Mapping[str, np.ndarray]
    size: int
    species: Sequence[str]


class MeshBaseline(ABC):
    """Something that reconstructs, and is scored like the model.

    Attributes:
        description: one sentence for the report.
        of_all_photos: whether the prediction of one photograph depends on which others there are.
    """

    description: str
    of_all_photos: bool

    @abstractmethod
    def prepare(self, bench: Bench) -> Reconstruct:
        """A function that reconstructs any photograph that the model has a prediction of."""


class TransferBaseline(ABC):
    """Something that transfers keypoints between two pictures, and is scored by keypoint transfer only.

    Attributes:
        description: one sentence for the report.
    """

    description: str

    @abstractmethod
    def prepare(self, bench: Bench) -> Transfer:
        """A function that transfers between any two of the bench's samples."""
