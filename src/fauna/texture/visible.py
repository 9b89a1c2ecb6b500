"""What a photograph shows of a reconstruction: geometry is rasterised once, colours may then be asked for as often as needed."""

from dataclasses import dataclass, replace

import torch
from jaxtyping import Float, Int
from torch import Tensor

from fauna.appearance.shading import shade
from fauna.errors import FaunaError
from fauna.geometry.camera import to_clip, transform_points
from fauna.geometry.mesh import face_normals, vertex_normals
from fauna.renderer.base import Renderer
from fauna.types import Fragments, InstanceShape, Light, Pose, Reconstruction, Selection


@dataclass(frozen=True, eq=False)
class Visible:
    """The pixels that show the mesh, of all rows; without gradient.

    Attributes:
        fragments: of the whole images.
        pixels: flat indices into (row, height, width), ascending.
        row: of each pixel.
        points: (pixel, 3) base-shape positions: where fields are looked up.
        intensity: of the light at the pixel; colour = albedo * intensity.
    """

    fragments: Fragments
    pixels: Int[Tensor, " pixel"]
    row: Int[Tensor, " pixel"]
    points: Float[Tensor, "pixel 3"]
    intensity: Float[Tensor, " pixel"]


@torch.no_grad()
def see(renderer: Renderer, out: Reconstruction, size: tuple[int, int]) -> Visible:
    """Rasterise a reconstruction with its own cameras and light.

    Args:
        renderer: rasteriser.
        out: of the model.
        size: height and width of the images, pixels.
    """
    posed = out.posed
    matrix = out.camera.camera_from_world
    view = transform_points(posed.verts, matrix[:, :3])
    fragments = renderer.rasterize(to_clip(posed.verts, out.camera.clip_from_world), posed.faces, *size)
    pixels = fragments.covered.reshape(-1).nonzero()[:, 0]
    row = pixels // (size[0] * size[1])
    attributes = torch.cat((vertex_normals(view, posed.faces), view), dim=2)
    geometry = renderer.interpolate_at(fragments, posed.faces, attributes, pixels)
    flat = face_normals(view, posed.faces)[row, fragments.face_index.reshape(-1)[pixels]]
    points = renderer.interpolate_at(fragments, posed.faces, posed.canonical[None], pixels)
    white = torch.ones_like(points)
    intensity = shade(white, geometry[:, :3], flat, -geometry[:, 3:], out.light, row)[:, 0]
    return Visible(fragments, pixels, row, points, intensity)


def texture_embedding(out: Reconstruction) -> Float[Tensor, "row texture_chan"]:
    """What the albedo of each row is conditioned on.

    Raises:
        FaunaError: for a reconstruction that was put together without it.
    """
    if out.embedding is None:
        raise FaunaError("texture: expected a reconstruction with its image embedding, got none; pass the model's own")
    return out.embedding.texture


def one_row(out: Reconstruction, row: int) -> Reconstruction:
    """The same with a single row: its camera, pose, light, embedding and rest mesh; hypotheses and renders stay.

    ``selection`` still says which photo of the batch it shows.

    Raises:
        FaunaError: when there is no such row.
    """
    rows = out.posed.verts.shape[0]
    if not 0 <= row < rows:
        raise FaunaError(f"texture: expected a row from 0 to {rows - 1}, got {row}; give another one")
    index = torch.tensor([row], device=out.posed.verts.device)
    photo = out.selection.photo[index]
    verts, offsets = out.instance.verts, out.instance.offsets
    instance = InstanceShape(
        verts if len(verts) == 1 else verts[photo], offsets if offsets is None or len(offsets) == 1 else offsets[photo]
    )
    skeleton = out.skeleton
    return replace(
        out,
        instance=instance,
        selection=Selection(photo, out.selection.hypothesis[index]),
        camera=out.camera.rows(index),
        posed=out.posed.rows(index),
        light=Light(out.light.direction[index], out.light.ambient[index], out.light.diffuse[index]),
        skeleton=skeleton if skeleton is None or len(skeleton.starts) == 1 else skeleton.rows(photo),
        pose=None if out.pose is None else Pose(out.pose.angles[index]),
        embedding=None if out.embedding is None else out.embedding.rows(index),
    )
