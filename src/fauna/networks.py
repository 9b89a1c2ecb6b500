"""Learned blocks shared by the fields: harmonic embedding, bias-free MLP, conditioned MLP, demodulated weights."""

import torch
from jaxtyping import Float, Int
from torch import Tensor, nn
from torch.nn import functional as F

from fauna.precision import Precision, matmul_precision


class HarmonicEmbedding(nn.Module):
    """Raw coordinates followed by their sines and cosines at doubling frequencies.

    Frequencies are ``base_frequency * 2**j``, ``j = 0 .. num_octaves - 1``; the sines come before the cosines and the
    coordinate index runs slower than the octave.

    Args:
        num_octaves: number of frequencies; 0 leaves the coordinates alone.
        base_frequency: lowest angular frequency, radians per world unit.
    """

    def __init__(self, *, num_octaves: int, base_frequency: float) -> None:
        super().__init__()
        octaves = torch.arange(num_octaves, dtype=torch.float64)
        self.num_octaves = num_octaves
        self.frequencies: Tensor
        self.register_buffer("frequencies", (base_frequency * 2.0**octaves).float(), persistent=False)

    def out_dim(self, in_dim: int) -> int:
        """Width of the embedding of an ``in_dim``-vector."""
        return in_dim * (1 + 2 * self.num_octaves)

    def forward(self, points: Float[Tensor, "*batch coord"]) -> Float[Tensor, "*batch embed"]:
        """Embed points, ``embed = coord * (1 + 2 * num_octaves)``."""
        angles = (points[..., None] * self.frequencies.to(points)).flatten(-2)
        return torch.cat((points, angles.sin(), angles.cos()), dim=-1)


class MLP(nn.Module):
    """Linear layers without bias and ReLU between them; the output is linear.

    Args:
        in_dim: input width.
        out_dim: output width.
        num_layers: number of linear layers, at least 1.
        hidden_dim: width between the layers.
    """

    def __init__(self, *, in_dim: int, out_dim: int, num_layers: int, hidden_dim: int) -> None:
        super().__init__()
        dims = [in_dim, *[hidden_dim] * (num_layers - 1), out_dim]
        self.layers = nn.ModuleList(nn.Linear(a, b, bias=False) for a, b in zip(dims[:-1], dims[1:], strict=True))

    @property
    def weights(self) -> list[Tensor]:
        """(out, in) matrices, first layer first."""
        return [layer.get_parameter("weight") for layer in self.layers]

    def forward(self, features: Float[Tensor, "*batch in_dim"]) -> Float[Tensor, "*batch out_dim"]:
        """Apply the layers to the last axis."""
        return self.after_first(self.layers[0](features))

    def after_first(self, features: Float[Tensor, "*batch first_dim"]) -> Float[Tensor, "*batch out_dim"]:
        """Apply everything behind the first layer to what the first layer returned."""
        for layer in self.layers[1:]:
            features = layer(F.relu(features))
        return features


