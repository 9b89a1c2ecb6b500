"""What the signed distance field is before it has learned anything: an ellipsoid (paper), or one on four legs. Positive inside."""

from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

from fauna.errors import FaunaError


@dataclass(frozen=True)
class Legs:
    """Four vertical capsules, mirrored in x and z, that a prior stands on; world units.

    Attributes:
        x: distance of a leg's axis from the mirror plane.
        z: distance from the middle, along the body.
        hip: height of the upper end.
        foot: height of the lower end.
        radius: of a leg.
        blend: width over which legs and body melt into each other.
    """

    x: float
    z: float
    hip: float
    foot: float
    radius: float
    blend: float

    def __post_init__(self) -> None:
        if not (self.foot < self.hip and self.radius > 0 and self.blend > 0):
            raise FaunaError(
                f"shape.sdf.legs expects foot below hip, radius and blend above 0, got foot {self.foot}, hip {self.hip}, "
                f"radius {self.radius}, blend {self.blend}; mend shape.sdf.legs"
            )


@dataclass(frozen=True)
class Prior:
    """Ellipsoid around (0, lift, 0), on legs or not.

    ``r - |(x - c) * r / radii|`` with ``r`` the smallest radius; with legs the smooth maximum of that and of the distances to
    the capsules.

    Attributes:
        radii: (3,) semi-axes, world units.
        lift: height of the centre.
        legs: what it stands on, or ``None``.
    """

    radii: Float[Tensor, "3"]
    lift: float
    legs: Legs | None

    def __call__(self, points: Float[Tensor, "point 3"]) -> Float[Tensor, " point"]:
        """Signed distance."""
        body = self.radii.min() - self._scaled(points).norm(dim=1)
        if self.legs is None:
            return body
        blend = self.legs.blend
        parts = torch.stack((body, *(self.legs.radius - off.norm(dim=1) for off in self._off_legs(points, self.legs))))
        return blend * torch.logsumexp(parts / blend, dim=0)

    def gradient(self, points: Float[Tensor, "point 3"]) -> Float[Tensor, "point 3"]:
        """Spatial gradient."""
        tiny = torch.finfo(points.dtype).tiny
        scaled = self._scaled(points)
        length = scaled.norm(dim=1, keepdim=True)
        body = -(self.radii.min() / self.radii) * scaled / length.clamp(min=tiny)
        if self.legs is None:
            return body
        distances, gradients = [self.radii.min() - length], [body]
        for off in self._off_legs(points, self.legs):
            length = off.norm(dim=1, keepdim=True)
            distances.append(self.legs.radius - length)
            gradients.append(-off / length.clamp(min=tiny))
        share = torch.softmax(torch.stack(distances) / self.legs.blend, dim=0)  # (part, point, 1)
        return (share * torch.stack(gradients)).sum(dim=0)

    def _scaled(self, points: Tensor) -> Tensor:
        centred = points if self.lift == 0 else points - points.new_tensor((0.0, self.lift, 0.0))
        return centred * (self.radii.min() / self.radii)

    @staticmethod
    def _off_legs(points: Tensor, legs: Legs) -> list[Tensor]:
        """Vectors from the nearest point of each leg's axis, (point, 3) each."""
        x, y, z = points.unbind(dim=1)
        along = y - y.clamp(legs.foot, legs.hip)
        return [torch.stack((x - side * legs.x, along, z - end * legs.z), dim=1) for side in (1, -1) for end in (1, -1)]
