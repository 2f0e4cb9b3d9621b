"""Forecast origins and their windows, as the running node would have had them.

An origin is a capture: a window ends at a person's newest capture. Origins lie on a grid of 25 Hz
that starts with the recording, each at the capture nearest to its grid position. Each has 15 steps
of history and as much future as is evaluated. Origins are the same for every predictor: for one
with a longer history, steps before the recording's start are unobserved. (The oldest of the 15
steps of a recording's first origin may lie half a capture before its start; it is unobserved then.)

The history is the node's ring buffer's: captures up to the origin and no later, resampled at 25 Hz.
The truth is the recording itself, at capture + k/25 s, interpolated between adjacent captures.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from hri_predict.base.arrays import Bools, Floats
from hri_predict.base.errors import UnusableRecordingError
from hri_predict.contracts.joint_map import JointMap
from hri_predict.lab.datasets.tracks import Track, nearest, tracks_of
from hri_predict.lab.evaluation.table import HORIZONS_MS
from hri_predict.people.ring_buffer import resample
from hri_predict.predictors.neural.body import BODY
from hri_predict.recording.opening import opened
from hri_predict.recording.recording import Recording

RATE_HZ = 25.0
ORIGIN_STEPS = 15
"""Steps of history before every origin, however many a predictor reads."""
HORIZON_STEPS = tuple(round(ms * RATE_HZ / 1000) for ms in HORIZONS_MS)
FUTURE_STEPS = 25
"""Default number of evaluated steps: one second."""
BATCH = 256

LEAST_RATE_HZ = 1000.0 / HORIZONS_MS[0]
"""Slower recordings have no capture within the shortest horizon: its truth would be a guess."""

_STEP_NS = round(1e9 / RATE_HZ)
_LEAST_ORIGINS = 5  # fewer say nothing about a recording

Motion = Track
"""One person's unbroken presence: a track whose every capture observed some joint."""


@dataclass(frozen=True, slots=True, eq=False)
class Batch:
    """Windows of one motion.

    Attributes:
        motion: the motion that the windows are cut from.
        index: number of this batch within its motion.
        history: (N, T, 28, 3) metres, finite; anything where not observed.
        observed: (N, T, 28).
        future: (N, H, 28, 3) metres, the true motion that followed.
        known: (N, H, 28) where the future is known.
    """

    motion: Motion
    index: int
    history: Floats
    observed: Bools
    future: Floats
    known: Bools


def read_motions(
    recordings: Sequence[Path | Recording], joint_map: JointMap | None = None
) -> list[Motion]:
    """Read recordings as motions; one per person and unbroken presence.

    Frames without any observed joint are skipped (the CMU recordings mark some by ``world_ok``).
    Where they leave a gap that the node does not bridge, a new motion starts, as a new track does.

    Args:
        recordings: files, or recordings in memory.
        joint_map: the user's own for the files' joints; default: found by their names.

    Raises:
        RecordingError: a file cannot be read.
        UnusableRecordingError: its joints are not known, or it has fewer captures a second than
            ``LEAST_RATE_HZ``.
    """
    motions: list[Motion] = []
    for entry in recordings:
        recording = opened(entry, joint_map)
        if recording.rate_hz < LEAST_RATE_HZ:
            raise UnusableRecordingError(
                f"recording {recording.path}: {recording.rate_hz:.3g} frames per second say "
                f"nothing about {HORIZONS_MS[0]} ms ahead; record at "
                f"{LEAST_RATE_HZ:.2g} or more"
            )
        for track in tracks_of(recording):
            motions.extend(_motions(track))
    return motions


def _motions(track: Track) -> list[Motion]:
    seen = np.flatnonzero(track.observed.any(axis=1))
    breaks = np.flatnonzero(np.diff(track.stamps_ns[seen]) > track.max_gap_ns) + 1
    return [track.only(frames) for frames in np.split(seen, breaks) if frames.size]


