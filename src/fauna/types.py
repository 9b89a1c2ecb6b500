"""Frozen dataclasses handed from one stage of the pipeline to the next.

Frames, units and axis names are defined in ``docs/conventions.md``. Axis names used in shapes:
``batch`` photos of a step, ``row`` rendered (photo, viewpoint hypothesis) pairs, ``vert face edge bone hyp slot chan height width``.
A step renders one row per photo when one hypothesis is sampled and ``hyp`` rows per photo when all are rendered.
"""

from dataclasses import dataclass, fields, replace
from functools import cached_property
from typing import Any

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor


@dataclass(frozen=True)
class Features:
    """Frozen encoder output for a batch of photos.

    Attributes:
        global_: (batch, global_chan) image descriptor, the query of the bank.
        tokens: (batch, chan, grid_height, grid_width) last-layer patch tokens.
        keys: (batch, chan, grid_height, grid_width) last-layer attention keys (equal to ``tokens`` for convolutional encoders).
    """

    global_: Float[Tensor, "batch global_chan"]
    tokens: Float[Tensor, "batch chan grid_height grid_width"]
    keys: Float[Tensor, "batch chan grid_height grid_width"]

    def to(self, device: torch.device) -> "Features":
        """The same on another device."""
        tokens = self.tokens.to(device, non_blocking=True)
        keys = tokens if self.keys is self.tokens else self.keys.to(device, non_blocking=True)
        return Features(self.global_.to(device, non_blocking=True), tokens, keys)

    def rows(self, index: Int[Tensor, " row"]) -> "Features":
        """Gather photos by index, e.g. to repeat each photo for its rendered hypotheses."""
        keys = self.keys[index] if self.keys is not self.tokens else None
        tokens = self.tokens[index]
        return Features(self.global_[index], tokens, tokens if keys is None else keys)


@dataclass(frozen=True)
class Batch:
    """One step's photos, all of one species. Carries no camera, keypoints, 3D or label beyond the category index.

    Attributes:
        images: (batch, 3, height, width) in [0, 1], background kept, at render resolution.
        masks: (batch, height, width) in [0, 1]; area-averaged, so soft on the outline when the photo was reduced.
        distance_inside: (batch, height, width) exact Euclidean distance of a foreground pixel to the background, image widths.
        distance_outside: (batch, height, width) the same for a background pixel to the foreground.
        valid: (batch, height, width) 1 where the pixel comes from inside the original photo.
        category: index of the species among the training species, ``None`` when unknown (only ``bank=category`` reads it).
        names: one name per photo, for messages and reports.
        features: frozen features, when they were cached; otherwise ``encoder_images`` is given.
        encoder_images: (batch, 3, encoder_height, encoder_width) in [0, 1].
        feature_targets: (batch, chan, target_height, target_width) in [0, 1] when the dataset supplies them.
    """

    images: Float[Tensor, "batch 3 height width"]
    masks: Float[Tensor, "batch height width"]
    distance_inside: Float[Tensor, "batch height width"]
    distance_outside: Float[Tensor, "batch height width"]
    valid: Float[Tensor, "batch height width"]
    category: int | None
    names: tuple[str, ...]
    features: Features | None = None
    encoder_images: Float[Tensor, "batch 3 encoder_height encoder_width"] | None = None
    feature_targets: Float[Tensor, "batch chan target_height target_width"] | None = None

    def to(self, device: torch.device) -> "Batch":
        """The same on another device."""
        values: dict[str, Any] = {field.name: getattr(self, field.name) for field in fields(self)}
        moved = {
            name: value.to(device, non_blocking=True) for name, value in values.items() if isinstance(value, Tensor)
        }
        features = None if self.features is None else self.features.to(device)
        return replace(self, **moved, features=features)


@dataclass(frozen=True)
class ImageEmbedding:
    """Learned global embeddings of a photo.

    Attributes:
        texture: (batch, texture_chan) drives albedo and light.
        geometry: (batch, geometry_chan) drives deformation and articulation.
    """

    texture: Float[Tensor, "batch texture_chan"]
    geometry: Float[Tensor, "batch geometry_chan"]

    def rows(self, index: Int[Tensor, " row"]) -> "ImageEmbedding":
        """Gather photos by index."""
        return ImageEmbedding(self.texture[index], self.geometry[index])


