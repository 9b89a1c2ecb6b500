"""Bone rotations from a transformer over bones (supplement, "Bone Rotation Prediction")."""

import math
from collections.abc import Sequence
from functools import lru_cache
from typing import Literal

import torch
from jaxtyping import Float
from torch import Tensor, nn
from torch.nn import functional as F

from fauna.articulation.base import Articulation
from fauna.articulation.constraints import angle_limits
from fauna.errors import FaunaError
from fauna.geometry.camera import project, transform_points
from fauna.geometry.constants import constant
from fauna.geometry.half_turn import other_end, turn_angles
from fauna.geometry.rows import per_row, rows_per_item
from fauna.geometry.skeleton import NUM_BONES
from fauna.networks import HarmonicEmbedding
from fauna.types import Camera, Features, Pose, Skeleton

_POSITION_DIM = 8  # image position of the middle, start and end in the camera frame


class ArticulationTransformer(Articulation):
    """One token per bone: photo embedding, local features under the bone, position code; out come three angles.

    Args:
        geometry_dim: width of the geometry embedding.
        key_dim: channels of the key map.
        local_points: places along a bone, 0 = start and 1 = end, at which the key map is sampled.
        local_dim: width local features are projected to, ``None`` = as they are.
        residual_points: places per axis of a square window around a bone's middle at which the residual of the outline is
            read (mask minus silhouette of the mesh at rest), 0 = none (paper).
        residual_window: half the side of that window, NDC (half the image is 1).
        normalize_inputs: layer norm on the photo embedding and on the local features.
        bone_index: the bone's index is ``add``-ed to every input, ``concat``-enated with the position, or ``both``;
            ``learned``: concatenated, and a learned vector per bone is added to its token, so that left and right legs,
            whose inputs are alike from the side, can move apart.
        num_octaves: octaves of the harmonic position code.
        position_scale: factor that brings camera-frame positions to about [-1, 1], per world unit.
        camera_distance: nominal distance of the object, world units.
        hidden_dim: width of the tokens.
        num_blocks: transformer blocks.
        num_heads: attention heads.
        mlp_ratio: hidden width of a block's MLP relative to ``hidden_dim``.
        output_gain: angles are ``tanh(output_gain * output)`` times their limit.
        output_init: factor on the initial weights of the last layer (paper: 1; small = bones start almost straight).
        max_angle_deg: largest angle, degrees.
        body_sideways_deg: largest sideways bend of spine bones, degrees.
        body_twist_deg: largest twist of spine bones, degrees.
    """

    def __init__(
        self,
        *,
        geometry_dim: int,
        key_dim: int,
        local_points: Sequence[float],
        local_dim: int | None,
        residual_points: int,
        residual_window: float,
        normalize_inputs: bool,
        bone_index: Literal["add", "concat", "both", "learned"],
        num_octaves: int,
        position_scale: float,
        camera_distance: float,
        hidden_dim: int,
        num_blocks: int,
        num_heads: int,
        mlp_ratio: float,
        output_gain: float,
        output_init: float,
        max_angle_deg: float,
        body_sideways_deg: float,
        body_twist_deg: float,
    ) -> None:
        super().__init__()
        if bone_index not in ("add", "concat", "both", "learned"):
            raise FaunaError(
                f"articulation.bone_index must be add, concat, both or learned, got {bone_index!r}; choose one"
            )
        if hidden_dim % num_heads:
            raise FaunaError(
                f"articulation.hidden_dim must be a multiple of num_heads, got {hidden_dim} and {num_heads}; change one"
            )
        self.compares_outline = residual_points > 0
        self.bone_index = bone_index
        self.position_scale = position_scale
        self.camera_distance = camera_distance
        self.output_gain = output_gain
        self.max_angle_deg = max_angle_deg
        self.body_sideways_deg = body_sideways_deg
        self.body_twist_deg = body_twist_deg
        local_width = key_dim if local_dim is None else local_dim
        self.project_local = nn.Identity() if local_dim is None else nn.Linear(key_dim, local_dim, bias=False)
        self.normalize_global = nn.LayerNorm(geometry_dim) if normalize_inputs else nn.Identity()
        self.normalize_local = nn.LayerNorm(local_width) if normalize_inputs else nn.Identity()
        self.embedding = HarmonicEmbedding(num_octaves=num_octaves, base_frequency=0.9 * math.pi)
        position_width = self.embedding.out_dim(_POSITION_DIM + (bone_index != "add"))
        token_dim = geometry_dim + local_width * len(local_points) + residual_points**2 + position_width
        self.in_layer = nn.Sequential(nn.Linear(token_dim, hidden_dim), nn.GELU(), nn.LayerNorm(hidden_dim))
        self.blocks = nn.Sequential(*(_Block(hidden_dim, num_heads, mlp_ratio) for _ in range(num_blocks)))
        self.out_layer = nn.Linear(hidden_dim, 3)
        with torch.no_grad():
            for parameter in self.out_layer.parameters():
                parameter.mul_(output_init)
        self.local_points: Tensor
        self.index_code: Tensor
        self.bone_code = nn.Parameter(torch.randn(NUM_BONES, hidden_dim)) if bone_index == "learned" else None
        window = torch.linspace(-residual_window, residual_window, residual_points)
        self.window: Tensor
        self.register_buffer("window", torch.cartesian_prod(window, window), persistent=False)
        self.register_buffer("local_points", torch.tensor(list(local_points)), persistent=False)
        index_code = (torch.arange(NUM_BONES) + 0.5) / NUM_BONES * 2 - 1
        self.register_buffer("index_code", index_code[:, None], persistent=False)

    def forward(
        self,
        features: Features,
        geometry: Float[Tensor, "batch geometry_chan"],
        skeleton: Skeleton,
        camera: Camera,
        residual: Float[Tensor, "row height width"] | None = None,
        *,
        leg_limits: str,
    ) -> Pose:
        """Bone rotations; gradient reaches the geometry embedding and this network only."""
        camera = Camera(camera.camera_from_world.detach(), camera.clip_from_world.detach())
        rows = camera.camera_from_world.shape[0]
        starts, ends = per_row(skeleton.starts, rows), per_row(skeleton.ends, rows)
        if self.turned:
            starts, ends = other_end(starts), other_end(ends)
        image = per_row(self.normalize_global(geometry), rows)
        local = self.normalize_local(self.project_local(self.sample_keys(features.keys, starts, ends, camera)))
        position = self.embedding(self.positions(starts, ends, camera))
        outline = self.sample_residual(residual, starts, ends, camera)
        tokens = torch.cat((image[:, None].expand(-1, NUM_BONES, -1), local.flatten(2), outline, position), dim=-1)
        if self.bone_index in ("add", "both"):
            tokens = tokens + self.index_code
        tokens = self.in_layer(tokens)
        if self.bone_code is not None:
            tokens = tokens + self.bone_code
        output = self.out_layer(self.blocks(tokens))
        angles = torch.tanh(self.output_gain * output) * constant(self._limits(leg_limits), output)
        return Pose(turn_angles(angles) if self.turned else angles)

    def limits(self, leg_limits: str) -> Float[Tensor, "20 3"]:
        """Largest absolute angles, radians."""
        return torch.tensor(self._limits(leg_limits))

    def _limits(self, leg_limits: str) -> tuple[tuple[float, ...], ...]:
        return _limits(leg_limits, self.max_angle_deg, self.body_sideways_deg, self.body_twist_deg)

    @torch.no_grad()
    def sample_keys(
        self,
        keys: Float[Tensor, "batch chan grid_height grid_width"],
        starts: Float[Tensor, "row bone 3"],
        ends: Float[Tensor, "row bone 3"],
        camera: Camera,
    ) -> Float[Tensor, "row bone place chan"]:
        """Keys under the local points of the rest bones, bilinear, zero outside of the photo.

        A linear projection commutes with bilinear sampling, so keys are sampled first and projected afterwards. All
        rows of a photo are sampled together: the map of a photo is not repeated.
        """
        places = torch.lerp(starts[:, :, None], ends[:, :, None], self.local_points[:, None])
        ndc = project(places.flatten(1, 2), camera)  # (row, bone place, 2)
        photos = ndc.unflatten(0, (keys.shape[0], rows_per_item(ndc.shape[0], keys.shape[0])))
        sampled = F.grid_sample(keys, photos, mode="bilinear", padding_mode="zeros", align_corners=False)
        return sampled.permute(0, 2, 3, 1).reshape(*places.shape[:3], -1)

    @torch.no_grad()
    def sample_residual(
        self,
        residual: Float[Tensor, "row height width"] | None,
        starts: Float[Tensor, "row bone 3"],
        ends: Float[Tensor, "row bone 3"],
        camera: Camera,
    ) -> Float[Tensor, "row bone place"]:
        """Residual in a window around the middle of the rest bones, bilinear, zero outside of the photo."""
        if not self.compares_outline:
            return starts.new_zeros(*starts.shape[:2], 0)
        assert residual is not None, "an articulation that compares outlines is given the residual"
        middle = project(0.5 * (starts + ends), camera)  # (row, bone, 2)
        places = middle[:, :, None] + self.window
        sampled = F.grid_sample(residual[:, None], places, mode="bilinear", padding_mode="zeros", align_corners=False)
        return sampled[:, 0]

    @torch.no_grad()
    def positions(
        self, starts: Float[Tensor, "row bone 3"], ends: Float[Tensor, "row bone 3"], camera: Camera
    ) -> Float[Tensor, "row bone position"]:
        """Image position of the bone's middle, scaled start and end in the camera frame, and the index unless added."""
        middle = project(0.5 * (starts + ends), camera)
        joints = transform_points(torch.cat((starts, ends), dim=1), camera.camera_from_world[:, :3])
        joints = (joints + constant((0.0, 0.0, self.camera_distance), joints)) * self.position_scale
        parts = [middle, *joints.chunk(2, dim=1)]
        if self.bone_index != "add":
            parts.append(self.index_code.expand(middle.shape[0], -1, -1))
        return torch.cat(parts, dim=-1)


