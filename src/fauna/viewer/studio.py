"""Pictures of an animal on a turntable, drawn by our own rasteriser: no window, no graphics card."""

import math
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float, Int, UInt8
from torch import Tensor
from torch.nn import functional as F

from fauna.export.animal import RiggedAnimal
from fauna.geometry.camera import make_camera, to_clip
from fauna.geometry.mesh import vertex_normals
from fauna.renderer.base import Renderer
from fauna.renderer.numba_backend import NumbaRenderer
from fauna.types import Camera, Fragments

FOV_DEG = 25.0
ELEVATION = math.radians(12.0)
"""How far above the horizontal the camera stands."""
FILLED = 0.9
"""Share of the picture that the animal fills when it reaches farthest."""
CLAY = (0.73, 0.70, 0.65)
"""Colour of an animal without texture, sRGB."""
BACKDROP = ((0.93, 0.95, 0.94), (0.84, 0.87, 0.85))
"""Colours at the top and at the bottom of the picture, sRGB."""
SUN = (0.45, 0.75, 0.5)
"""Direction towards the light in the camera frame."""
AMBIENT, DIFFUSE, SHADOW = 0.35, 0.72, 0.4


@dataclass(frozen=True)
class Paint:
    """Colour of a surface, sRGB in [0, 1]: of a picture, or of the vertices.

    Attributes:
        vertex: (vert, 3) colours, where there is no picture.
        corners: (face, 3, 2) places of the faces' corners in the picture, origin at its top left.
        image: (1, 3, height, width) the picture.
    """

    vertex: Float[Tensor, "vert 3"] | None
    corners: Float[Tensor, "face 3 2"] | None
    image: Float[Tensor, "1 3 height width"] | None

    @staticmethod
    def of(animal: RiggedAnimal) -> "Paint":
        """The animal's texture, else its vertex colours, else clay."""
        texture = animal.texture
        if texture is None:
            colours = (
                np.broadcast_to(np.array(CLAY), animal.vertices.shape) if animal.colours is None else animal.colours
            )
            return Paint(torch.tensor(colours, dtype=torch.float32), None, None)
        corners = torch.from_numpy(np.asarray(texture.uv, np.float32)[np.asarray(texture.faces)])
        image = torch.from_numpy(np.ascontiguousarray(texture.image)).permute(2, 0, 1)[None].float() / 255
        return Paint(None, corners, image)

    def at(
        self, face: Int[Tensor, " pixel"], corner_shares: Float[Tensor, "pixel 3"], faces: Int[Tensor, "face 3"]
    ) -> Float[Tensor, "pixel 3"]:
        """Colours at points given by face and barycentrics."""
        if self.vertex is not None:
            return torch.einsum("pk,pkc->pc", corner_shares, self.vertex[faces[face]])
        assert self.corners is not None
        assert self.image is not None
        place = torch.einsum("pk,pkc->pc", corner_shares, self.corners[face])
        grid = 2 * place[None, None] - 1
        return F.grid_sample(self.image, grid, padding_mode="border", align_corners=False)[0, :, 0].T


@dataclass(frozen=True)
class Turntable:
    """The cameras of one turn, all at the distance from which the whole animal is seen in every picture.

    Attributes:
        camera: of each picture.
        centre: (3,) what turns in the middle of the picture.
        floor: height of the ground.
        reach: (2,) how far the animal's shadow goes from the centre in x and z.
    """

    camera: Camera
    centre: Float[Tensor, " 3"]
    floor: float
    reach: Float[Tensor, " 2"]

    @staticmethod
    def around(verts: Float[Tensor, "frame vert 3"]) -> "Turntable":
        """One full turn around an animal, which begins with its left side half turned to the camera.

        Args:
            verts: of each picture, y up.
        """
        flat = verts.flatten(0, 1)
        low, high = flat.amin(dim=0), flat.amax(dim=0)
        centre = (low + high) / 2
        turns = _turns(len(verts))
        seen = (verts - centre) @ turns.transpose(1, 2)
        slope = math.tan(math.radians(FOV_DEG) / 2) * FILLED
        distance = float((seen[..., 2] + seen[..., :2].abs().amax(dim=-1) / slope).amax())
        place = -(turns @ centre)
        camera = make_camera(turns, place, fov_deg=FOV_DEG, distance=distance)
        return Turntable(camera, centre, float(low[1]), 0.65 * (high - low)[[0, 2]] + 0.06 * (high - low).max())