@dataclass(frozen=True)
class BankReadout:
    """What the bank answers to a query.

    Attributes:
        embedding: (batch, value_chan) shape code per photo.
        weights: (batch, slot) signed, sum of absolute values 1; ``None`` for banks without slots.
        slots: (batch, slot) indices of the slots the weights belong to; ``None`` likewise.
    """

    embedding: Float[Tensor, "batch value_chan"]
    weights: Float[Tensor, "batch slot"] | None = None
    slots: Int[Tensor, "batch slot"] | None = None


@dataclass(frozen=True)
class BaseShape:
    """Rest mesh in the canonical frame, shared by every photo of the batch.

    Attributes:
        verts: (vert, 3) world units, differentiable.
        faces: (face, 3) vertex indices, counter-clockwise seen from outside.
    """

    verts: Float[Tensor, "vert 3"]
    faces: Int[Tensor, "face 3"]

    @cached_property
    def topology(self) -> "Topology":
        """Edges of the faces, found once per mesh."""
        from fauna.geometry.mesh import build_topology

        return build_topology(self.faces)


@dataclass(frozen=True)
class InstanceShape:
    """Rest mesh after instance deformation.

    Attributes:
        verts: (batch or 1, vert, 3); leading axis 1 while nothing is deformed.
        offsets: (batch, vert, 3) what was added to the base, ``None`` when deformation is off.
    """

    verts: Float[Tensor, "batch vert 3"]
    offsets: Float[Tensor, "batch vert 3"] | None = None


@dataclass(frozen=True)
class Camera:
    """Pinhole cameras, one per row. See ``docs/conventions.md``.

    Attributes:
        camera_from_world: (row, 4, 4) rigid; the camera looks along its -z, x right, y up.
        clip_from_world: (row, 4, 4); NDC x right, y DOWN, (-1, -1) is the top left corner.
    """

    camera_from_world: Float[Tensor, "row 4 4"]
    clip_from_world: Float[Tensor, "row 4 4"]

    def rows(self, index: Int[Tensor, " new"]) -> "Camera":
        """Gather cameras by index."""
        return Camera(self.camera_from_world[index], self.clip_from_world[index])


@dataclass(frozen=True)
class Hypotheses:
    """All viewpoint hypotheses of a photo.

    Attributes:
        rotations: (batch, hyp, 3, 3) camera_from_world rotations; column 2 is the animal's +z axis seen by the camera.
        translation: (batch, 3) added to the nominal (0, 0, -distance), world units.
        predicted_losses: (batch, hyp) estimate of the reconstruction loss, lower is better.
        probabilities: (batch, hyp) softmax(-predicted_losses / temperature).
    """

    rotations: Float[Tensor, "batch hyp 3 3"]
    translation: Float[Tensor, "batch 3"]
    predicted_losses: Float[Tensor, "batch hyp"]
    probabilities: Float[Tensor, "batch hyp"]


@dataclass(frozen=True)
class Selection:
    """Which hypotheses are rendered, one entry per row; photo-major, equally many rows for every photo.

    Attributes:
        photo: (row,) index into the batch.
        hypothesis: (row,) index into the hypotheses of that photo.
    """

    photo: Int[Tensor, " row"]
    hypothesis: Int[Tensor, " row"]


@dataclass(frozen=True)
class Skeleton:
    """Rest bones, heuristically placed, without gradient.

    Attributes:
        starts: (batch or 1, bone, 3) joint nearer to the body centre.
        ends: (batch or 1, bone, 3) joint farther from it.
        parents: (batch or 1, bone) index of the parent bone, -1 at a root.
    """

    starts: Float[Tensor, "batch bone 3"]
    ends: Float[Tensor, "batch bone 3"]
    parents: Int[Tensor, "batch bone"]

    def rows(self, index: Int[Tensor, " row"]) -> "Skeleton":
        """Gather skeletons by index."""
        return Skeleton(self.starts[index], self.ends[index], self.parents[index])


@dataclass(frozen=True)
class Pose:
    """Bone rotations of each row.

    Attributes:
        angles: (row, bone, 3) Euler XYZ in the bone's rest frame, radians: swing, sideways, twist.
    """

    angles: Float[Tensor, "row bone 3"]


@dataclass(frozen=True)
class PosedMesh:
    """Skinned mesh of each row.

    Attributes:
        verts: (row, vert, 3) world units.
        faces: (face, 3).
        canonical: (vert, 3) base-shape positions of the same vertices: where fields are looked up.
        bone_starts: (row, bone, 3) posed joints, ``None`` when nothing is articulated.
        bone_ends: (row, bone, 3).
    """

    verts: Float[Tensor, "row vert 3"]
    faces: Int[Tensor, "face 3"]
    canonical: Float[Tensor, "vert 3"]
    bone_starts: Float[Tensor, "row bone 3"] | None = None
    bone_ends: Float[Tensor, "row bone 3"] | None = None

    def rows(self, index: Int[Tensor, " new"]) -> "PosedMesh":
        """Gather rows by index."""
        starts = None if self.bone_starts is None else self.bone_starts[index]
        ends = None if self.bone_ends is None else self.bone_ends[index]
        return PosedMesh(self.verts[index], self.faces, self.canonical, starts, ends)


