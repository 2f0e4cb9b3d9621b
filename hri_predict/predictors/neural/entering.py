"""From the room into the networks' window and back, as the node needs it in each tick.

``body_frame`` does the same for training batches, in sixty small operations that take more than a
millisecond when caches are cold. Here it is one compiled loop over a few people. Without numba,
torch's operations are used (``entering_arrays``).
"""

import math

import numpy as np

from hri_predict.base.arrays import Bools, Floats
from hri_predict.base.machine.compiled import kernel, part
from hri_predict.base.skeleton import CANONICAL, Skeleton
from hri_predict.predictors.neural.body import (
    BODY,
    EXTRAPOLATED_STEPS,
    LEVEL_M,
    SHARED_BODY,
    SHARED_CANONICAL,
)
from hri_predict.predictors.neural.windows import Entered, Histories, Indices, Singles, Tables

# Canonical joints that the body lacks, and the body's joints that they move with.
_CARRIED = {
    "waist": ("l_hip", "r_hip"),
    "neck": ("l_shoulder", "r_shoulder"),
    "head_top": ("head",),
}
_PELVIS, _L_HIP, _R_HIP, _L_SHOULDER, _R_SHOULDER = (
    BODY.joints.index(name) for name in ("pelvis", "l_hip", "r_hip", "l_shoulder", "r_shoulder")
)


def tables(skeleton: Skeleton, rest: Floats, nearest: Indices) -> Tables:
    """The tables for ``CANONICAL``, or for ``BODY`` itself."""
    own = np.arange(len(BODY.joints))
    if skeleton is BODY:
        return Tables(own, np.stack([own, own], 1), np.zeros(len(own), dtype=bool), rest, nearest)
    given = np.full(len(own), -1)
    given[list(SHARED_BODY)] = SHARED_CANONICAL
    taken = np.zeros((len(CANONICAL.joints), 2), dtype=np.int64)
    taken[list(SHARED_CANONICAL)] = np.array(SHARED_BODY)[:, np.newaxis]
    carried = np.zeros(len(taken), dtype=bool)
    for name, carriers in _CARRIED.items():
        joint = CANONICAL.joints.index(name)
        taken[joint] = BODY.joints.index(carriers[0]), BODY.joints.index(carriers[-1])
        carried[joint] = True
    return Tables(given, taken, carried, rest, nearest)


@part
def _set_frame(
    positions: Floats, newest: Indices, hips_and_shoulders: tuple[int, int], frame: Floats
) -> None:
    """Set a person's frame (5,): its origin, then its y axis, as ``body_frame`` does.

    Args:
        positions: (T, 28, 3) m, room; any value where not observed.
        newest: (28,) the step of each joint's last observation, or -1.
        hips_and_shoulders: for each pair, the newest step in which both were observed, or -1.
        frame: filled.
    """
    hips, shoulders = hips_and_shoulders
    frame[3], frame[4] = 0.0, 1.0
    step, left, right = hips, _L_HIP, _R_HIP
    if hips < 0:
        step, left, right = shoulders, _L_SHOULDER, _R_SHOULDER
    if step >= 0:
        x = positions[step, left, 0] - positions[step, right, 0]
        y = positions[step, left, 1] - positions[step, right, 1]
        length = math.sqrt(x * x + y * y)
        if length > LEVEL_M:
            frame[3], frame[4] = x / length, y / length
    for c in range(3):
        if hips >= 0:
            frame[c] = (positions[hips, _L_HIP, c] + positions[hips, _R_HIP, c]) / 2
            continue
        total, count = 0.0, 0
        for j in range(len(newest)):
            if newest[j] >= 0:
                total += positions[newest[j], j, c]
                count += 1
        frame[c] = total / max(count, 1)
        if newest[_PELVIS] >= 0:
            frame[c] = positions[newest[_PELVIS], _PELVIS, c]


@part
def _fill_track(track: Floats, seen: Bools) -> None:
    """Fill one joint's track (T, 3), observed at least once, as ``body_frame.fill`` does."""
    steps = len(seen)
    before, previous = -1, -1
    for t in range(steps):
        if seen[t]:
            previous, before = before, t
            continue
        after = t + 1
        while after < steps and not seen[after]:
            after += 1
        a, b, run = before, before, 0
        if before < 0:
            a, b = after, after
        elif after < steps:
            b, run = after, t - before
        elif previous >= 0:
            b, run = previous, min(t - before, EXTRAPOLATED_STEPS)
        weight = run / (b - a) if b != a else 0.0
        for c in range(3):
            track[t, c] = track[a, c] + weight * (track[b, c] - track[a, c])


