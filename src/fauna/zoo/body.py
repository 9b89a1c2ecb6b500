"""A skeleton with flesh on it: joints, round cones, tubes, eyes and keypoints of one individual at rest."""

from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float

KEYPOINTS = (
    "left_eye", "right_eye", "nose", "left_ear", "right_ear",
    "left_front_elbow", "right_front_elbow", "left_back_elbow", "right_back_elbow",
    "left_front_knee", "right_front_knee", "left_back_knee", "right_back_knee",
    "left_front_paw", "right_front_paw", "left_back_paw", "right_back_paw",
    "throat", "withers", "tailbase",
)  # fmt: skip
"""The twenty keypoints of Animal-Pose, in its order. ``elbow`` of a back leg is the stifle, ``knee`` the hock."""

SIDES = (("left", 1.0), ("right", -1.0))
"""The animal's own left is +x: it faces +z with y up."""


@dataclass(frozen=True)
class Cone:
    """A round cone of flesh: ``group`` 0 is trunk, neck and head; 1 to 4 the legs, which never blend with each other."""

    start: Float[np.ndarray, "3"]
    end: Float[np.ndarray, "3"]
    radii: tuple[float, float]
    width: float
    blend: float
    group: int
    bone: str
    material: str


@dataclass(frozen=True)
class Tube:
    """A closed swept tube: ``path`` (ring, 3), half axes (ring, 2) along ``wide`` and across, and the bones along it."""

    path: Float[np.ndarray, "ring 3"]
    axes: Float[np.ndarray, "ring 2"]
    wide: Float[np.ndarray, "3"]
    bones: tuple[str, ...]
    materials: tuple[str, ...]


@dataclass
class Body:
    """A skeleton under construction: joints by name, parents by name, and what is hung on it."""

    joints: dict[str, np.ndarray] = field(default_factory=dict)
    parents: dict[str, str | None] = field(default_factory=dict)
    cones: list[Cone] = field(default_factory=list)
    tubes: list[Tube] = field(default_factory=list)
    eyes: list[tuple[np.ndarray, float]] = field(default_factory=list)
    keypoints: dict[str, tuple[np.ndarray, str, float]] = field(default_factory=dict)

    def joint(self, name: str, parent: str | None, place: np.ndarray) -> None:
        """Add a bone that turns about ``place``."""
        self.joints[name], self.parents[name] = np.asarray(place, float), parent

    def mark(self, name: str, place: np.ndarray, bone: str, depth: float) -> None:
        """Record a keypoint; ``depth`` is how deep it may lie under the surface and still count as visible."""
        self.keypoints[name] = (np.asarray(place, float), bone, depth)

    def flesh(
        self, bone: str, start: np.ndarray, end: np.ndarray, radii: tuple[float, float], *,
        width: float = 1.0, blend: float = 0.1, group: int = 0, material: str = "skin",
    ) -> None:  # fmt: skip
        """Add a round cone."""
        start, end = np.asarray(start, float), np.asarray(end, float)
        self.cones.append(Cone(start, end, radii, width, blend, group, bone, material))


def point(side: float, up: float, forward: float) -> np.ndarray:
    """(x, y, z)."""
    return np.array([side, up, forward], float)