def _turns(count: int) -> Float[Tensor, "frame 3 3"]:
    """camera_from_world rotations of one turn."""
    angle = torch.arange(count) * (2 * math.pi / count) - math.radians(55.0)
    cos, sin, zero, one = angle.cos(), angle.sin(), torch.zeros(count), torch.ones(count)
    about = torch.stack((cos, zero, sin, zero, one, zero, -sin, zero, cos), dim=1).reshape(count, 3, 3)
    up, down = math.cos(ELEVATION), math.sin(ELEVATION)
    return torch.tensor(((1.0, 0.0, 0.0), (0.0, up, -down), (0.0, down, up))) @ about


@torch.no_grad()
def portrait(
    verts: Float[Tensor, "vert 3"], faces: Int[Tensor, "face 3"], *, size: int
) -> UInt8[np.ndarray, "size size 3"]:
    """One picture of a mesh in clay, as a turntable begins.

    Args:
        verts: y up, head at +z.
        faces: counter-clockwise seen from outside.
        size: side of the picture, pixels.
    """
    still = verts.detach().float().cpu()[None]
    paint = Paint(torch.tensor(CLAY).expand(len(verts), 3), None, None)
    return draw(NumbaRenderer(), still, faces.cpu(), paint, Turntable.around(still), 0, size=size)


def draw(
    renderer: Renderer,
    verts: Float[Tensor, "frame vert 3"],
    faces: Int[Tensor, "face 3"],
    paint: Paint,
    table: Turntable,
    frame: int,
    *,
    size: int,
) -> UInt8[np.ndarray, "size size 3"]:
    """One picture: the animal over its backdrop, antialiased by drawing it at twice the size.

    Args:
        renderer: rasteriser.
        verts: of each picture.
        faces: counter-clockwise seen from outside.
        paint: of the surface.
        table: cameras.
        frame: which picture.
        size: side of the picture, pixels.
    """
    one = table.camera.rows(torch.tensor([frame]))
    side = 2 * size
    clip = to_clip(verts[frame, None], one.clip_from_world)
    fragments = renderer.rasterize(clip, faces, side, side)
    pixels = fragments.covered.reshape(-1).nonzero()[:, 0]
    lit = _lit(renderer, fragments, verts[frame, None], faces, paint, one, pixels).clamp(0, 1)
    target = pixels // side // 2 * size + pixels % side // 2
    animal = torch.zeros(size * size, 4).index_add_(0, target, F.pad(lit, (0, 1), value=1.0) / 4)
    picture = animal[:, :3] + (1 - animal[:, 3:]) * _backdrop(table, one, size).reshape(-1, 3)
    return (picture.clamp(0, 1) * 255).round().byte().reshape(size, size, 3).numpy()


def _lit(
    renderer: Renderer,
    fragments: Fragments,
    verts: Float[Tensor, "1 vert 3"],
    faces: Int[Tensor, "face 3"],
    paint: Paint,
    camera: Camera,
    pixels: Int[Tensor, " pixel"],
) -> Float[Tensor, "pixel 3"]:
    """Colours of the animal under a light that stands beside the camera."""
    normals = vertex_normals(verts, faces) @ camera.camera_from_world[:, :3, :3].transpose(1, 2)
    normal = F.normalize(renderer.interpolate_at(fragments, faces, normals, pixels), dim=1)
    facing = normal @ F.normalize(torch.tensor(SUN), dim=0)
    shares = fragments.barycentrics.reshape(-1, 3)[pixels]
    colour = paint.at(fragments.face_index.reshape(-1)[pixels], shares, faces)
    return colour * (AMBIENT + DIFFUSE * (0.5 + 0.5 * facing))[:, None]  # half of it goes round to the dark side


def _backdrop(table: Turntable, camera: Camera, side: int) -> Float[Tensor, "side side 3"]:
    """A soft gradient, and the animal's shadow on the ground."""
    top, bottom = torch.tensor(BACKDROP[0]), torch.tensor(BACKDROP[1])
    place = (2 * torch.arange(side) + 1) / side - 1
    picture = torch.lerp(top, bottom, ((place + 1) / 2)[:, None, None]).repeat(1, side, 1)
    slope = math.tan(math.radians(FOV_DEG) / 2)
    rays = torch.stack(torch.broadcast_tensors(place * slope, -place[:, None] * slope, torch.tensor(-1.0)), dim=-1)
    turn = camera.camera_from_world[0, :3, :3]
    eye = -(turn.T @ camera.camera_from_world[0, :3, 3])
    rays = rays @ turn
    along = (table.floor - eye[1]) / rays[..., 1]
    ground = eye + along[..., None] * rays - table.centre
    far = (ground[..., [0, 2]] / table.reach).square().sum(-1).sqrt()
    dark = torch.where(along > 0, SHADOW * (1 - far).clamp(0, 1).square(), 0.0)
    return picture * (1 - dark[..., None])
