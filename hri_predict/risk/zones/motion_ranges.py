"""Which bodies and motions the calibration contains: outside these ranges, radii mean nothing."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from hri_predict.arrays import Bools, Floats
from hri_predict.geometry import norm
from hri_predict.risk.zones.human_speed import Velocities, joint_speeds

BONE_S = 0.4
"""Bones are measured over this time before the newest capture: noise averages out."""
SHORT_S = 0.12
"""A forecast up to this far ahead can hardly be wrong, unless the scene itself jumped."""


@dataclass(frozen=True, slots=True, eq=False)
class MotionRanges:
    """The ranges in the calibration. J joints of the canonical skeleton.

    Attributes:
        speed_m_s: (J,) highest speed of each joint; infinite or NaN if unknown: never exceeded.
        bone_m: (J, 2) shortest and longest distance to the joint's parent; (0, infinity) or NaN if
            unknown.
        ratio_short: the largest ``short_ratio`` of any window.
    """

    speed_m_s: Floats
    bone_m: Floats
    ratio_short: float


def bone_lengths(
    history: Floats, observed: Bools, rate_hz: float, parents: Sequence[int]
) -> Floats:
    """(P, J) mean distance of each joint to its parent over the last ``BONE_S``, metres.

    NaN for roots, and if joint and parent were never observed together.

    Args:
        history: (P, T, J, 3) metres, as in ``PeopleSnapshot``.
        observed: (P, T, J).
        rate_hz: steps per second of the history.
        parents: the parent of each joint; -1 for a root.
    """
    steps = max(1, round(BONE_S * rate_hz))
    points, seen = history[:, -steps:], observed[:, -steps:]
    above = np.asarray(parents)
    vectors = points - points.take(above, axis=2)  # a root's is thrown away
    length = np.sqrt(np.einsum("ptji,ptji->ptj", vectors, vectors))
    both = seen & seen.take(above, axis=2) & (above >= 0)
    count = both.sum(1)
    mean = np.where(both, length, 0.0).sum(1) / np.maximum(count, 1)
    return np.where(count > 0, mean, np.nan)


def short_ratio(ratio: Floats, judged: Bools) -> Floats:
    """(N,) median over the judged joints of error / calibrated radius; NaN without any.

    It is the upper median: of two joints, one that is right does not make both right. Above 1, most
    joints are outside at once. Use it for forecasts not older than ``SHORT_S``.

    Args:
        ratio: (N, J).
        judged: (N, J) observed when the forecast was made and now, with a finite radius.
    """
    count = judged.sum(-1)
    if not len(ratio):
        return np.zeros(0)
    ordered = np.sort(np.where(judged, ratio, np.inf), axis=-1)
    middle = np.minimum(count // 2, ratio.shape[-1] - 1)
    return np.where(count > 0, ordered[np.arange(len(ratio)), middle], np.nan)


def motion_ranges(
    history: Floats,
    observed: Bools,
    rate_hz: float,
    parents: Sequence[int],
    *,
    ratio_short: float,
) -> MotionRanges:
    """The ranges of P windows; see ``MotionRanges``, and ``bone_lengths`` for the arguments.

    NaN for joints that were never measured.
    """
    speed, measured = joint_speeds(history, observed, rate_hz)
    fastest = np.where(measured, speed, -np.inf).max(0, initial=-np.inf)
    bones = bone_lengths(history, observed, rate_hz, parents)
    known = np.isfinite(bones)
    shortest = np.where(known, bones, np.inf).min(0, initial=np.inf)
    longest = np.where(known, bones, -np.inf).max(0, initial=-np.inf)
    never = np.logical_not(known.any(0))
    return MotionRanges(
        speed_m_s=np.where(measured.any(0), fastest, np.nan),
        bone_m=np.where(never[..., None], np.nan, np.stack([shortest, longest], axis=-1)),
        ratio_short=ratio_short,
    )


def is_out_of_range(
    velocities: Velocities,
    bones: Floats,
    ranges: MotionRanges,
    *,
    speed_margin: float,
    bone_tolerance: float,
) -> Bools:
    """(P,) whether a person's motion or body is outside ``ranges``.

    Either a joint is faster than ``speed_margin`` times the fastest, or more than half of the
    measured bones are shorter or longer than all calibrated ones by more than ``bone_tolerance``.

    Args:
        velocities: of the joints of P people.
        bones: (P, J) the people's ``bone_lengths``.
        ranges, speed_margin, bone_tolerance: see above.
    """
    velocity, measured = velocities
    fast = (measured & (norm(velocity) > speed_margin * ranges.speed_m_s)).any(1)
    shortest, longest = ranges.bone_m.T
    known = np.isfinite(bones) & np.isfinite(shortest)
    # a bone without length (two joints at one place) is within tolerance of itself alone
    wrong = (bones < (1 - bone_tolerance) * shortest) | (bones > (1 + bone_tolerance) * longest)
    return np.asarray(fast | (2 * (wrong & known).sum(1) > known.sum(1)))
