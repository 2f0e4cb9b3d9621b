"""Capture times of frames, from their times, numbers and a nominal rate.

Times in a file are rounded, and its rate may be stale. The nominal rate is used if it explains all
times; otherwise the times are used. A jump in both numbers and times is a gap.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from hri_predict.base.arrays import Floats
from hri_predict.base.errors import RecordingError
from hri_predict.recording.recording import check_gaps, check_rate

_ROUNDED = 0.1
"""Part of a period by which a rounded time may be off where the nominal rate explains it."""
_COARSE_S = 0.0055
"""Rounding error of a time with two decimals."""
_SAME = 0.01
"""Rates that differ by less are considered equal."""
_FAR_S = 1e9
"""Times are clipped to this value, which ``check_gaps`` rejects and which fits nanoseconds."""


@dataclass(frozen=True)
class FrameTimes:
    """Times of frames.

    Attributes:
        rate_hz: frames per second, where none is missing.
        stamps_ns: nanoseconds since the first frame.
        note: note for the user; "" if none.
    """

    rate_hz: float
    stamps_ns: list[int]
    note: str


def frame_times(path: Path, numbers: Floats, times_s: Floats, nominal_hz: float) -> FrameTimes:
    """Find the times of frames.

    Args:
        path: the file, for errors.
        numbers: (F,) the frames' own numbers; NaN for a frame without a number.
        times_s: (F,) the frames' own times; NaN for a frame without a time.
        nominal_hz: the rate that the file states.

    Raises:
        RecordingError: there are neither times nor a rate, or times go back.
    """
    steps = np.diff(numbers)
    counts = numbers - numbers[0]
    counted = bool(np.isfinite(counts).all() and (steps >= 1).all() and (counts % 1 == 0).all())
    if not counted:
        counts = np.arange(len(numbers), dtype=np.float64)
    notes = [] if counted else ["'Frame#' does not count upwards and is not used"]
    known = np.isfinite(times_s)
    if not known.all() or (len(times_s) > 1 and not np.ptp(times_s)):
        check_rate(path, "'DataRate'", nominal_hz)
        notes.append("rows without a 'Time': 'DataRate' is used")
        return _made(path, counts / nominal_hz, nominal_hz, notes)
    since_s = times_s - times_s[0]
    if len(times_s) == 1 or _explains(nominal_hz, counts, since_s):
        check_rate(path, "'DataRate'", nominal_hz)
        return _made(path, counts / nominal_hz, nominal_hz, notes)
    back = np.flatnonzero(np.diff(since_s) <= 0)
    if len(back):
        raise RecordingError(
            f"recording {path}: frame {back[0] + 2}: its 'Time' is not after that of the frame "
            f"before it; correct the times"
        )
    period_s = float(np.median(np.diff(since_s)))
    periods = np.maximum(1.0, np.round(np.diff(since_s) / period_s))
    rate_hz = float(f"{periods.sum() / since_s[-1]:.6g}")  # its times are rounded
    check_rate(path, "'Time'", rate_hz)
    if abs(nominal_hz / rate_hz - 1) > _SAME:
        notes.append(
            f"'DataRate' is {nominal_hz:g}, but by 'Time' it is {rate_hz:g} per second: 'Time' is "
            f"used"
        )
    elif counted and not np.array_equal(periods, steps):
        notes.append("'Frame#' and 'Time' differ: 'Time' is used")
    return _made(path, since_s, rate_hz, notes)


def _explains(nominal_hz: float, counts: Floats, since_s: Floats) -> bool:
    """Whether all times match evenly spaced frames, except for rounding."""
    if not nominal_hz > 0:
        return False
    off_s = np.abs(since_s - counts / nominal_hz)
    return bool((off_s <= max(_COARSE_S, _ROUNDED / nominal_hz)).all())


def _made(path: Path, since_s: Floats, rate_hz: float, notes: list[str]) -> FrameTimes:
    stamps = [round(min(s, _FAR_S) * 1e9) for s in since_s.tolist()]
    check_gaps(path, stamps)
    return FrameTimes(rate_hz, stamps, "; ".join([*notes, *gaps(stamps, rate_hz)]))


def gaps(stamps_ns: list[int], rate_hz: float) -> list[str]:
    """Return a note on missing frames, if any gap reaches two periods."""
    steps_s = np.diff(np.asarray(stamps_ns, np.float64)) * 1e-9
    missing = np.round(steps_s * rate_hz) - 1
    if not (missing > 0).any():
        return []
    worst = int(np.argmax(steps_s))
    return [
        f"{missing[missing > 0].sum():.0f} frames are missing; the longest gap is "
        f"{steps_s[worst]:.2f} s, after {stamps_ns[worst] * 1e-9:.2f} s"
    ]
