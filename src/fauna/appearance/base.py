"""Everything that gives the surface its look: albedo, light and feature field."""

from jaxtyping import Float, Int
from torch import Tensor, nn

from fauna.appearance.albedo import AlbedoField
from fauna.appearance.feature_field import FeatureField
from fauna.appearance.lighting import LightNetwork
from fauna.geometry.half_turn import half_turn
from fauna.types import Light


class Appearance(nn.Module):
    """Fields over the base shape and the light of a photo; the parts are given, not built.

    Args:
        albedo_field: colour at canonical points.
        feature_field: image features at canonical points; learns with the prior.
        light_network: light of a photo.

    Attributes:
        turned: learned with the head at -z, see :mod:`fauna.geometry.half_turn`.
    """

    turned: bool = False

    def __init__(self, *, albedo_field: AlbedoField, feature_field: FeatureField, light_network: LightNetwork) -> None:
        super().__init__()
        self.albedo_field = albedo_field
        self.feature_field = feature_field
        self.light_network = light_network

    def albedo(
        self,
        points: Float[Tensor, "point 3"],
        texture: Float[Tensor, "row texture_chan"],
        row: Int[Tensor, " point"],
    ) -> Float[Tensor, "point 3"]:
        """RGB in [0, 1] at canonical points of the given rows."""
        return self.albedo_field(half_turn(points, self.turned), texture, row)

    def features(
        self, points: Float[Tensor, "point 3"], code: Float[Tensor, " value_chan"]
    ) -> Float[Tensor, "point chan"]:
        """Features in [0, 1] at canonical points, shared by the batch."""
        return self.feature_field(half_turn(points, self.turned), code)

    def light(self, texture: Float[Tensor, "row texture_chan"]) -> Light:
        """Light of each row, camera frame."""
        return self.light_network(texture)
