"""The statistics of a training set's features: standardisation for the networks, PCA targets for the rendered feature field."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Any, Literal

import torch
import torch.nn.functional as F
from jaxtyping import Float
from torch import Tensor, nn

from fauna.errors import FaunaError
from fauna.types import Features

EPS = 1e-6


@dataclass
class Moments:
    """Exact running sums in float64; the order of the additions is the caller's order."""

    count: int
    total: Float[Tensor, " chan"]
    gram: Float[Tensor, "chan chan_or_1"]

    @classmethod
    def empty(cls, chan: int, *, full: bool) -> "Moments":
        """Zero sums; ``full`` keeps the whole second-moment matrix, else only its diagonal as a column."""
        return cls(
            0, torch.zeros(chan, dtype=torch.float64), torch.zeros(chan, chan if full else 1, dtype=torch.float64)
        )

    def add(self, samples: Float[Tensor, "sample chan"]) -> None:
        """Add samples to the sums."""
        samples = samples.detach().cpu().double()
        self.count += samples.shape[0]
        self.total += samples.sum(dim=0)
        self.gram += samples.T @ samples if self.gram.shape[1] > 1 else samples.square().sum(dim=0)[:, None]

    def mean(self) -> Float[Tensor, " chan"]:
        """Mean of the samples."""
        return self.total / self.count

    def std(self) -> Float[Tensor, " chan"]:
        """Standard deviation per channel (of the population)."""
        return (self.gram[:, 0] / self.count - self.mean().square()).clamp(min=0).sqrt()

    def covariance(self) -> Float[Tensor, "chan chan"]:
        """Covariance (of the population)."""
        mean = self.mean()
        return self.gram / self.count - mean[:, None] * mean[None, :]


