"""Detects coordinates relative to the hips: such bodies walk in place.

Some trackers (MediaPipe's world landmarks) put the origin between the hips of each body. Then the
middle of the hips stays at the origin, or at one place if a pose lifts it to a true height, while
the legs walk.
"""

import numpy as np

from hri_predict.base.arrays import Bools, Floats
from hri_predict.base.skeleton import JOINTS

HERE_M = 0.03
"""Minimum distance of real hips from the origin, where a sensor, the floor or a table is."""
STILL_M = 0.015
"""Maximum horizontal standard deviation of hips that do not move, including a tracker's noise."""
EXACT_M = 2e-4
"""Maximum horizontal standard deviation of hips that are the origin, which may be moved but never
sway."""
SWING_M = 0.08
"""Minimum horizontal standard deviation of a walking foot: a step has 0.2 m."""
OPPOSED = -0.5
"""Maximum correlation between the two feet of a person who walks."""
_HIPS = [JOINTS.index(name) for name in ("l_hip", "r_hip")]
_WAIST = JOINTS.index("waist")
_LEGS = [
    [JOINTS.index(f"{side}_{name}") for side in ("l", "r")] for name in ("ankle", "foot", "knee")
]


def hips_are_origin(positions: Floats, observed: Bools, origin: Floats) -> bool:
    """Return whether the hips of a body are the origin of its coordinates.

    This holds if the hips stay at the source's origin, or if the legs walk while the hips stay
    above or below the origin, or do not move at all.

    Args:
        positions: (n, J, 3) metres, captures of one body over two seconds or so, in the room.
        observed: (n, J).
        origin: (3,) origin of the source.
    """
    if not len(positions):
        return False
    always = np.asarray(observed.all(axis=0))
    middles = []
    if always[_WAIST]:
        middles.append(positions[:, _WAIST])
    if always[_HIPS].all():
        middles.append(positions[:, _HIPS].mean(axis=1))
    return any(_is_origin(hips, positions, always, origin) for hips in middles)


def _is_origin(hips: Floats, positions: Floats, always: Bools, origin: Floats) -> bool:
    sway = np.sqrt(hips.var(axis=0))
    beside = np.abs(hips.mean(axis=0) - origin)
    if float(np.linalg.norm(beside)) < HERE_M and float(np.linalg.norm(sway)) < 2 * STILL_M:
        return True
    sway_m = float(np.linalg.norm(sway[:2]))
    above = float(np.linalg.norm(beside[:2])) < HERE_M and sway_m < STILL_M
    return (above or sway_m < EXACT_M) and _walk(positions - hips[:, None], always)


def _walk(positions: Floats, always: Bools) -> bool:
    """Return whether both feet swing in opposition, as in walking; (n, J, 3) about the hips."""
    pair = next((pair for pair in _LEGS if always[pair].all()), None)
    if pair is None:
        return False
    feet = positions[:, pair, :2]
    left, right = np.moveaxis(feet - feet.mean(axis=0), 1, 0)
    swings = [float(np.sqrt((foot**2).sum(-1).mean())) for foot in (left, right)]
    opposed = float((left * right).sum(-1).mean()) < OPPOSED * swings[0] * swings[1]
    return opposed and min(swings) > SWING_M
