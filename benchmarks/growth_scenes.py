"""A training system on synthetic photos, with every part ready to be timed by itself; used by ``growth.py``."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import torch
from hydra import compose, initialize_config_dir
from omegaconf import DictConfig

from fauna._conf import CONF_DIR
from fauna.build import build_encoder, build_model, build_schedule, build_system
from fauna.data.distance import distance_maps
from fauna.data.fauna_folder import CategoryPhotos
from fauna.data.photos import Photo, PhotoSource, RawPhoto
from fauna.losses.objective import compared_pixels
from fauna.random import Draws
from fauna.renderer.deferred import render
from fauna.system import FaunaSystem
from fauna.types import Batch, Features, InstanceShape, Pose, PosedMesh

Parts = dict[str, Callable[[], Any]]


def compose_experiment(experiment: str, *overrides: str) -> DictConfig:
    """An experiment whose data group is not used."""
    with initialize_config_dir(str(CONF_DIR), version_base="1.3"):
        return compose("train", overrides=[f"+experiment={experiment}", *overrides])


def synthetic_batch(cfg: DictConfig, photos: int, size: int) -> Batch:
    """Noise with an elliptic mask and features of the encoder's shape, from a fixed seed."""
    generator = torch.Generator().manual_seed(0)
    line = ((torch.arange(size) + 0.5) / size * 2 - 1).square()
    mask = (line / 0.5 + line[:, None] / 0.25 < 1).float()
    inside, outside = distance_maps(mask)
    grid, chan = cfg.encoder.grid_size, cfg.encoder.token_dim
    tokens = torch.randn(photos, chan, grid, grid, generator=generator)
    features = Features(torch.randn(photos, cfg.encoder.global_dim, generator=generator), tokens, tokens)

    def repeated(image: torch.Tensor) -> torch.Tensor:
        return image.expand(photos, -1, -1).contiguous()

    return Batch(
        images=torch.rand(photos, 3, size, size, generator=generator),
        masks=repeated(mask),
        distance_inside=repeated(inside),
        distance_outside=repeated(outside),
        valid=repeated(torch.ones_like(mask)),
        category=None,
        names=("synthetic",) * photos,
        features=features,
    )


class Scene:
    """A system and one batch in the articulated stage, with every part ready to run by itself.

    Args:
        experiment: whose configuration.
        overrides: of it.
        photos: of the batch.
        size: of the images, pixels.
    """

    def __init__(self, experiment: str, *overrides: str, photos: int = 6, size: int = 64) -> None:
        cfg = compose_experiment(experiment, *overrides)
        torch.manual_seed(0)
        self.system: FaunaSystem = build_system(cfg, build_model(cfg, build_encoder(cfg)))
        self.model = self.system.model
        self.batch = synthetic_batch(cfg, photos, size)
        fitted = synthetic_batch(cfg, 8, size)
        assert fitted.features is not None
        self.model.feature_space.fit([(fitted.features, fitted.masks)])
        self.system.set_stage(replace(build_schedule(cfg).at(0), articulation=True, hypotheses="one"))
        self.optimizer = self.system.configure_optimizers()[0]
        with torch.no_grad():
            self.out = self.model(self.batch, Draws(0, 0))

    def parts(self, names: Iterable[str]) -> Parts:
        """Some of the parts by name."""
        return {name: getattr(self, name) for name in names}

    def step(self) -> None:
        """Forward, losses, backward and Adam, as in training."""
        self.optimizer.zero_grad()
        losses, _, _ = self.system.generator_losses(self.batch, Draws(0, 0))
        losses.total.backward()
        self.optimizer.step()

    def bank(self) -> None:
        """Read the bank."""
        assert self.batch.features is not None
        self.model.bank(self.batch.features.global_, None).embedding.mean(0).square().sum().backward()
        self.model.bank.zero_grad()

    def shape(self) -> None:
        """Extract the base shape."""
        base = self.model.shape(self.out.code, Draws(0, 0).generator("lattice_jitter"))
        base.verts.square().sum().backward()
        self.model.shape.zero_grad()

    def skeleton(self) -> None:
        """Place the bones; has no backward pass."""
        self.model.rig.rest(self.out.instance, legs_attached=True)

    def articulation(self) -> None:
        """Predict the angles."""
        features = self.model.feature_space.normalize(self.model.encode(self.batch))
        with torch.no_grad():
            embedding = self.model.embedder(features)
        assert self.out.skeleton is not None
        residual = self.batch.masks[self.out.selection.photo] - self.out.renders.silhouette.detach()
        arguments = (features, embedding.geometry, self.out.skeleton, self.out.camera, residual)
        self.model.articulation(*arguments, leg_limits="early").angles.square().sum().backward()
        self.model.articulation.zero_grad()

    def skinning(self) -> None:
        """Weights, bone transforms, posed vertices."""
        assert self.out.skeleton is not None
        assert self.out.pose is not None
        instance = InstanceShape(self.out.instance.verts.detach().requires_grad_())
        pose = Pose(self.out.pose.angles.detach().requires_grad_())
        self.model.rig.pose(self.out.base, instance, self.out.skeleton, pose).verts.square().sum().backward()

    def render(self) -> None:
        """Rasterise, antialias, shade what is compared with the photos."""
        posed, model = self.out.posed, self.model
        mesh = PosedMesh(posed.verts.detach().requires_grad_(), posed.faces, posed.canonical)
        texture = torch.zeros(len(self.out.selection.photo), model.embedder.embedding_dim)
        size = (self.batch.images.shape[-2], self.batch.images.shape[-1])
        images = render(
            model.renderer,
            mesh,
            self.out.base.topology,
            self.out.camera,
            size,
            appearance=model.appearance,
            texture=texture,
            code=self.out.code,
            light=self.out.light,
            feature_lookup=model.feature_lookup,
            wanted=partial(compared_pixels, self.batch, self.out.selection.photo),
            share=1.0,
            generator=None,
        )
        (images.shading.rgb.mean() + images.shading.features.mean() + images.silhouette.mean()).backward()
        model.appearance.zero_grad()


@dataclass(frozen=True)
class NoFile(PhotoSource):
    """Stands where a photo's pixels would come from."""

    def read(self) -> RawPhoto:
        """Never asked for."""
        raise NotImplementedError

    def content_key(self) -> str:
        """Never asked for."""
        raise NotImplementedError


def listed(species: str, photos: int) -> CategoryPhotos:
    """Photos of a species that no file stands behind."""
    names = (f"{species}/train/photograph_{number:07d}" for number in range(photos))
    nowhere = NoFile()
    return CategoryPhotos(species, train=tuple(Photo(name, species, name, source=nowhere) for name in names))
