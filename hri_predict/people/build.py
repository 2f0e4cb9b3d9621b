"""Compares the bone lengths of a body with those of a person seen before.

Matching motion does not prove that two bodies are one person: another person may have stood close
by. Bones do not prove a person's identity either, because many people are equally tall. But a body
with clearly longer or shorter limbs belongs to another person.
"""

import numpy as np

from hri_predict.base.arrays import Bools, Floats
from hri_predict.base.geometry import norm
from hri_predict.base.skeleton import CANONICAL

_LIMBS = ("upper_arm", "forearm", "thigh", "shank")
_ENDS = np.array(
    [(s.joint_a, s.joint_b) for s in CANONICAL.segments if s.name[2:] in _LIMBS], np.int64
)
SAMPLES = 20
"""Number of newest captures from which a person's bone lengths are measured."""
LEAST_SAMPLES = 5
"""Minimum number of captures from which a length and its noise are known."""
LEAST_BONES = 3
APART_M = 0.025
"""Mean change of tracked bone lengths with posture; those of people of 1.65 and 1.85 m differ by
4.1 cm."""
NOISES = 4.0
"""Number of standard deviations of that mean, from each bone's own noise, that count as noise."""


def is_same_build(positions: Floats, observed: Bools, joints: Floats, seen: Bools) -> bool:
    """Return whether a body may be the person of earlier captures, judged by the limbs seen in
    both.

    Args:
        positions, observed: (N, J, 3) metres and (N, J) of the earlier captures, the newest last.
        joints, seen: (J, 3) and (J,) of the body.

    Returns:
        false if at least three bones are clearly longer or shorter on average.
    """
    positions, observed = positions[-SAMPLES:], observed[-SAMPLES:]
    a, b = _ENDS.T
    whole = observed[:, a] & observed[:, b]
    known = (whole.sum(axis=0) >= LEAST_SAMPLES) & seen[a] & seen[b]
    if np.count_nonzero(known) < LEAST_BONES:
        return True
    a, b, whole = a[known], b[known], whole[:, known]
    lengths = np.where(whole, norm(positions[:, a] - positions[:, b]), 0.0)
    count = whole.sum(axis=0)
    mean = lengths.sum(axis=0) / count
    spread = np.sqrt((np.where(whole, lengths - mean, 0.0) ** 2).sum(axis=0) / (count - 1))
    longer_m = float((norm(joints[a] - joints[b]) - mean).mean())
    noise_m = float(np.sqrt((spread**2).sum())) / len(a)
    return abs(longer_m) <= APART_M + NOISES * noise_m
