"""Field of self-supervised image features over the base shape (Sec. 3.2)."""

from jaxtyping import Float
from torch import Tensor, nn

from fauna.appearance.albedo import mirror_to_right
from fauna.networks import CoordMLP
from fauna.precision import Precision


class FeatureField(nn.Module):
    """Feature vector of a point of the base shape, ``sigmoid(MLP(x, y, z; shape code))``.

    Args:
        code_dim: width of the shape code.
        out_dim: number of features, that of the PCA targets.
        num_octaves: octaves of the harmonic embedding.
        base_frequency: its lowest frequency, radians per world unit.
        num_layers: linear layers behind the input layer.
        hidden_dim: width of the hidden layers.
        precision: of its matrix products.
        symmetric: the same features on both sides of the body (the published code lets them differ).
    """

    def __init__(
        self,
        *,
        code_dim: int,
        out_dim: int,
        num_octaves: int,
        base_frequency: float,
        num_layers: int,
        hidden_dim: int,
        precision: Precision,
        symmetric: bool,
    ) -> None:
        super().__init__()
        self.symmetric = symmetric
        self.field = CoordMLP(
            num_octaves=num_octaves,
            base_frequency=base_frequency,
            condition_dim=code_dim,
            out_dim=out_dim,
            num_layers=num_layers,
            hidden_dim=hidden_dim,
            precision=precision,
        )

    def forward(
        self, points: Float[Tensor, "point 3"], code: Float[Tensor, " value_chan"]
    ) -> Float[Tensor, "point chan"]:
        """Features in [0, 1] at canonical points, for all photos of the batch at once."""
        points = mirror_to_right(points) if self.symmetric else points
        return self.field(points, code[None]).sigmoid()
