"""A body's own "down" direction, and whether its left and right are swapped: pure geometry.

Every body shows the direction of gravity, but no single joint angle does: people bend, sit, kneel
and reach up. Therefore all long bones are added up. Each bone is a vector from its upper to its
lower end, as in a person who stands with hanging arms, and their sum is the body's down. For a
bending person the legs still point down, for a seated person the trunk and shanks, and for people
who walk or stand all bones agree to a few degrees. In the recordings of the guide "Wrong axes", the
sum of a whole body never stayed more than 70 degrees from true down.

Arms hang, reach and rise, and legs may be horizontal, so a direction requires the trunk (shoulders
to hips, if neck or waist are not seen) or the head and the neck or shoulders. Heights are computed
from all seen joints.

Swapped left and right do not show in the body as a whole, but they do in its joints: in a correct
body, knees bend forward, toes point forward and elbows are behind the line of a hanging arm. Each
is a triple product, which no rotation changes and every mirror inverts.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from hri_predict.base.arrays import Bools, Floats
from hri_predict.base.geometry import cross, norm
from hri_predict.base.skeleton import JOINTS

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
_TRUNK, _HEAD, _ARMS, _LEGS = 0, 1, slice(2, 6), (slice(6, 8), slice(8, 10))
_INSTEAD = (("neck", "l_shoulder", "r_shoulder"), ("waist", "l_hip", "r_hip"))
"""A point of the trunk, and the joints whose midpoint replaces it if it is not seen."""
_ANKLES = np.array([_AT["l_ankle"], _AT["r_ankle"]])
HEAD_M, RAISED_M = 2.1, 2.7
"""Maximum heights of tall people's joints above the floor where they stand: head, shoulders, trunk,
and raised hands, elbows, knees and feet.
"""
_LIFTED = ("elbow", "wrist", "hand", "knee", "ankle", "foot")
_HIGHEST = np.array([RAISED_M if name.endswith(_LIFTED) else HEAD_M for name in JOINTS])
HANGING = 0.5
"""Minimum cosine between a hanging arm and the down direction of trunk or head: the elbow of a
hanging arm shows where the front is."""

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
        down: (3,) metres, the sum of the bones; in an upright person it points along -z.
        bones: number of bones; 0: too little is seen for a direction.
        bones_m: metres, the sum of their lengths; ``down`` is as long if all agree.
        has_leg: whether a whole leg is in the sum; without a leg, a person who leans over a table
            looks like a person who lies down.
        handed_m: metres by which knees, toes and elbows are on the correct side; negative: left and
            right are swapped; ``None``: unknown.
        feet_m: mean z of the seen ankles, room frame; ``None``: no ankle is seen.
        middle: (3,) mean of the observed joints, room frame.
        heights: (5th, 90th) percentile of the observed joints' z.
        lowest_m: z of the second-lowest joint, because one joint may be wrong.
        above_m: minimum z at which a person with joints at these heights can stand, with one joint
            ignored.
    """

    down: Floats
    bones: int
    bones_m: float
    has_leg: bool
    handed_m: float | None
    feet_m: float | None
    middle: Floats
    heights: tuple[float, float]
    lowest_m: float
    above_m: float


def posture_of(positions: Floats, observed: Bools) -> Posture:
    """Return the posture of one body; see ``postures_of``."""
    return postures_of(positions[None], observed[None])[0]


def postures_of(positions: Floats, observed: Bools) -> list[Posture]:
    """Return the postures of n bodies.

    Args:
        positions: (n, J, 3) metres, canonical joints; finite where observed.
        observed: (n, J), at least one joint of each body.
    """
    heights = _Heights(positions, observed)
    positions, observed = _with_trunk(positions, observed)
    seen = _bones_seen(observed)
    bones = positions[:, _LOWER] - positions[:, _UPPER]
    lengths = norm(bones)
    handed, sides = _handed(positions, observed, bones, seen)
    alone = seen[:, _HEAD] & ~seen[:, _TRUNK]
    if alone.any():  # raised arms would outvote a head, not a trunk
        along = (bones[:, _ARMS] * bones[:, _HEAD, None]).sum(axis=-1)
        hang = along > HANGING * lengths[:, _ARMS] * lengths[:, _HEAD, None]
        seen[:, _ARMS] &= hang | ~alone[:, None]
    down = np.where(seen[..., None], bones, 0.0).sum(axis=1)
    count, bones_m = seen.sum(axis=1), np.where(seen, lengths, 0.0).sum(axis=1)
    has_leg = np.any([seen[:, leg].all(axis=1) for leg in _LEGS], axis=0)
    return [
        Posture(
            down=down[n],
            bones=int(count[n]),
            bones_m=float(bones_m[n]),
            has_leg=bool(has_leg[n]),
            handed_m=float(handed[n]) if sides[n] else None,
            **heights.of(n),
        )
        for n in range(len(down))
    ]


