"""Finds the axes of a source with which its bodies stand: a wrong choice is one of 24 rotations.

Gravity shows which axis is up. Bodies do not show the room's heading, so among the axes with which
all bodies stand, those with which people look ahead are returned.
"""

import itertools
from collections.abc import Iterator, Sequence

import numpy as np

from hri_predict.base.arrays import Bools, Floats
from hri_predict.base.geometry import norm
from hri_predict.base.skeleton import JOINTS
from hri_predict.contracts.joint_map import axes_rotation
from hri_predict.people.body.posture import posture_of

COMMON = (["x", "y", "z"], ["z", "-x", "-y"], ["z", "x", "y"], ["-z", "-x", "y"])
"""Axes used by trackers (REP-103, a camera's optical frame, y up), which are tried first."""
ALIKE = 0.02
"""Axes whose upright cosine is this close to the best are considered equally good."""
STANDING = 0.5
"""Minimum cosine between gravity and the sum of all bodies' down, for people who stand or sit."""
_PAIRS = [(JOINTS.index(f"l_{part}"), JOINTS.index(f"r_{part}")) for part in ("hip", "shoulder")]


def all_axes(hands: float) -> Iterator[tuple[list[str], Floats]]:
    """Return all 24 axes of one handedness that point forward, left and up; common ones first.

    Args:
        hands: 1 for right-handed sources, -1 for left-handed ones.

    Returns:
        the axes, and their (3, 3) rotation with determinant ``hands``.
    """
    letters = [list(order) for order in itertools.permutations("xyz")]
    signs = itertools.product(("", "-"), repeat=3)
    every = [
        [s + a for s, a in zip(sign, order, strict=True)] for sign in signs for order in letters
    ]
    for axes in sorted(every, key=lambda a: COMMON.index(a) if a in COMMON else len(COMMON)):
        try:
            yield axes, axes_rotation(axes, left_handed=hands < 0)
        except ValueError:  # of the other handedness
            continue


def standing_axes(
    bodies: Sequence[tuple[Floats, Bools]], rotation: Floats, hands: float
) -> list[str] | None:
    """Return the axes with which bodies would stand; ``None`` if there are none.

    Args:
        bodies: (J, 3), (J,) canonical joints, according to the current axes.
        rotation: (3, 3) current rotation from the source's axes to forward, left and up.
        hands: -1 if left and right of the bodies are swapped now, otherwise 1.
    """
    down = np.sum([posture_of(*body).down for body in bodies], axis=0)
    length = float(np.linalg.norm(down))
    across = _across(bodies)
    found: list[tuple[float, float, list[str]]] = []
    for axes, turn in all_axes(hands * round(float(np.linalg.det(rotation)))):
        correction = turn @ rotation.T
        upright = -float((correction @ down)[2]) / length if length else 0.0
        if upright > STANDING:
            left = (across @ correction.T)[:, 1]
            found.append((upright, float(left.mean()) if len(left) else 0.0, axes))
    if not found:
        return None
    best = max(upright for upright, _, _ in found)
    alike = [each for each in found if each[0] > best - ALIKE]
    return max(alike, key=lambda each: each[1])[2]


def _across(bodies: Sequence[tuple[Floats, Bools]]) -> Floats:
    """Return (n, 3) directions from right to left hip, or shoulder if hips are not seen."""
    found = []
    for positions, observed in bodies:
        for left, right in _PAIRS:
            if observed[left] and observed[right]:
                found.append(positions[left] - positions[right])
                break
    across: Floats = np.array(found).reshape(-1, 3)
    return across / np.maximum(norm(across), 1e-9)[:, np.newaxis]
