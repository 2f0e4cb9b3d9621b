"""Positions of a robot that continues on its path and stops, with loops and with arrays.

Both versions give the same results except for rounding, because the order of operations differs. L
speeds, K times, N joints.
"""

from math import ceil

import numpy as np

from hri_predict.base.arrays import Floats, Ints
from hri_predict.base.machine.compiled import kernel, part
from hri_predict.robots.stopping import STANDING_M_S, StoppingTable

Tables = tuple[Floats, Floats, Floats, Floats, Floats, float]
"""(T,) speeds, times and distances of a stopping table (m/s, s, m); (B,) speeds and times of the
moving base's table, empty without one; and the stretch factor of all."""
Speeds = tuple[Floats, Floats, float]
"""(G,) phases of one cycle of a path, including both ends, s; (G,) speed of the fastest point at
these phases at full speed, m/s; and the step between phases."""
Moves = tuple[Floats, Floats, Floats]
"""(W,) times and (W, N) positions of a trajectory's waypoints; (W-1, N) maximum acceleration of
each move."""


# -- phases of a plan ------------------------------------------------------------------------------


def _phases_by_arrays(
    path: Speeds, tables: Tables, start: tuple[float, float, float], asked: tuple[Floats, Floats]
) -> tuple[Floats, Floats]:
    """Return (L, K) phases of a robot that follows its path, and (L,) the times when it stops.

    Args:
        path: path of the robot.
        tables: its stopping tables.
        start: phase at time 0, seconds from then until it brakes, and its highest rate.
        asked: (L,) speeds of its fastest point; (K,) times from 0, non-decreasing.
    """
    (start_s, reaction_s, most), (speeds_m_s, times_s) = start, asked
    closed, fastest, step_s = path

    def speed_at(phases_s: Floats) -> Floats:
        result: Floats = np.interp(phases_s % closed[-1], closed, fastest)
        return result

    def rates(speeds: Floats, phases_s: Floats) -> Floats:
        return np.minimum(most, speeds / np.maximum(speed_at(phases_s), 1e-9))

    cells = ceil(most * reaction_s / step_s) + 1
    at: Floats = start_s + np.arange(cells + 1, dtype=np.float64) * step_s
    rate = rates(speeds_m_s[:, None], at[:-1] + step_s / 2)
    passed = np.zeros((len(speeds_m_s), cells + 1))
    np.cumsum(step_s / np.maximum(rate, 1e-9), axis=1, out=passed[:, 1:])
    follows = np.append(np.minimum(times_s, reaction_s), reaction_s)
    followed = np.array([np.interp(follows, when, at) for when in passed])
    phases, brakes = followed[:, :-1], followed[:, -1]
    rate = rates(speeds_m_s, brakes)
    speed = rate * speed_at(brakes)
    table = StoppingTable(*tables[:3])
    table.stretch = tables[5]
    stopping_s = table.times_s(speed)
    if len(tables[3]):
        base = StoppingTable(tables[3], tables[4], np.zeros(len(tables[3])))
        base.stretch = tables[5]
        stopping_s = np.maximum(stopping_s, base.times_s(speed))
    after = np.maximum(times_s - reaction_s, 0.0)
    travel = table.travel_s(speed[:, None], after, 0.0, stopping_s[:, None])
    return phases + rate[:, None] * travel, reaction_s + stopping_s


def _phases_by_loops(
    path: Speeds, tables: Tables, start: tuple[float, float, float], asked: tuple[Floats, Floats]
) -> tuple[Floats, Floats]:
    start_s, reaction_s, most = start
    speeds_m_s, times_s = asked
    closed, fastest, step_s = path
    cells = ceil(most * reaction_s / step_s) + 1
    phases, stands_s = np.empty((len(speeds_m_s), len(times_s))), np.empty(len(speeds_m_s))
    middles, passed = np.empty(cells), np.zeros(cells + 1)
    for i in range(cells):
        middle = start_s + i * step_s + step_s / 2
        middles[i] = max(_between(middle % closed[-1], closed, fastest), 1e-9)
    for m in range(len(speeds_m_s)):
        for i in range(cells):
            rate = min(most, speeds_m_s[m] / middles[i])
            passed[i + 1] = passed[i] + step_s / max(rate, 1e-9)
        brakes = _followed(passed, reaction_s, start_s, step_s)
        full_m_s = _between(brakes % closed[-1], closed, fastest)
        rate = min(most, speeds_m_s[m] / max(full_m_s, 1e-9))
        speed = rate * full_m_s
        stopping_s = _stopping_s(speed, tables[0], tables[1], tables[5])
        if len(tables[3]):
            of_base_s = _stopping_s(speed, tables[3], tables[4], tables[5])
            stopping_s = max(stopping_s, of_base_s)
        stands_s[m] = reaction_s + stopping_s
        hold = _hold_s(speed, stopping_s, tables)
        for k in range(len(times_s)):
            followed = _followed(passed, min(times_s[k], reaction_s), start_s, step_s)
            after = max(times_s[k] - reaction_s, 0.0)
            phases[m, k] = followed + rate * _travel_s(after, hold, stopping_s - hold)
    return phases, stands_s