class CoordMLP(nn.Module):
    """Field over coordinates, optionally conditioned on one vector per group of points.

    ``MLP(ReLU([Linear(embed(x)), condition]))``: the ReLU covers the condition too. The first layer of the MLP is applied
    to its coordinate and condition columns separately, the latter once per group, so that no (point, condition_dim)
    tensor exists.

    Args:
        num_octaves: octaves of the harmonic embedding.
        base_frequency: its lowest frequency, radians per world unit.
        in_dim: number of coordinates.
        condition_dim: width of the condition, 0 for none.
        out_dim: output width.
        num_layers: linear layers behind the input layer, at least 1.
        hidden_dim: width of the hidden layers.
        precision: of the matrix products; coordinates, their embedding, parameters and the result are not affected.
    """

    def __init__(
        self,
        *,
        num_octaves: int,
        base_frequency: float,
        in_dim: int = 3,
        condition_dim: int,
        out_dim: int,
        num_layers: int,
        hidden_dim: int,
        precision: Precision,
    ) -> None:
        super().__init__()
        self.hidden_dim = hidden_dim
        self.condition_dim = condition_dim
        self.precision: Precision = precision
        self.embedding = HarmonicEmbedding(num_octaves=num_octaves, base_frequency=base_frequency)
        self.in_layer = nn.Linear(self.embedding.out_dim(in_dim), hidden_dim)
        self.mlp = MLP(in_dim=hidden_dim + condition_dim, out_dim=out_dim, num_layers=num_layers, hidden_dim=hidden_dim)

    def forward(
        self,
        points: Float[Tensor, "point coord"],
        condition: Float[Tensor, "group condition_dim"] | None = None,
        group: Int[Tensor, " point"] | None = None,
    ) -> Float[Tensor, "point out_dim"]:
        """Evaluate the field.

        Args:
            points: coordinates, world units.
            condition: one vector per group; required exactly when ``condition_dim > 0``.
            group: row of ``condition`` of each point; may be left out when there is a single group.

        Raises:
            ValueError: when ``condition`` or ``group`` is missing or superfluous.
        """
        if (condition is not None) != (self.condition_dim > 0):
            raise ValueError(f"condition must be given exactly when condition_dim > 0, here {self.condition_dim}")
        if condition is not None and group is None and condition.shape[0] != 1:
            raise ValueError(f"group is required with {condition.shape[0]} conditions")
        embedded = self.embedding(points)
        with matmul_precision(self.precision, points.device):
            hidden = self._coordinate_part(embedded)
            if condition is not None:
                shared = self._condition_part(condition)
                hidden = hidden + (shared if group is None else take_groups(shared, group))
            return self.mlp.after_first(hidden).to(points.dtype)

    def grid(
        self, points: Float[Tensor, "point coord"], condition: Float[Tensor, "group condition_dim"]
    ) -> Float[Tensor, "group point out_dim"]:
        """Evaluate the field of every condition at the same points, whose embedding and input layer are shared."""
        embedded = self.embedding(points)
        with matmul_precision(self.precision, points.device):
            hidden = self._coordinate_part(embedded) + self._condition_part(condition)[:, None]
            return self.mlp.after_first(hidden).to(points.dtype)

    def _coordinate_part(self, embedded: Tensor) -> Tensor:
        return F.linear(F.relu(self.in_layer(embedded)), self.mlp.weights[0][:, : self.hidden_dim])

    def _condition_part(self, condition: Tensor) -> Tensor:
        return F.linear(F.relu(condition), self.mlp.weights[0][:, self.hidden_dim :])


def take_groups(values: Float[Tensor, "group chan"], group: Int[Tensor, " point"]) -> Float[Tensor, "point chan"]:
    """``values[group]`` for few groups and many points, as a product with 0 and 1.

    Its gradient is one more product: several times faster than adding rows one by one, deterministic on every device,
    and exact in the forward direction.
    """
    chosen = group[:, None] == torch.arange(values.shape[0], device=group.device)
    return chosen.to(values.dtype) @ values


def modulated_weight(
    weight: Float[Tensor, "out_dim in_dim"], style: Float[Tensor, " in_dim"], eps: float
) -> Float[Tensor, "out_dim in_dim"]:
    """Scale the columns of a weight by a style and normalise its rows (StyleGAN2 demodulation).

    ``W'[o, i] = W[o, i] s[i]``, returned is ``W'[o, i] / sqrt(sum_i W'[o, i]**2 + eps)``: row norms are
    ``sqrt(S / (S + eps))`` with ``S = sum_i W'[o, i]**2``, so ``eps`` also sets how small a style silences the layer.

    Args:
        weight: matrix of a bias-free linear layer.
        style: one factor per input.
        eps: positive floor under the root.
    """
    scaled = weight * style
    return scaled * torch.rsqrt(scaled.square().sum(dim=1, keepdim=True) + eps)
