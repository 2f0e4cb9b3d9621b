"""Other bodies: no two people have the same bones, and no two trackers place joints alike.

Drawn once per window: the length of each bone, and the tracker's displacement of each joint. Both
apply to the history and to the future, so the target is the true motion of that body.

The ranges are wide on purpose; they are not fitted to any tracker. They cover a known one with
shoulders 10 cm from the neck (20 cm in optical motion capture) and hips 6.5 cm from the middle (9
cm).
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from hri_predict.base.arrays import Bools
from hri_predict.base.settings import Settings
from hri_predict.predictors.neural.body import BODY

_SIDES = 0.03  # standard deviation of the logarithm of a bone's length against its other side's
_LEGS = [BODY.index(side + joint) for side in ("l_", "r_") for joint in ("knee", "ankle")]
_PAIRS = (("l_hip", "r_hip"), ("l_shoulder", "r_shoulder"))
_INWARD_M = {"shoulder": (-0.02, 0.10), "hip": (-0.03, 0.03)}
"""Range of a joint's displacement towards the body's middle plane."""
_AROUND_M = {
    "shoulder": 0.03, "hip": 0.03, "pelvis": 0.03, "torso": 0.04, "chest": 0.04, "cervical": 0.04,
    "skull_base": 0.04, "head": 0.06, "elbow": 0.02, "knee": 0.02, "wrist": 0.02, "ankle": 0.02,
    "knuckles": 0.03, "hand": 0.03, "thumb": 0.03, "ball": 0.03, "foot": 0.03,
}  # fmt: skip
"""Largest displacement of other joints along each of the body's axes."""


class BodySettings(Settings):
    """Variation of bodies (``data.bodies:``)."""

    share: float = Field(0.7, ge=0, le=1, description="share of windows with another body")
    bones: float = Field(
        0.12,
        ge=0,
        le=0.5,
        description="standard deviation of the logarithm of a bone's length: its relative spread",
    )
    joints: float = Field(
        1.0,
        ge=0,
        le=3,
        description="strength of the joints' displacement; 1: shoulders up to 10 cm inwards, hips "
        "3 cm, the head 6 cm, hands and feet 3 cm, other joints of limbs 2 cm",
    )


@dataclass(frozen=True, slots=True)
class DrawnBodies:
    """One drawn body for each window.

    Attributes:
        bones: (B, J) factor of each bone's length, from its joint to the parent.
        joints: (B, J, 3) displacement in metres: ahead, to the left, up.
    """

    bones: NDArray[np.float32]
    joints: NDArray[np.float32]

    def worn(self, positions: NDArray[np.float32], observed: Bools) -> NDArray[np.float32]:
        """Move windows (B, N, J, 3) of people with z up onto these bodies.

        A person with longer legs also walks further with each step.
        """
        present = observed.any(2, keepdims=True)
        throughout: Bools = np.asarray((observed | ~present).all(1) & observed.any(1))  # (B, J)
        moved = positions + self._lengthened(positions, throughout)
        weight = throughout[:, None, :, None].astype(np.float32)
        centre = (moved * weight).sum(2) / np.maximum(weight.sum(2), 1)
        stride = self.bones[:, _LEGS].mean(1)[:, None, None] - 1
        travel = stride * (centre - centre.mean(1, keepdims=True)) * _LEVEL
        ahead, left = _heading(positions, observed)
        x, y, z = (self.joints[:, None, :, k, None] for k in range(3))
        displaced = x * ahead[:, :, None] + y * left[:, :, None] + z * _UP
        return (moved + travel[:, :, None] + displaced).astype(np.float32)

    def _lengthened(self, positions: NDArray[np.float32], throughout: Bools) -> NDArray[np.float32]:
        """(B, N, J, 3) displacement by the bones' new lengths, from the root outwards.

        A joint that is not seen ``throughout`` the window (B, J) moves no others: its children
        would jump when it vanishes.
        """
        place = np.ascontiguousarray(positions.transpose(2, 0, 1, 3))  # joint by joint: faster
        shift, carried = np.zeros_like(place), np.zeros_like(place)
        held = throughout.copy()
        for joint, parent in enumerate(BODY.parents):
            if parent < 0:
                continue
            longer = (self.bones[:, joint] - 1) * held[:, parent]
            bone = place[joint] - place[parent]
            shift[joint] = carried[parent] + longer[:, None, None] * bone
            carried[joint] = shift[joint]
            lost = ~throughout[:, joint]
            if lost.any():  # its neighbours hang on the joint before it
                carried[joint, lost], place[joint, lost] = (
                    carried[parent, lost],
                    place[parent, lost],
                )
            held[:, joint] |= held[:, parent]
        return shift.transpose(1, 2, 0, 3)


_LEVEL = np.array([1, 1, 0], np.float32)
_UP = np.array([0, 0, 1], np.float32)


def draw_bodies(settings: BodySettings, rng: np.random.Generator, count: int) -> DrawnBodies:
    """Draw ``count`` bodies; ``1 - share`` of them as they were recorded."""
    other = (rng.random(count) < settings.share).astype(np.float32)[:, None]
    log = settings.bones * rng.standard_normal((count, len(BODY.joints)), np.float32)
    around = np.array([_AROUND_M[_kind(name)] for name in BODY.joints], np.float32)
    joints = rng.uniform(-1, 1, (count, len(BODY.joints), 3)).astype(np.float32)
    joints *= around[:, None]
    for kind, inward in _INWARD_M.items():
        joints[:, BODY.index("l_" + kind), 1] = -rng.uniform(*inward, count)
    own = rng.standard_normal((count, len(BODY.joints)), np.float32) * min(_SIDES, settings.bones)
    for left, right in BODY.left_right_pairs:  # a convention or a person's build: on both sides
        log[:, right] = log[:, left]
        joints[:, right] = joints[:, left] * [1, -1, 1]
    bones = np.exp((log + own) * other)
    return DrawnBodies(bones, settings.joints * other[..., None] * joints)


def _kind(joint: str) -> str:
    return joint.removeprefix("l_").removeprefix("r_")


def _heading(
    positions: NDArray[np.float32], observed: Bools
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """(B, N, 3) horizontal axes ahead and to the left, from the hips or else the shoulders.

    Where neither pair is seen, the window's mean axes are used; if there are none, the room's.
    """
    count, steps = positions.shape[:2]
    left = np.zeros((count, steps, 3), np.float32)
    taken = np.zeros(count, bool)
    for names in _PAIRS:
        a, b = (BODY.index(name) for name in names)
        both = (observed[:, :, a] & observed[:, :, b])[..., None]
        across = np.where(both, positions[:, :, a] - positions[:, :, b], 0) * _LEVEL
        mean = across.sum(1, keepdims=True) / np.maximum(both.sum(1, keepdims=True), 1)
        use = ~taken & both.any((1, 2))
        left[use] = np.where(both, across, mean)[use]
        taken |= use
    left[~taken, :, 1] = 1
    length = np.linalg.norm(left, axis=-1, keepdims=True)
    left = np.where(length > 1e-3, left / np.maximum(length, 1e-3), [0, 1, 0]).astype(np.float32)
    ahead = np.stack([left[..., 1], -left[..., 0], left[..., 2]], -1)
    return ahead, left