# -- straight on -----------------------------------------------------------------------------------


def _straight_by_arrays(
    joints: tuple[Floats, Floats],
    tables: Tables,
    moves: tuple[Floats, Floats, float],
    times: tuple[Floats, float],
) -> tuple[Floats, Floats]:
    """Return (L, K, N) joints of a robot that stops on a straight path, and (L, K) half stretches.

    Args:
        joints: (N,) positions and velocities now.
        tables: its stopping tables.
        moves: (L,) factors of the velocities, (L,) seconds from braking to rest at each, and the
            speed of the fastest point at factor 1.
        times: (K,) times; seconds from 0 until it brakes.
    """
    (q, qd), (factor, stopping_s, speed_m_s), (times_s, reaction_s) = joints, moves, times
    table = StoppingTable(*tables[:3])
    table.stretch = tables[5]
    factor = factor[:, None]
    travel = table.travel_s(factor * speed_m_s, times_s, reaction_s, stopping_s[:, None])
    u = factor * travel  # seconds at qd itself, from here on
    half = np.diff(u, axis=-1, prepend=u[..., :1]) / 2
    return q + u[..., None] * qd, half


def _straight_by_loops(
    joints: tuple[Floats, Floats],
    tables: Tables,
    moves: tuple[Floats, Floats, float],
    times: tuple[Floats, float],
) -> tuple[Floats, Floats]:
    q, qd = joints
    factor, stopping_s, speed_m_s = moves
    times_s, reaction_s = times
    places, half = (
        np.empty((len(factor), len(times_s), len(q))),
        np.zeros((len(factor), len(times_s))),
    )
    for m in range(len(factor)):
        hold = _hold_s(factor[m] * speed_m_s, stopping_s[m], tables)
        onset, braking = reaction_s + hold, stopping_s[m] - hold
        before = 0.0
        for k in range(len(times_s)):
            u = factor[m] * _travel_s(times_s[k], onset, braking)
            if k > 0:
                half[m, k] = (u - before) / 2
            before = u
            for i in range(len(q)):
                places[m, k, i] = q[i] + u * qd[i]
    return places, half


# -- along a trajectory ----------------------------------------------------------------------------


def _stretches_by_arrays(moves: Moves, phases_s: Floats) -> tuple[Floats, Floats, Floats, Floats]:
    """Return stretches between trajectory phases (L, K): q, bounds of |q'| and |q''|, and h.

    In the form for ``sweep``: (L, K, N) three times, and (L, K). Entry 0 is the start.
    """
    before = np.concatenate([phases_s[:, :1], phases_s[:, :-1]], axis=1)
    q, dq = at_phases(moves, phases_s)
    rate = np.abs(dq)
    bend = acceleration_most(moves, before, phases_s)
    half = (phases_s - before) / 2
    # no place of a stretch is farther than half of it from one of its ends
    fastest = np.maximum(rate, np.concatenate([rate[:, :1], rate[:, :-1]], axis=1))
    return q, fastest + half[..., None] * bend, bend, half


def at_phases(moves: Moves, phases_s: Floats) -> tuple[Floats, Floats]:
    """Return positions and velocities (..., N) at full speed at any phases (...)."""
    times, positions, _ = moves
    phase = phases_s % times[-1]
    i = move_of(times, phase)
    span = (times[i + 1] - times[i])[..., None]
    x = (phase - times[i])[..., None] / span
    start = positions[i]
    move = positions[i + 1] - start
    q: Floats = start + move * (x**3 * (10.0 - 15.0 * x + 6.0 * x * x))
    qd = move * (30.0 * x * x * (1.0 - x) ** 2) / span
    return q, qd


def acceleration_most(moves: Moves, from_s: Floats, to_s: Floats) -> Floats:
    """Return a bound (..., N) of each joint's acceleration at full speed between two phases.

    The moves at both phases are included; if the arm passes more than two moves, or comes round to
    an earlier phase of the same move, all moves are included.
    """
    times, _, acceleration = moves
    before, after = from_s % times[-1], to_s % times[-1]
    first, last = move_of(times, before), move_of(times, after)
    most = np.maximum(acceleration[first], acceleration[last])
    many = (to_s - from_s > times[-1] / 2) | ((last - first) % len(acceleration) > 1)
    many |= (last == first) & (after < before)
    return np.where(many[..., None], acceleration.max(0), most)


