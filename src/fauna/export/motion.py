"""A clip in the making: turns in rest axes, metres, feet on the ground."""

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from jaxtyping import Bool, Float
from scipy.spatial.transform import Rotation

from fauna.export.animal import Clip, RiggedAnimal
from fauna.export.joints import JOINT, NUM_JOINTS, ROOT
from fauna.export.legs import Leg, bend

_REACH = 0.99
"""Share of the way from hip to ankle that a standing leg uses at most, so that knees never lock."""

_ANKLE_RISES = {True: 0.4, False: 0.7}
"""Share of a lifted foot's height by which the ankle of a front and of a hind leg rises; the rest is the foot folding back."""


@dataclass(frozen=True, eq=False)
class Steps:
    """What one foot does.

    Attributes:
        leg: whose.
        places: (frame, 3) of the sole, metres.
        lift: (frame,) 0 on the ground, 1 where it is highest.
        grounded: the foot reaches the ground.
        as_front: it bends as a front leg does.
    """

    leg: Leg
    places: Float[np.ndarray, "frame 3"]
    lift: Float[np.ndarray, " frame"]
    grounded: bool
    as_front: bool

    @property
    def standing(self) -> Bool[np.ndarray, " frame"]:
        """Whether it carries."""
        return (self.lift <= 0.0) & self.grounded

    def folded(self) -> Float[np.ndarray, "frame 3 3"]:
        """How the foot bone is turned against rest: not at all on the ground, back in the air."""
        foot = max(float(np.linalg.norm(self.leg.ankle_over_sole)), 1e-9)
        drop = (1.0 - _ANKLE_RISES[self.as_front]) * float(self.places[:, 1].max()) / foot
        angles = np.arccos(np.clip(1.0 - drop, 0.0, 1.0)) * self.lift
        return Rotation.from_rotvec(np.outer(angles, (1.0, 0.0, 0.0))).as_matrix()


@dataclass(eq=False)
class Motion:
    """Turns of the joints against their parents, in rest axes, and the root's translation.

    Attributes:
        animal: who moves.
        times: (frame,) seconds.
        turns: (frame, joint, 3, 3).
        translation: (frame, 3) metres.
    """

    animal: RiggedAnimal
    times: Float[np.ndarray, " frame"]
    turns: Float[np.ndarray, "frame joint 3 3"] = field(init=False)
    translation: Float[np.ndarray, "frame 3"] = field(init=False)

    def __post_init__(self) -> None:
        self.turns = np.tile(np.eye(3), (len(self.times), NUM_JOINTS, 1, 1))
        self.translation = np.zeros((len(self.times), 3))

    def turn(self, joint: str, *, pitch_deg: Any = 0.0, yaw_deg: Any = 0.0, roll_deg: Any = 0.0) -> None:
        """Turn a joint, after what turned it before.

        Args:
            joint: its name.
            pitch_deg: per frame or for all; about +x, lowers what lies in front.
            yaw_deg: about +y, turns what lies in front to the animal's left.
            roll_deg: about +z, raises the left side.
        """
        angles = np.stack(np.broadcast_arrays(yaw_deg, pitch_deg, roll_deg, self.times)[:3], axis=1)
        at = JOINT[joint]
        self.turns[:, at] = Rotation.from_euler("YXZ", angles, degrees=True).as_matrix() @ self.turns[:, at]

    def carried(self, leg: Leg) -> tuple[Float[np.ndarray, "frame 3 3"], Float[np.ndarray, "frame 3"]]:
        """Rotation of what a leg hangs from, and the place of its hip."""
        rotation, place = np.eye(3), np.zeros(3)
        chain = [leg.parent]
        while chain[-1] != ROOT:
            chain.append(int(self.animal.parents[chain[-1]]))
        start = np.zeros(3)
        for joint in reversed(chain):
            place = place + rotation @ (self.animal.starts[joint] - start)
            place = place + (self.translation if joint == ROOT else 0.0)
            rotation, start = rotation @ self.turns[:, joint], self.animal.starts[joint]
        return rotation, place + rotation @ (leg.hip - start)

    def excess(self, steps: Steps) -> Float[np.ndarray, " frame"]:
        """How much too high the hip is for the foot to stand, metres; negative where there is room, -inf in the air."""
        _, hip = self.carried(steps.leg)
        apart = steps.places + steps.leg.ankle_over_sole - hip
        square = (_REACH * steps.leg.reach) ** 2 - apart[:, 0] ** 2 - apart[:, 2] ** 2
        return np.where(steps.standing, -apart[:, 1] - np.sqrt(square.clip(min=0.0)), -np.inf)

    def place_foot(self, steps: Steps) -> None:
        """Bend a leg so that its sole is where it has to be; to be called when the spine is done.

        A standing foot bone keeps the direction it has at rest, so that the sole stays flat on the ground. A leg that does
        not reach the ground stays straight.
        """
        if not steps.grounded:
            return
        rotation, hip = self.carried(steps.leg)
        folded = steps.folded()
        targets = np.einsum("fba,fb->fa", rotation, steps.places + folded @ steps.leg.ankle_over_sole - hip)
        feet = np.broadcast_to(rotation, folded.shape).swapaxes(1, 2) @ folded
        turns = bend(steps.leg, targets, feet, knee_forward=not steps.as_front)
        self.turns[:, list(steps.leg.joints.joints)] = turns

    def clip(self, name: str, *, loop: bool, speed: float, extras: dict[str, Any]) -> Clip:
        """The finished clip."""
        frames = self.animal.frames
        own = frames.swapaxes(1, 2) @ self.turns @ frames
        quaternions = Rotation.from_matrix(own.reshape(-1, 3, 3)).as_quat(canonical=True)
        return Clip(
            name,
            self.times,
            quaternions.reshape(len(self.times), NUM_JOINTS, 4),
            self.translation,
            loop=loop,
            speed=speed,
            extras=extras,
        )
