"""Ranges of motion covered by the calibration: outside these ranges, radii are not valid.

Trackers place joints differently, and bodies differ, so bone lengths do not show whether a forecast
can be trusted: there is no range for them here.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from hri_predict.base.arrays import Bools, Floats
from hri_predict.base.geometry import norm
from hri_predict.zones.human_speed import Velocities, joint_speeds

SHORT_S = 0.12
"""Time ahead within which a forecast is hardly ever wrong, unless the scene itself jumped."""

MAX_SPEED_M_S = 20.0
"""Highest upper end of a joint's range; twice the fastest joint of the shipped calibrations. A
higher one would let every motion count as known."""
MAX_RATIO_SHORT = 10.0
"""Highest ``ratio_short``; that of the shipped calibrations is about 2."""


def bounded(speed_m_s: Mapping[str, float], ratio_short: float) -> dict[str, Any]:
    """Return the ranges to store, within the limits above: a narrower range is on the safe side."""
    speed = {name: min(each, MAX_SPEED_M_S) for name, each in speed_m_s.items()}
    return {"speed_m_s": speed, "ratio_short": min(max(ratio_short, 1e-3), MAX_RATIO_SHORT)}


@dataclass(frozen=True, slots=True, eq=False)
class MotionRanges:
    """The ranges of a calibration. J joints of the canonical skeleton.

    Attributes:
        speed_m_s: (J,) highest speed of each joint; infinite or NaN if unknown: never exceeded.
        ratio_short: the largest ``short_ratio`` of any window.
    """

    speed_m_s: Floats
    ratio_short: float


def short_ratio(ratio: Floats, judged: Bools) -> Floats:
    """Return (N,) median over the judged joints of error / calibrated radius; NaN without any.

    The upper median is used, so that one good joint of two does not hide a bad one. Above 1, most
    joints are outside at the same time. Use it for forecasts not older than ``SHORT_S``.

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
    history: Floats, observed: Bools, rate_hz: float, *, ratio_short: float
) -> MotionRanges:
    """Return the ranges of P windows; see ``MotionRanges``.

    NaN for joints that were never measured.

    Args:
        history: (P, T, J, 3) metres, as in ``PeopleSnapshot``.
        observed: (P, T, J).
        rate_hz: steps per second of the history.
        ratio_short: see ``MotionRanges``.
    """
    speed, measured = joint_speeds(history, observed, rate_hz)
    fastest = np.where(measured, speed, -np.inf).max(0, initial=-np.inf)
    return MotionRanges(
        speed_m_s=np.where(measured.any(0), fastest, np.nan), ratio_short=ratio_short
    )


def is_out_of_range(velocities: Velocities, ranges: MotionRanges, *, speed_margin: float) -> Bools:
    """Return (P,) whether a joint is faster than ``speed_margin`` times its calibrated maximum.

    Args:
        velocities: velocities of the joints of P people.
        ranges, speed_margin: see above.
    """
    velocity, measured = velocities
    return np.asarray((measured & (norm(velocity) > speed_margin * ranges.speed_m_s)).any(1))