def move_of(times: Floats, phase_s: Floats) -> Ints:
    """Return the index (...) of the move that contains each phase within the cycle."""
    i = np.searchsorted(times, phase_s, side="right") - 1
    return np.minimum(i, len(times) - 2)


def _stretches_by_loops(moves: Moves, phases_s: Floats) -> tuple[Floats, Floats, Floats, Floats]:
    times, positions, acceleration = moves
    paths, places = phases_s.shape
    joints, count, cycle_s = positions.shape[1], len(acceleration), times[-1]
    q, fastest = np.empty((paths, places, joints)), np.empty((paths, places, joints))
    bend, half = np.empty((paths, places, joints)), np.zeros((paths, places))
    rate, rate_before = np.empty(joints), np.empty(joints)
    for m in range(paths):
        last, phase = 0, 0.0
        for k in range(places):
            before_s, phase = phase, phases_s[m, k] % cycle_s
            first, last = last, min(_before(times, phase), count - 1)
            far = False
            if k == 0:
                first = last
            else:
                half[m, k] = (phases_s[m, k] - phases_s[m, k - 1]) / 2
                far = phases_s[m, k] - phases_s[m, k - 1] > cycle_s / 2
            far = (
                far or (last - first) % count > 1 or (k > 0 and last == first and phase < before_s)
            )
            span = times[last + 1] - times[last]
            x = (phase - times[last]) / span
            for i in range(joints):
                move = positions[last + 1, i] - positions[last, i]
                done = x * x * x * (10.0 - 15.0 * x + 6.0 * x * x)
                q[m, k, i] = positions[last, i] + move * done
                rate[i] = abs(move * (30.0 * x * x * (1.0 - x) * (1.0 - x)) / span)
                if k == 0:
                    rate_before[i] = rate[i]
                most = max(acceleration[first, i], acceleration[last, i])
                if far:
                    for j in range(count):
                        most = max(most, acceleration[j, i])
                bend[m, k, i] = most
                fastest[m, k, i] = max(rate[i], rate_before[i]) + half[m, k] * most
                rate_before[i] = rate[i]
    return q, fastest, bend, half


# -- parts -----------------------------------------------------------------------------------------


@part
def _before(xs: Floats, x: float) -> int:
    """Return the index of the last ascending number that is at most ``x``; the first one is."""
    low, high = 0, len(xs)
    while low + 1 < high:
        middle = (low + high) // 2
        if xs[middle] <= x:
            low = middle
        else:
            high = middle
    return low


@part
def _between(x: float, xs: Floats, ys: Floats) -> float:
    """Like ``numpy.interp`` for one number."""
    if x >= xs[-1]:
        return float(ys[-1])
    if x < xs[0]:
        return float(ys[0])
    i = _before(xs, x)
    return float((ys[i + 1] - ys[i]) / (xs[i + 1] - xs[i]) * (x - xs[i]) + ys[i])


@part
def _followed(passed: Floats, time_s: float, start_s: float, step_s: float) -> float:
    """Return the phase at a time before braking; ``passed`` (cells + 1,): end time of each cell."""
    last = len(passed) - 1
    if time_s >= passed[last]:
        return start_s + last * step_s
    if time_s < 0.0:
        return start_s
    i = _before(passed, time_s)
    return start_s + (i + (time_s - passed[i]) / (passed[i + 1] - passed[i])) * step_s


@part
def _stopping_s(speed: float, speeds: Floats, times: Floats, stretch: float) -> float:
    """As ``StoppingTable.times_s``."""
    if not speed >= STANDING_M_S:
        return 0.0
    return _between(speed, speeds, times) * (max(speed / speeds[-1], 1.0) * stretch)


@part
def _hold_s(speed: float, stopping_s: float, tables: Tables) -> float:
    """As ``StoppingTable.hold_s``."""
    if not speed > 0.0:
        return 0.0
    speeds, distances, distance = tables[0], tables[2], 0.0
    if speed >= STANDING_M_S:
        if speed < speeds[0]:
            distance = distances[0] / speeds[0] * speed
        else:
            distance = _between(speed, speeds, distances)
        beyond = max(speed / speeds[-1], 1.0)
        distance *= beyond * beyond * tables[5]
    return min(max(2 * distance / speed - stopping_s, 0.0), stopping_s)


@part
def _travel_s(time_s: float, onset_s: float, braking_s: float) -> float:
    """Like ``StoppingTable.travel_s``, for a robot that brakes from ``onset_s`` onwards."""
    after = min(max(time_s - onset_s, 0.0), braking_s)
    lost = after * after / (2 * braking_s) if braking_s > 0.0 else 0.0
    return min(max(time_s, 0.0), onset_s) + after - lost


phases = kernel(_phases_by_loops, _phases_by_arrays)
straight = kernel(_straight_by_loops, _straight_by_arrays)
stretches = kernel(_stretches_by_loops, _stretches_by_arrays)