@part
def _nearest_seen(newest: Indices, nearest: Indices) -> int:
    """The first of ``nearest`` that was ever observed, or -1."""
    for joint in nearest:
        if newest[joint] >= 0:
            return int(joint)
    return -1


def _enter_loops(histories: Histories, tables: Tables) -> Entered:
    people, steps = histories.observed.shape[:2]
    count = len(tables.given)
    window = np.empty((people, steps, count, 3), np.float32)
    observed = np.zeros((people, steps, count), np.bool_)
    frames = np.empty((people, 5))
    body, newest = np.zeros((steps, count, 3)), np.empty(count, np.int64)
    for p in range(people):
        seen = observed[p]
        newest[:] = -1
        for j in range(count):
            given = tables.given[j]
            if given < 0:
                continue
            for t in range(steps):
                if histories.observed[p, t, given]:
                    seen[t, j] = True
                    newest[j] = t
                    for c in range(3):
                        body[t, j, c] = histories.positions[p, t, given, c]
        hips, shoulders = -1, -1
        for t in range(steps):
            hips = t if seen[t, _L_HIP] and seen[t, _R_HIP] else hips
            shoulders = t if seen[t, _L_SHOULDER] and seen[t, _R_SHOULDER] else shoulders
        frame = frames[p]
        _set_frame(body, newest, (hips, shoulders), frame)
        for j in range(count):
            if newest[j] < 0:
                continue
            for t in range(steps):
                x, y = body[t, j, 0] - frame[0], body[t, j, 1] - frame[1]
                body[t, j, 0] = frame[4] * x - frame[3] * y
                body[t, j, 1] = frame[3] * x + frame[4] * y
                body[t, j, 2] -= frame[2]
            _fill_track(body[:, j], seen[:, j])
        for j in range(count):
            source = _nearest_seen(newest, tables.nearest[j])
            for t in range(steps):
                for c in range(3):
                    place = tables.rest[j, c]
                    if source == j:
                        place = body[t, j, c]
                    elif source >= 0:
                        place = body[t, source, c] + (place - tables.rest[source, c])
                    window[p, t, j, c] = place
    return Entered(window, observed, frames)


@part
def _middle(body: Singles, pair: Indices, frame: Floats, place: Floats) -> None:
    """Set ``place`` (3,), along the room's axes, to the middle of two joints of a body (28, 3)."""
    x = (np.float64(body[pair[0], 0]) + np.float64(body[pair[1], 0])) / 2
    y = (np.float64(body[pair[0], 1]) + np.float64(body[pair[1], 1])) / 2
    place[0] = frame[4] * x + frame[3] * y
    place[1] = frame[4] * y - frame[3] * x
    place[2] = (np.float64(body[pair[0], 2]) + np.float64(body[pair[1], 2])) / 2


def _leave_loops(
    forecast: Singles, entered: Entered, histories: Histories, tables: Tables
) -> Floats:
    people, ahead = forecast.shape[:2]
    result = np.empty((people, ahead, len(tables.taken), 3))
    base, place = np.empty(3), np.empty(3)
    for p in range(people):
        frame = entered.frames[p]
        for j in range(len(tables.taken)):
            pair, newest = tables.taken[j], -1
            if tables.carried[j]:
                newest = histories.observed.shape[1] - 1
                while newest >= 0 and not histories.observed[p, newest, j]:
                    newest -= 1
            if newest >= 0:
                _middle(entered.window[p, newest], pair, frame, place)
            for c in range(3):
                base[c] = frame[c]
                if newest >= 0:
                    base[c] = histories.positions[p, newest, j, c] - place[c]
            for t in range(ahead):
                _middle(forecast[p, t], pair, frame, place)
                for c in range(3):
                    result[p, t, j, c] = place[c] + base[c]
    return result


def _enter_arrays(histories: Histories, tables: Tables) -> Entered:
    """Bring histories into the people's own frames, and fill what was not observed."""
    from hri_predict.predictors.neural.entering_arrays import enter_arrays  # with torch

    return enter_arrays(histories, tables)


def _leave_arrays(
    forecast: Singles, entered: Entered, histories: Histories, tables: Tables
) -> Floats:
    """Bring forecasts (P, H, 28, 3) in the people's frames into the room: (P, H, K, 3), m."""
    from hri_predict.predictors.neural.entering_arrays import leave_arrays  # with torch

    return leave_arrays(forecast, entered, histories, tables)


enter = kernel(_enter_loops, _enter_arrays)
leave = kernel(_leave_loops, _leave_arrays)
