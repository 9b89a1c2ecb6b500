"""The model. ``FaunaModel.forward`` is the data flow of the paper, one line per stage."""

from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor, nn

from fauna.appearance.base import Appearance
from fauna.articulation.base import Articulation
from fauna.bank.base import Bank, BatchCode, shape_code
from fauna.deformation.base import Deformation
from fauna.encoder.base import Encoder
from fauna.encoder.embedder import ImageEmbedder
from fauna.encoder.feature_space import FeatureSpace
from fauna.encoder.mask_embedding import MaskEmbedding, NoMaskEmbedding
from fauna.geometry.rig import Rig
from fauna.geometry.rows import per_row
from fauna.losses.objective import compared_pixels
from fauna.random import Draws
from fauna.renderer.base import Renderer
from fauna.renderer.deferred import FeatureLookup, render, render_silhouette
from fauna.shape.base import Shape
from fauna.stages import Stage
from fauna.types import (
    BaseShape,
    Batch,
    Camera,
    Features,
    ImageEmbedding,
    InstanceShape,
    Pose,
    PosedMesh,
    Reconstruction,
    Selection,
    Skeleton,
)
from fauna.viewpoint.network import ViewpointNetwork
from fauna.viewpoint.selection import best, camera_for, select


class FaunaModel(nn.Module):
    """Photo -> features -> bank -> base shape -> instance -> skeleton and pose -> skinning -> appearance -> images.

    The parts are given, not built, so that any of them can be exchanged. ``stage`` says which of them take part; it is
    saved with the weights, because a model evaluated in another stage than it was trained in gives nonsense.

    Args:
        encoder: frozen image encoder; its weights are never saved with the model.
        feature_space: statistics and PCA basis of the training set's features.
        mask_embedding: what the networks see of the mask.
        bank: query -> shape code.
        embedder: features -> learned image embeddings.
        viewpoint: features -> viewpoint hypotheses.
        shape: shape code -> base mesh.
        deformation: instance offsets.
        rig: skeleton heuristic and skinning.
        articulation: bone angles.
        appearance: albedo, light and feature field.
        renderer: rasteriser backend.
        camera: ``fov_deg`` and ``distance`` (world units) of the pinhole camera.
        feature_lookup: evaluate the feature field at mesh ``vertices`` or at the shaded ``pixels``.
        batch_code: shape code of a training batch, which shows one species: the ``mean`` over its photos (paper), or that of
            ``one`` of them, drawn at random, which then has to explain the others and so cannot depend on the view.
        shade_fraction: share of the pixels in the image losses that a training step shades, drawn at random.
    """

    def __init__(
        self,
        *,
        encoder: Encoder,
        feature_space: FeatureSpace,
        mask_embedding: MaskEmbedding | NoMaskEmbedding,
        bank: Bank,
        embedder: ImageEmbedder,
        viewpoint: ViewpointNetwork,
        shape: Shape,
        deformation: Deformation,
        rig: Rig,
        articulation: Articulation,
        appearance: Appearance,
        renderer: Renderer,
        camera: Mapping[str, float],
        feature_lookup: FeatureLookup,
        batch_code: BatchCode,
        shade_fraction: float,
    ) -> None:
        super().__init__()
        self.encoder = encoder
        self.feature_space = feature_space
        self.mask_embedding = mask_embedding
        self.bank = bank
        self.embedder = embedder
        self.viewpoint = viewpoint
        self.shape = shape
        self.deformation = deformation
        self.rig = rig
        self.articulation = articulation
        self.appearance = appearance
        self.renderer = renderer
        self.camera = dict(camera)
        self.feature_lookup: FeatureLookup = feature_lookup
        self.batch_code: BatchCode = batch_code
        self.shade_fraction = shade_fraction
        self.stage = Stage()
        self.grid_resolution = shape.grid_resolution  # as configured: what a stage without one means

    @staticmethod
    def from_pretrained(name_or_path: str | Path | None = None, *, device: str | torch.device = "cpu") -> "FaunaModel":
        """A trained model in evaluation mode: the shipped one, or that of a weight file, a checkpoint or a run's folder.

        Raises:
            FaunaError: when there is no such model, its file is damaged, or the device cannot be used.
        """
        from fauna.pretrained.load import load_model

        return load_model(name_or_path, device=device)

    @torch.no_grad()
    def reconstruct(self, image: np.ndarray, mask: np.ndarray, *, crop: bool = True, size: int = 256) -> Reconstruction:
        """Reconstruct one animal from a photograph in memory, as at test time.

        Args:
            image: (height, width, 3) 8-bit RGB.
            mask: (height, width) true, 1 or above 127 on the animal.
            crop: cut the crop around the mask; otherwise image and mask are a square crop already.
            size: side of the crop and of the rendered pictures, pixels.

        Raises:
            FaunaError: when image, mask or size are of another form, or the mask is empty.
        """
        from fauna.data.single import single_photo

        return self(single_photo(self.encoder, image, mask, crop=crop, size=size).to(self.device))

    def forward(self, batch: Batch, draws: Draws | None = None) -> Reconstruction:
        """Reconstruct and render every photo of the batch with one shared base shape.

        Args:
            batch: photos of one species.
            draws: random draws of a training step; ``None`` reconstructs without lattice jitter and with the most
                likely viewpoint of each photo.
        """
        features = self.mask_embedding(self.feature_space.normalize(self.encode(batch)), batch.masks)
        readout = self.bank(features.global_, batch.category)
        code = shape_code(readout, self.batch_code, None if draws is None else draws.generator("batch_code"))
        base = self.shape(code, None if draws is None else draws.generator("lattice_jitter"))
        embedding = self.embedder(features)
        hypotheses = self.viewpoint(features, temperature=self.stage.temperature, elevation=self.stage.elevation)
        selection = best(hypotheses) if draws is None else self._select(hypotheses, draws)
        camera = camera_for(hypotheses, selection, fov_deg=self.camera["fov_deg"], distance=self.camera["distance"])
        instance = self.deform(base, embedding)
        skeleton, pose, posed = self.articulate(
            base, instance, features, embedding, selection, camera, batch.masks, batch.valid
        )
        rows = embedding.rows(selection.photo)
        light = self.appearance.light(rows.texture)
        renders = render(
            self.renderer,
            posed,
            base.topology,
            camera,
            (batch.images.shape[-2], batch.images.shape[-1]),
            appearance=self.appearance,
            texture=rows.texture,
            code=code,
            light=light,
            feature_lookup=self.feature_lookup,
            wanted=None if draws is None else partial(compared_pixels, batch, selection.photo),
            share=1.0 if draws is None else self.shade_fraction,
            generator=None if draws is None else draws.generator("shading"),
        )
        return Reconstruction(
            readout, code, base, instance, hypotheses, selection, camera, posed, renders, light, skeleton, pose, rows
        )

    def encode(self, batch: Batch) -> Features:
        """Frozen features, from the cache that filled the batch or by the encoder."""
        if batch.features is not None:
            return batch.features
        assert batch.encoder_images is not None, "a batch carries features or encoder_images"
        return self.encoder(batch.encoder_images).to(batch.images.device)

    def with_features(self, batch: Batch) -> Batch:
        """The same batch carrying its frozen features, so that the encoder runs once however often they are used."""
        return replace(batch, features=self.encode(batch), encoder_images=None)

    @property
    def device(self) -> torch.device:
        """Where the model is."""
        return next(self.parameters()).device

    @torch.no_grad()
    def feature_targets(self, batch: Batch) -> Float[Tensor, "batch chan grid_height grid_width"]:
        """PCA feature maps in [0, 1] that the rendered features are compared with; those of the batch where they fit the feature space."""
        if batch.feature_targets is not None and self.feature_space.takes_stored_maps:
            return batch.feature_targets
        return self.feature_space.targets(self.encode(batch))

    def deform(self, base: BaseShape, embedding: ImageEmbedding) -> InstanceShape:
        """Instance offsets, or the base itself while deformation is off."""
        if not self.stage.deformation:
            return InstanceShape(base.verts[None])
        return self.deformation(base, embedding.geometry)

    def articulate(
        self,
        base: BaseShape,
        instance: InstanceShape,
        features: Features,
        embedding: ImageEmbedding,
        selection: Selection,
        camera: Camera,
        masks: Float[Tensor, "batch height width"],
        valid: Float[Tensor, "batch height width"],
    ) -> tuple[Skeleton | None, Pose | None, PosedMesh]:
        """Rest bones, their predicted angles and the skinned mesh of each row; the rest mesh while articulation is off."""
        rest = PosedMesh(per_row(instance.verts, len(selection.photo)), base.faces, base.verts)
        if not self.stage.articulation:
            return None, None, rest
        residual = (
            self._residual(rest, base, selection, camera, masks, valid) if self.articulation.compares_outline else None
        )
        skeleton = self.rig.rest(instance, legs_attached=self.stage.legs_attached)
        limits = self.stage.leg_limits
        pose = self.articulation(features, embedding.geometry, skeleton, camera, residual, leg_limits=limits)
        return skeleton, pose, self.rig.pose(base, instance, skeleton, pose)

    @torch.no_grad()
    def _residual(
        self,
        rest: PosedMesh,
        base: BaseShape,
        selection: Selection,
        camera: Camera,
        masks: Float[Tensor, "batch height width"],
        valid: Float[Tensor, "batch height width"],
    ) -> Float[Tensor, "row height width"]:
        """Mask minus silhouette of the mesh at rest, of each row; 0 where the photo does not reach."""
        size = (masks.shape[-2], masks.shape[-1])
        silhouette = render_silhouette(self.renderer, rest, camera, size, topology=base.topology)
        return (masks[selection.photo] - silhouette) * valid[selection.photo]

    def set_stage(self, stage: Stage) -> None:
        """Switch parts on or off; called by the schedule callback and when weights are loaded."""
        self.stage = stage
        wanted = stage.grid_resolution or self.grid_resolution
        if wanted != self.shape.grid_resolution:
            self.shape.set_resolution(wanted)

    @property
    def turned(self) -> bool:
        """Whether the model was learned with the head at -z; what it hands out has it at +z all the same."""
        return self.rig.turned

    def set_turned(self, turned: bool) -> None:
        """Say which end of the z axis the head was learned at; see :mod:`fauna.geometry.half_turn`."""
        for part in (self.viewpoint, self.shape, self.deformation, self.articulation, self.appearance):
            part.turned = turned
        self.rig = replace(self.rig, turned=turned)

    def get_extra_state(self) -> dict[str, Any]:
        """The stage and the frame travel with the weights."""
        return {"stage": self.stage.state(), "turned": self.turned}

    def set_extra_state(self, state: dict[str, Any]) -> None:
        """Restore the stage a set of weights was trained in, and its frame."""
        self.set_stage(Stage.from_state(state["stage"]))
        self.set_turned(state.get("turned", False))

    def _select(self, hypotheses: Any, draws: Draws) -> Selection:
        return select(
            hypotheses,
            mode=self.stage.hypotheses,
            uniform_mix=self.stage.uniform_mix,
            best_fraction=self.stage.best_fraction,
            generator=draws.generator("hypothesis"),
        )