@lru_cache(maxsize=64)
def _limits(leg_limits: str, largest: float, sideways: float, twist: float) -> tuple[tuple[float, ...], ...]:
    limits = angle_limits(leg_limits, max_angle_deg=largest, body_sideways_deg=sideways, body_twist_deg=twist)
    return tuple(map(tuple, limits.tolist()))


class _Block(nn.Module):
    """Pre-norm transformer block without dropout."""

    def __init__(self, dim: int, num_heads: int, mlp_ratio: float) -> None:
        super().__init__()
        hidden = int(dim * mlp_ratio)
        self.num_heads = num_heads
        self.attention_norm = nn.LayerNorm(dim)
        self.qkv = nn.Linear(dim, 3 * dim, bias=False)
        self.merge = nn.Linear(dim, dim)
        self.mlp_norm = nn.LayerNorm(dim)
        self.mlp = nn.Sequential(nn.Linear(dim, hidden), nn.GELU(), nn.Linear(hidden, dim))

    def forward(self, tokens: Float[Tensor, "row token dim"]) -> Float[Tensor, "row token dim"]:
        qkv = self.qkv(self.attention_norm(tokens)).unflatten(-1, (3, self.num_heads, -1))
        query, key, value = qkv.permute(2, 0, 3, 1, 4)  # each (row, head, token, chan)
        mixed = F.scaled_dot_product_attention(query, key, value).transpose(1, 2).flatten(2)
        tokens = tokens + self.merge(mixed)
        return tokens + self.mlp(self.mlp_norm(tokens))
