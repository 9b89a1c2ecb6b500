"""The photograph's own pixels on the surface: what is seen, the same mirrored to the other side, and a fill for the rest."""

from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float, Int
from scipy.spatial import KDTree
from torch import Tensor
from torch.nn import functional as F

from fauna.appearance.albedo import mirror_to_right
from fauna.appearance.shading import shade
from fauna.geometry.camera import project, transform_points
from fauna.geometry.mesh import vertex_normals
from fauna.kernels.closest_point import nearest_in_group
from fauna.renderer.base import Renderer
from fauna.texture.atlas import Texels
from fauna.texture.visible import see
from fauna.types import Batch, Reconstruction

_FACING = (0.1, 0.4)
"""Cosine between normal and view where a pixel begins to count, and from where on it counts in full."""
_BORDER = (1 / 256, 4 / 256)
"""The same for its distance to the mask's border, image widths."""
_DEPTH = 0.06
"""World units by which a texel may lie behind what is seen and still be the same surface."""
_OCCLUDER, _REACH = 0.12, 3 / 256
"""World units by which something else must be nearer to count as standing before a texel, also when it only passes within
that many image widths: the fit is not exact, and pixels beside an occluder may show it."""
_SAMPLES, _NEIGHBOURS = 20_000, 16
_BLUR, _FADE = 0.1, 0.5
"""World units over which corrections of the fill are averaged, and over which they fade."""


@dataclass(frozen=True, eq=False)
class _Scene:
    """One photograph and what the fitted mesh hides in it.

    Attributes:
        maps: (1, 5, height, width) colours, trust by the mask's border, and 1 inside the photograph.
        depth: (1, 2, height, width) distance of what is seen, and of the nearest thing close by; world units along the view.
        out: a single row.
    """

    maps: Float[Tensor, "1 5 height width"]
    depth: Float[Tensor, "1 2 height width"]
    out: Reconstruction


@torch.no_grad()
def project_photo(
    renderer: Renderer, batch: Batch, out: Reconstruction, texels: Texels, fill: Float[Tensor, "texel 3"]
) -> Float[Tensor, "texel 3"]:
    """Albedo of texels from a photograph: its colours divided by the fitted light.

    A texel takes the pixel it is seen through; one that is not seen takes that of its mirror image in the symmetry plane
    x = 0 of the base shape; what neither side shows takes ``fill``, corrected by what it misses nearby. Weights rise
    smoothly with the cosine between normal and view and with the distance to the mask's border.

    Args:
        renderer: says what is seen.
        batch: photographs, at any resolution of the window that was reconstructed.
        out: a single row of a reconstruction.
        texels: of its atlas.
        fill: albedo of the network at the texels.

    Returns:
        Albedo, not below 0; above 1 where the photograph is brighter than the fitted light allows.
    """
    scene = _scene(renderer, batch, out)
    verts = out.posed.verts[0]
    view = transform_points(verts[None], out.camera.camera_from_world[:, :3])
    attributes = torch.cat((verts, view[0], vertex_normals(view, out.posed.faces)[0]), dim=1)
    corners, weights = mirror_places(out.base.verts, out.base.faces)
    reflected = torch.einsum("vk,vkc->vc", weights, attributes[corners])
    near, near_trust = _look(scene, texels.interpolate(attributes))
    far, far_trust = _look(scene, texels.interpolate(reflected))
    far_trust = (1 - near_trust) * far_trust
    trust = near_trust + far_trust
    known = (near_trust * near + far_trust * far) / trust.clamp_min(1e-6)
    correction = _carried(out.base.verts, texels, known - fill, trust[:, 0])
    return torch.lerp(fill + correction, known, trust).clamp_min(0.0)


def mirror_places(
    verts: Float[Tensor, "vert 3"], faces: Int[Tensor, "face 3"]
) -> tuple[Int[Tensor, "vert 3"], Float[Tensor, "vert 3"]]:
    """The point of the surface nearest to each vertex mirrored at x = 0: vertices of its face, and barycentrics."""
    points = verts.detach().cpu().double().numpy()
    corners = points[faces.cpu().numpy()]
    centres = corners.mean(axis=1)
    radii = np.linalg.norm(corners - centres[:, None], axis=2).max(axis=1)
    starts, stops = np.zeros(len(points), np.int64), np.full(len(points), len(corners), np.int64)
    face, barycentrics = nearest_in_group(points * (-1.0, 1.0, 1.0), starts, stops, corners, centres, radii)
    return faces[torch.from_numpy(face).to(faces.device)], torch.from_numpy(barycentrics).to(verts)