@dataclass(frozen=True)
class Light:
    """One directional light with ambient term per photo, in the camera frame.

    Attributes:
        direction: (row, 3) unit vector towards the light, y > 0.
        ambient: (row,) in [0, 1].
        diffuse: (row,) in [0.5, 1].
    """

    direction: Float[Tensor, "row 3"]
    ambient: Float[Tensor, " row"]
    diffuse: Float[Tensor, " row"]


@dataclass(frozen=True)
class Topology:
    """Edges of a triangle mesh.

    Attributes:
        edges: (edge, 2) vertex indices, smaller first, each undirected edge once.
        edge_faces: (edge, 2) the adjacent faces, -1 in the second place at a border.
    """

    edges: Int[Tensor, "edge 2"]
    edge_faces: Int[Tensor, "edge 2"]


@dataclass(frozen=True)
class Fragments:
    """What a rasteriser sees through each pixel centre.

    Attributes:
        face_index: (row, height, width) nearest face, -1 for background. Row 0 of the image is the TOP.
        barycentrics: (row, height, width, 3) perspective-correct, differentiable to the clip positions, 0 on background.
        depth: (row, height, width) NDC depth z/w of the hit, +inf on background, without gradient.
    """

    face_index: Int[Tensor, "row height width"]
    barycentrics: Float[Tensor, "row height width 3"]
    depth: Float[Tensor, "row height width"]

    @property
    def covered(self) -> Bool[Tensor, "row height width"]:
        """True where a triangle was hit."""
        return self.face_index >= 0


@dataclass(frozen=True)
class Shading:
    """Colours and features of a list of pixels, antialiased.

    Attributes:
        pixels: flat indices into (row, height, width), ascending.
        row: of each pixel.
        rgb: shaded colour over black, not clamped.
        features: rendered feature field over 0.
        share: expected share of the wanted pixels that is listed, in (0, 1].
    """

    pixels: Int[Tensor, " pixel"]
    row: Int[Tensor, " pixel"]
    rgb: Float[Tensor, "pixel 3"]
    features: Float[Tensor, "pixel chan"]
    share: float


@dataclass(frozen=True)
class Renders:
    """What is seen of each row.

    Attributes:
        silhouette: (row, height, width) antialiased coverage in [0, 1], differentiable.
        covered: (row, height, width) hard coverage.
        shading: colours and features: of all pixels that show the mesh, or in training of those that enter a loss.
    """

    silhouette: Float[Tensor, "row height width"]
    covered: Bool[Tensor, "row height width"]
    shading: Shading

    def image(self, values: Float[Tensor, "pixel chan"]) -> Float[Tensor, "row chan height width"]:
        """Values of the listed pixels as images over zero."""
        rows, height, width = self.silhouette.shape
        flat = values.new_zeros(rows * height * width, values.shape[1]).index_copy(0, self.shading.pixels, values)
        return flat.reshape(rows, height, width, -1).movedim(-1, 1)


@dataclass(frozen=True)
class Reconstruction:
    """Everything the model says about a batch; one entry per row where a field is per row.

    Attributes:
        readout: the bank's answer per photo.
        code: (value_chan,) mean shape code of the batch, the condition of base shape, feature field and discriminator.
        base: rest mesh of the code.
        instance: rest mesh of each photo.
        hypotheses: all viewpoints of each photo.
        selection: which of them were rendered.
        camera: of each row.
        posed: skinned mesh of each row.
        renders: images of each row.
        light: of each row.
        skeleton: rest bones, ``None`` while articulation is off.
        pose: bone angles of each row, ``None`` likewise.
        embedding: learned image embeddings of each row: what fields are conditioned on.
    """

    readout: BankReadout
    code: Float[Tensor, " value_chan"]
    base: BaseShape
    instance: InstanceShape
    hypotheses: Hypotheses
    selection: Selection
    camera: Camera
    posed: PosedMesh
    renders: Renders
    light: Light
    skeleton: Skeleton | None = None
    pose: Pose | None = None
    embedding: ImageEmbedding | None = None
