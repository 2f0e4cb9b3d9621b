"""Which way a body's own "down" points, and whether its left is on its left: pure geometry.

Gravity shows in every body, and no joint angle alone shows it: people bend, sit, kneel and reach
up. So all long bones vote together. Each bone, taken from its upper to its lower end as in somebody
who stands with hanging arms, is one vector, and their sum is the body's down. A person who bends
over still has legs, a person who sits still has trunk and shanks, and all who walk or stand agree
to a few degrees. In the recordings of the guide "Wrong axes", the sum of a whole body never stayed
more than 70 degrees from true down.

A turned body can't show that its left and right are swapped, but a joint can: knees bend forward,
toes point forward and elbows lie behind the line of a hanging arm, seen from a body whose left is
on its left. Each is a triple product, which no rotation changes and every mirror inverts.
"""

from dataclasses import dataclass

import numpy as np

from hri_predict.arrays import Bools, Floats
from hri_predict.geometry import cross, norm
from hri_predict.skeleton import JOINTS

_AT = {name: index for index, name in enumerate(JOINTS)}
_BONES = (
    ("neck", "waist"), ("head", "neck"),
    ("l_shoulder", "l_elbow"), ("l_elbow", "l_wrist"),
    ("r_shoulder", "r_elbow"), ("r_elbow", "r_wrist"),
    ("l_hip", "l_knee"), ("l_knee", "l_ankle"),
    ("r_hip", "r_knee"), ("r_knee", "r_ankle"),
)  # fmt: skip
_UPPER = np.array([_AT[a] for a, _ in _BONES])
_LOWER = np.array([_AT[b] for _, b in _BONES])
_TRUNK, _LEGS = 0, (slice(6, 8), slice(8, 10))
_ANKLES = np.array([_AT["l_ankle"], _AT["r_ankle"]])
HANGING = 0.5
"""Least cosine between an arm and the trunk's down at which its elbow says where the front is."""

# Limbs whose tip lies ahead of the line from bottom to top (the elbow of a hanging arm: behind, and
# it moves more freely than a knee, so it counts half): weight, girdle, top, bottom, tip.
_LIMBS = [
    (weight, f"l_{girdle}", f"r_{girdle}", f"{s}_{top}", f"{s}_{bottom}", f"{s}_{tip}")
    for s in ("l", "r")
    for weight, girdle, top, bottom, tip in (
        (0.5, "hip", "hip", "ankle", "knee"),
        (0.5, "hip", "knee", "ankle", "foot"),
        (-0.25, "shoulder", "shoulder", "wrist", "elbow"),
    )
]
_WEIGHTS = np.array([limb[0] for limb in _LIMBS])
_JOINTS = np.array([[_AT[name] for name in limb[1:]] for limb in _LIMBS])
_IS_ARM = _WEIGHTS < 0


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Posture:
    """One body at one capture.

    Attributes:
        down: (3,) metres, the sum of the bones; in somebody upright it points along -z.
        bones_m: metres, the sum of their lengths; ``down`` is as long if all agree.
        has_leg: whether a whole leg is in the sum; without one, somebody who leans over a table
            looks much like somebody who lies.
        handed_m: metres by which knees, toes and elbows lie where they do in a body whose left is
            on its left; negative: on the other side; ``None``: nothing shows it.
        feet_m: z of the mean of the ankles seen, room frame; ``None`` without any.
        middle: (3,) mean of the observed joints, room frame.
        heights: (5th, 90th) percentile of the observed joints' z.
    """

    down: Floats
    bones_m: float
    has_leg: bool
    handed_m: float | None
    feet_m: float | None
    middle: Floats
    heights: tuple[float, float]


def posture_of(positions: Floats, observed: Bools) -> Posture | None:
    """Return the posture of one body; ``None`` without a trunk and one more bone.

    Args:
        positions: (J, 3) metres, canonical joints; finite where observed.
        observed: (J,).
    """
    seen = observed[_UPPER] & observed[_LOWER]
    if not seen[_TRUNK] or np.count_nonzero(seen) < 2:
        return None
    legs = [bool(seen[leg].all()) for leg in _LEGS]
    for leg, whole in zip(_LEGS, legs, strict=True):
        seen[leg] = whole  # a thigh alone says that somebody sits, not where down is
    bones = (positions[_LOWER] - positions[_UPPER])[seen]
    joints = positions[observed]
    heights = np.sort(joints[:, 2])
    ankles = _ANKLES[observed[_ANKLES]]
    return Posture(
        down=bones.sum(axis=0),
        bones_m=float(norm(bones).sum()),
        has_leg=any(legs),
        handed_m=_handed(positions, observed),
        feet_m=float(positions[ankles, 2].mean()) if len(ankles) else None,
        middle=joints.mean(axis=0),
        heights=(float(heights[len(heights) // 20]), float(heights[9 * (len(heights) - 1) // 10])),
    )


def _handed(positions: Floats, observed: Bools) -> float | None:
    """See ``Posture.handed_m``: knees and toes ahead, elbows behind; sums of the sides' halves."""
    use = observed[_JOINTS].all(axis=1)
    left, right, top, bottom, tip = positions[_JOINTS].swapaxes(0, 1)
    if (use & _IS_ARM).any():
        trunk = positions[_AT["waist"]] - positions[_AT["neck"]]
        arms = bottom - top
        use &= ~_IS_ARM | (arms @ trunk > HANGING * norm(arms) * norm(trunk))
    if not use.any():
        return None
    front = cross(left - right, top - bottom)
    ahead = ((tip - bottom) * front).sum(axis=1) / np.maximum(norm(front), 1e-9)
    return float(_WEIGHTS[use] @ ahead[use])