def origins(motion: Motion, future_steps: int = FUTURE_STEPS) -> tuple[NDArray[np.int64], int]:
    """(N,) forecast origins, capture times in nanoseconds, and the number of steps evaluated.

    The longest horizon within ``future_steps`` follows each origin. A motion too short for five
    such origins is evaluated to the longest horizon that leaves five (``running``: 600 ms), or not
    at all.
    """
    stamps = motion.stamps_ns
    length = int(stamps[-1] - stamps[0])
    grid = stamps[0] + _STEP_NS * np.arange(ORIGIN_STEPS - 1, length // _STEP_NS + 1)
    captures = np.unique(stamps[nearest(stamps, grid)])
    earliest = stamps[0] + (ORIGIN_STEPS - 1) * _STEP_NS - motion.period_ns // 2
    captures = captures[captures >= earliest]
    for steps in reversed([s for s in HORIZON_STEPS if s <= future_steps]):
        possible: NDArray[np.int64] = captures[captures + steps * _STEP_NS <= stamps[-1]]
        if possible.size >= _LEAST_ORIGINS:
            return possible, steps
    return captures[:0], 0


def batches(
    motion: Motion, history_steps: int, future_steps: int = FUTURE_STEPS
) -> Iterator[Batch]:
    """Yield all windows of a motion, at most ``BATCH`` at a time, in order.

    Args:
        motion: see ``read_motions``.
        history_steps: T; the newest steps do not depend on it.
        future_steps: H; the set of windows depends on it.
    """
    times, reach = origins(motion, future_steps)
    for index, start in enumerate(range(0, len(times), BATCH)):
        part = times[start : start + BATCH]
        windows = [_window(motion, int(t), history_steps, future_steps) for t in part]
        batch = Batch(motion, index, *(np.stack(each) for each in zip(*windows, strict=True)))
        batch.known[:, reach:] = False  # all horizons are evaluated on the same windows
        yield batch


def _window(
    motion: Motion, origin_ns: int, steps: int, future_steps: int
) -> tuple[Floats, Bools, Floats, Bools]:
    """History and truth of one origin."""
    stamps = motion.stamps_ns
    now = int(stamps.searchsorted(origin_ns, side="right"))
    oldest = origin_ns - steps * _STEP_NS - motion.max_gap_ns
    held = slice(int(stamps.searchsorted(oldest)), now)
    past = resample(
        stamps=stamps[held],
        positions=motion.positions[held],
        observed=motion.observed[held],
        t_end_ns=origin_ns,
        n=steps,
        rate_hz=RATE_HZ,
        max_gap_ns=motion.max_gap_ns,
    )
    end_ns = origin_ns + future_steps * _STEP_NS
    # a capture beyond the end is needed to interpolate up to it: this is the truth, not the input
    ahead = slice(now - 1, int(stamps.searchsorted(end_ns)) + 1)
    times = origin_ns + _STEP_NS * np.arange(1, future_steps + 1)
    return past.positions, past.observed, *_interpolated(motion.only(ahead), times)


def _interpolated(motion: Motion, times: NDArray[np.int64]) -> tuple[Floats, Bools]:
    """(H, J, 3) at ``times``; known (H, J) where the captures on both sides have the joint."""
    stamps, last = motion.stamps_ns, len(motion.stamps_ns) - 1
    before = np.clip(stamps.searchsorted(times, side="right") - 1, 0, last)
    after = np.clip(stamps.searchsorted(times), 0, last)
    gap = stamps[after] - stamps[before]
    adjacent_ns = motion.period_ns * 3 // 2  # adjacent captures, however they jitter
    inside = (times <= stamps[last]) & (gap <= adjacent_ns)
    weight = (times - stamps[before]) / np.maximum(gap, 1)
    start = motion.positions[before]
    result = start + weight[:, None, None] * (motion.positions[after] - start)
    known = motion.observed[before] & motion.observed[after] & inside[:, None]
    return np.where(known[..., None], result, 0.0), known


def scored_joints() -> tuple[int, ...]:
    """Joints whose errors count: the pelvis and the benchmark's 25, not the hips."""
    return tuple(i for i, name in enumerate(BODY.joints) if name not in ("l_hip", "r_hip"))