class _Heights:
    """Heights and middles of n bodies."""

    def __init__(self, positions: Floats, observed: Bools) -> None:
        count, body = observed.sum(axis=1), np.arange(len(observed))
        clean = np.where(observed[..., None], positions, 0.0)
        self._middle = clean.sum(axis=1) / count[:, None]
        z = clean[..., 2]
        ordered = np.sort(np.where(observed, z, np.inf), axis=1)  # unseen ones last
        self._low = ordered[body, count // 20]
        self._high = ordered[body, 9 * (count - 1) // 10]
        self._lowest = ordered[body, np.minimum(count, 2) - 1]
        above = np.sort(np.where(observed, z - _HIGHEST, -np.inf), axis=1)  # unseen ones first
        self._above = above[body, -np.minimum(count, 2)]
        self._ankles = observed[:, _ANKLES].sum(axis=1)
        self._feet = z[:, _ANKLES].sum(axis=1) / np.maximum(self._ankles, 1)

    def of(self, n: int) -> dict[str, Any]:
        """Return the values of one body, as ``Posture`` names them."""
        return {
            "feet_m": float(self._feet[n]) if self._ankles[n] else None,
            "middle": self._middle[n],
            "heights": (float(self._low[n]), float(self._high[n])),
            "lowest_m": float(self._lowest[n]),
            "above_m": float(self._above[n]),
        }


def shows_down(observed: Bools) -> bool:
    """Return whether a body with these seen joints (J,) shows its down direction."""
    _, seen = _with_trunk(np.zeros((1, len(JOINTS), 3)), observed[None])
    return bool(_bones_seen(seen).any())


def _bones_seen(observed: Bools) -> Bools:
    """Return the bones to sum up (n, bones); none without a trunk or a head."""
    seen = observed[:, _UPPER] & observed[:, _LOWER]
    seen &= (seen[:, _TRUNK] | seen[:, _HEAD])[:, None]
    for leg in _LEGS:  # a thigh alone says that somebody sits, not where down is
        seen[:, leg] = seen[:, leg].all(axis=1, keepdims=True)
    return seen


def _with_trunk(positions: Floats, observed: Bools) -> tuple[Floats, Bools]:
    """Return bodies with the midpoint of shoulders or hips for an unseen neck or waist."""
    for name, *others in _INSTEAD:
        sides = [_AT[other] for other in others]
        lacks = observed[:, sides].all(axis=1) & ~observed[:, _AT[name]]
        if lacks.any():
            positions, observed = positions.copy(), observed.copy()
            positions[lacks, _AT[name]] = positions[lacks][:, sides].mean(axis=1)
            observed[lacks, _AT[name]] = True
    return positions, observed


def _handed(positions: Floats, observed: Bools, bones: Floats, seen: Bools) -> tuple[Floats, Bools]:
    """Return ``Posture.handed_m`` (n,), and where it is known (n,): knees and toes ahead, elbows
    behind; half the sum of both sides."""
    use: Bools = np.logical_and.reduce(observed[:, _JOINTS], axis=2)
    left, right, top, bottom, tip = np.moveaxis(positions[:, _JOINTS], 2, 0)
    if (use & _IS_ARM).any():
        trunk = np.where(seen[:, _TRUNK, None], bones[:, _TRUNK], bones[:, _HEAD])
        arms = bottom - top
        along = (arms * trunk[:, None]).sum(axis=-1)
        hangs = along > HANGING * norm(arms) * norm(trunk)[:, None]
        use &= ~_IS_ARM | (hangs & (seen[:, _TRUNK] | seen[:, _HEAD])[:, None])
    front = cross(left - right, top - bottom)
    ahead = ((tip - bottom) * front).sum(axis=-1) / np.maximum(norm(front), 1e-9)
    return np.where(use, _WEIGHTS * ahead, 0.0).sum(axis=1), np.asarray(use.any(axis=1))