class FeatureSpace(nn.Module):
    """Fitted once on training photos, then constant; its buffers travel with the checkpoint.

    Targets (3D-Fauna supplement, feature images): vectors of the source map are L2-normalised, projected on the first principal
    components of *foreground* cells, ``0.5 + (sigma_1 / sigma_k)^whitening * projection_k / (target_sigmas * sigma_1)``, and
    clamped to [0, 1]. ``sigma_k`` is the deviation along component ``k``.

    Args:
        global_dim: channels of the global vector.
        token_dim: channels of tokens and keys.
        num_components: channels of the targets.
        target_source: the map the targets come from.
        target_sigmas: width of the target range [0, 1] in deviations of the first component.
        foreground_threshold: a cell is foreground when the mask covers more than this share of it.
        standardize_global: whether :meth:`normalize` standardises the global vector per channel.
        standardize_tokens: whether it standardises tokens and keys per channel.
        max_images: photos read by :meth:`fit`; further ones are left unread.
        whitening: 0 keeps the relative scale of the components (paper), 1 makes their deviations equal. What tells an animal's
            front from its rear lies in small components.
    """

    fitted: Tensor
    global_mean: Tensor
    global_std: Tensor
    token_mean: Tensor
    token_std: Tensor
    key_mean: Tensor
    key_std: Tensor
    pca_mean: Tensor
    components: Tensor
    target_scale: Tensor
    explained_variance: Tensor

    def __init__(
        self,
        *,
        global_dim: int,
        token_dim: int,
        num_components: int,
        target_source: Literal["tokens", "keys"],
        target_sigmas: float,
        foreground_threshold: float,
        standardize_global: bool,
        standardize_tokens: bool,
        max_images: int,
        whitening: float,
    ):
        super().__init__()
        if not 0 < num_components <= token_dim:
            raise FaunaError(
                f"feature space expects 1..{token_dim} components (token_dim), got num_components={num_components}"
            )
        self.num_components = num_components
        self.target_source: Literal["tokens", "keys"] = target_source
        self.target_sigmas = target_sigmas
        self.foreground_threshold = foreground_threshold
        self.standardize_global = standardize_global
        self.standardize_tokens = standardize_tokens
        self.max_images = max_images
        self.whitening = whitening
        self._ready = False  # what ``fitted`` says, once it was read as true
        self.register_buffer("fitted", torch.tensor(False))
        for name, dim in (("global", global_dim), ("token", token_dim), ("key", token_dim)):
            self.register_buffer(f"{name}_mean", torch.zeros(dim))
            self.register_buffer(f"{name}_std", torch.ones(dim))
        self.register_buffer("pca_mean", torch.zeros(token_dim))
        self.register_buffer("components", torch.zeros(num_components, token_dim))
        self.register_buffer("target_scale", torch.ones(()))
        self.register_buffer("explained_variance", torch.zeros(num_components))

    @torch.no_grad()
    def fit(self, samples: Iterable[tuple[Features, Float[Tensor, "_ _ _"]]]) -> None:
        """Fit all statistics in one pass; the same samples in the same order give bitwise the same result.

        Args:
            samples: pairs of features and masks (batch, height, width) of the same photos, 0 or 1, at any resolution; at most
                ``max_images`` photos are used.

        Raises:
            FaunaError: if there are fewer foreground cells than components.
        """
        chan, global_dim = self.token_mean.shape[0], self.global_mean.shape[0]
        moments = {
            name: Moments.empty(dim, full=False)
            for name, dim in (("global", global_dim), ("token", chan), ("key", chan))
        }
        foreground = Moments.empty(chan, full=True)
        for features, masks in _first_images(samples, self.max_images):
            moments["global"].add(features.global_)
            moments["token"].add(_cells(features.tokens))
            moments["key"].add(_cells(features.keys))
            source = features.tokens if self.target_source == "tokens" else features.keys
            covered = (
                F.adaptive_avg_pool2d(masks[:, None], (source.shape[-2], source.shape[-1])).flatten()
                > self.foreground_threshold
            )
            foreground.add(F.normalize(_cells(source)[covered].double(), dim=1))
        if foreground.count <= self.num_components:
            raise FaunaError(
                f"feature space expects more than {self.num_components} foreground cells to fit, got {foreground.count}; "
                "give more photos or lower foreground_threshold"
            )
        for name, sums in moments.items():
            getattr(self, f"{name}_mean").copy_(sums.mean())
            getattr(self, f"{name}_std").copy_(sums.std().clamp(min=EPS))
        self._fit_components(foreground)
        self.fitted.fill_(True)

    def _fit_components(self, foreground: Moments) -> None:
        """Principal axes, largest first; the sign makes each axis's largest entry positive."""
        variances, axes = torch.linalg.eigh(foreground.covariance())
        variances, axes = variances.flip(0).clamp(min=0), axes.flip(1).T[: self.num_components]
        peak = axes.abs().argmax(dim=1, keepdim=True)
        axes = axes * axes.gather(1, peak).sign()
        self.pca_mean.copy_(foreground.mean())
        gains = (variances[0] / variances[: self.num_components].clamp(min=EPS**2)).pow(0.5 * self.whitening)
        self.components.copy_(axes * gains[:, None])
        self.target_scale.copy_(1.0 / (self.target_sigmas * variances[0].sqrt().clamp(min=EPS)))
        self.explained_variance.copy_(variances[: self.num_components] / variances.sum().clamp(min=EPS**2))

    def normalize(self, features: Features) -> Features:
        """Standardise per channel what is configured to be; ``keys`` stays the same tensor as ``tokens`` if it was.

        Raises:
            FaunaError: before :meth:`fit`.
        """
        self._require_fitted()
        global_, tokens, keys = features.global_, features.tokens, features.keys
        if self.standardize_global:
            global_ = (global_ - self.global_mean) / self.global_std
        if self.standardize_tokens:
            shared = keys is tokens
            tokens = (tokens - self.token_mean[:, None, None]) / self.token_std[:, None, None]
            keys = tokens if shared else (keys - self.key_mean[:, None, None]) / self.key_std[:, None, None]
        return Features(global_, tokens, keys)

    @property
    def takes_stored_maps(self) -> bool:
        """Whether feature maps that came with the photos can stand in for :meth:`targets`: they keep the components' scale."""
        return self.whitening == 0.0

    def targets(self, features: Features) -> Float[Tensor, "batch component grid_height grid_width"]:
        """Feature targets in [0, 1] of *unnormalised* features, on the encoder's grid, background included.

        Raises:
            FaunaError: before :meth:`fit`.
        """
        self._require_fitted()
        source = features.tokens if self.target_source == "tokens" else features.keys
        centred = F.normalize(source, dim=1) - self.pca_mean[:, None, None]
        projected = torch.einsum("kc,bchw->bkhw", self.components, centred)
        return (0.5 + projected * self.target_scale).clamp(0.0, 1.0)

    def _require_fitted(self) -> None:
        """Reads the flag from the device only until it is set: a look at every step would wait for the device each time."""
        if self._ready:
            return
        if not bool(self.fitted):
            raise FaunaError(
                "feature space expects fitted statistics, got none; call fit(...) or load a checkpoint that has them"
            )
        self._ready = True

    def _load_from_state_dict(self, *args: Any, **kwargs: Any) -> None:
        """Loaded statistics are checked anew."""
        self._ready = False
        super()._load_from_state_dict(*args, **kwargs)


def _cells(maps: Float[Tensor, "batch chan height width"]) -> Float[Tensor, "sample chan"]:
    """One row per grid cell, photo by photo."""
    return maps.permute(0, 2, 3, 1).flatten(0, 2)


def _first_images(
    samples: Iterable[tuple[Features, Tensor]], limit: int
) -> Iterator[tuple[Features, Float[Tensor, "_ _ _"]]]:
    """Stop after ``limit`` photos, cutting the batch that crosses it."""
    left = limit
    for features, masks in samples:
        keep = torch.arange(min(left, masks.shape[0]))
        yield features.rows(keep), masks[keep]
        left -= len(keep)
        if left <= 0:
            return