def _scene(renderer: Renderer, batch: Batch, out: Reconstruction) -> _Scene:
    photo = int(out.selection.photo[0])
    height, width = batch.images.shape[-2:]
    fragments = see(renderer, out, (height, width)).fragments
    view = transform_points(out.posed.verts, out.camera.camera_from_world[:, :3])
    distance = renderer.interpolate(fragments, out.posed.faces, -view[..., 2:])
    distance = torch.where(fragments.covered[:, None], distance, torch.inf)
    reach = max(1, round(_REACH * width))
    nearest = -F.max_pool2d(-distance, 2 * reach + 1, stride=1, padding=reach)
    border = _ramp(batch.distance_inside[photo], _BORDER) * batch.valid[photo]
    maps = torch.cat((batch.images[photo], border[None], batch.valid[photo][None]))
    return _Scene(maps[None], torch.cat((distance, nearest), dim=1), out)


def _look(
    scene: _Scene, attributes: Float[Tensor, "texel 9"]
) -> tuple[Float[Tensor, "texel 3"], Float[Tensor, "texel 1"]]:
    """Albedo at surface points given by world position, camera position and camera normal; and trust, 0 where hidden."""
    world, view, normal = attributes.split(3, dim=1)
    place = project(world[None], scene.out.camera)[:, None]  # (1, 1, texel, 2)
    maps = F.grid_sample(scene.maps, place, padding_mode="zeros", align_corners=False)[0, :, 0].T
    depth = F.grid_sample(scene.depth, place, mode="nearest", padding_mode="border", align_corners=False)[0, :, 0].T
    distance = -view[:, 2]
    hidden = (distance > depth[:, 0] + _DEPTH) | (distance > depth[:, 1] + _OCCLUDER)
    facing = F.cosine_similarity(normal, -view, dim=1)
    trust = _ramp(facing, _FACING) * maps[:, 3] * (~hidden) * (maps[:, 4] > 0.99)
    first = torch.zeros(len(view), dtype=torch.long, device=view.device)
    white = torch.ones_like(view)
    intensity = shade(white, normal, normal, -view, scene.out.light, first)
    return maps[:, :3] / intensity.clamp_min(1e-3), trust[:, None]


def _ramp(value: Tensor, span: tuple[float, float]) -> Tensor:
    """0 below the span, 1 above, a smooth step between."""
    share = ((value - span[0]) / (span[1] - span[0])).clamp(0.0, 1.0)
    return share * share * (3.0 - 2.0 * share)


def _carried(
    verts: Float[Tensor, "vert 3"], texels: Texels, missing: Float[Tensor, "texel 3"], trust: Float[Tensor, " texel"]
) -> Float[Tensor, "texel 3"]:
    """What the fill misses at trusted texels, averaged over near ones and carried on to where nothing is known.

    Left and right count as one place, like in the fields.
    """
    trusted = (trust > 0.9).nonzero()[:, 0]
    if not len(trusted):
        return torch.zeros_like(missing)
    trusted = trusted[:: -(-len(trusted) // _SAMPLES)]
    places = mirror_to_right(verts)
    tree = KDTree(texels.interpolate(places)[trusted].cpu().numpy())
    distance, index = tree.query(places.cpu().numpy(), k=min(_NEIGHBOURS, len(trusted)))
    distance, index = (torch.from_numpy(np.atleast_2d(each.T).T).to(verts.device) for each in (distance, index))
    weights = torch.exp(-0.5 * ((distance - distance[:, :1]) / _BLUR).square())
    weights = weights / weights.sum(dim=1, keepdim=True) * torch.exp(-0.5 * (distance[:, :1] / _FADE).square())
    carried = torch.einsum("vk,vkc->vc", weights.to(missing), missing[trusted][index])
    return texels.interpolate(carried)
