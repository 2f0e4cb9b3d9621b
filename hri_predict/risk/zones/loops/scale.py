"""The learned scale as loops: the inputs of its network, and the network.

``learned_scale`` says what each figure means, and has the same as array operations.
"""

from math import exp, inf, isfinite, isnan, log, log1p, sqrt
from typing import NamedTuple

import numpy as np

from hri_predict.arrays import Bools, Floats, Ints
from hri_predict.machine.compiled import part

BACK = (1, 3, 10)
"""Speeds are measured over so many steps."""
BEFORE = 4
"""The speed over the 3 steps before this tells the acceleration."""
LEAST_M, MOST_M = 0.01, 5.0
"""Bounds of the scale."""
BEYOND = 4.0
"""Inputs count as no farther than so many standard deviations from the fitted mean."""
SPEED, ERROR = 5.0, 20.0
"""Of 1 + so much x, the logarithm is read."""
MOST_SPEED, MOST_ERROR = 20.0, 2.0
_LEAST_LOG, _MOST_LOG = log(LEAST_M), log(MOST_M)
_SHORT, _STEPS, _LONG = BACK


class Seen(NamedTuple):
    """``learned_scale.Evidence`` as loops take it."""

    history: Floats
    observed: Bools
    forecast: Floats
    error_m: Floats
    residual_m: Floats


class Tables(NamedTuple):
    """The network, and what is known before anybody is seen. K knots, N inputs.

    Attributes:
        rate_hz: steps per second.
        trunk: indices of the joints whose mean is the trunk's motion.
        knots: (K,) steps at which the network runs, from 1.
        below, above, part: (H,) between which knots each step is, and how far on.
        mean, deviation: (N,) of the inputs.
        now, ahead: (., hidden) rows of the first layer.
        first: (J, hidden) what each joint's kind adds to it, with the biases.
        rest: the layers after it.
        other: (J,) joints of no kind.
    """

    rate_hz: float
    trunk: Ints
    knots: Ints
    below: Ints
    above: Ints
    part: Floats
    mean: Floats
    deviation: Floats
    now: Floats
    ahead: Floats
    first: Floats
    rest: tuple[tuple[Floats, Floats], ...]
    other: Bools


def scale_by_loops(seen: Seen, tables: Tables) -> Floats:
    """(P, H, J) metres; see ``LearnedScale``."""
    people, length, joints = seen.observed.shape
    steps, knots = len(tables.below), len(tables.knots)
    count, hidden = tables.now.shape
    widest = hidden
    for _, biases in tables.rest:
        widest = max(widest, len(biases))
    scale = np.empty((people, steps, joints))
    logs, now = np.empty((knots, joints)), np.empty((joints, count))
    base, moved = np.empty(hidden), np.empty((4, joints, 3))
    row, into, used = np.empty(widest), np.empty(widest), np.empty(widest + 1, np.intp)
    for p in range(people):
        history, observed = seen.history[p], seen.observed[p]
        _inputs_now((history, observed), tables, now, moved)
        _inputs_of_errors(seen.error_m[p], seen.residual_m[p], now)
        for j in range(joints):
            for h in range(hidden):
                base[h] = tables.first[j, h]
            for i in range(count):
                value = _normal(now[j, i], tables.mean[i], tables.deviation[i])
                for h in range(hidden):
                    base[h] += value * tables.now[i, h]
            for k in range(knots):
                for h in range(hidden):
                    row[h] = base[h]
                places = history[length - 1, j], seen.forecast[p]
                ahead = _inputs_ahead(places, tables, (k, j), observed[length - 1, j])
                for i in range(4):
                    value = _normal(ahead[i], tables.mean[count + i], tables.deviation[count + i])
                    for h in range(hidden):
                        row[h] += value * tables.ahead[i, h]
                width = hidden
                for weights, biases in tables.rest:
                    _layer((row, width), (weights, biases), into, used)
                    row, into = into, row
                    width = len(biases)
                logs[k, j] = row[0]
        _between_knots(logs, tables, scale[p])
    return scale


# -- the network -----------------------------------------------------------------------------------


@part
def _layer(
    given: tuple[Floats, int], layer: tuple[Floats, Floats], into: Floats, used: Ints
) -> None:
    """What a layer makes of the positive ones of its inputs; NaN stays NaN."""
    row, width = given
    weights, biases = layer
    count = 0
    for k in range(width):  # without a branch, which nothing could foresee
        used[count] = k
        count += 0 if row[k] <= 0.0 else 1
    outputs = len(biases)
    if outputs == 1:
        even = odd = 0.0
        for i in range(0, count - 1, 2):
            even += row[used[i]] * weights[used[i], 0]
            odd += row[used[i + 1]] * weights[used[i + 1], 0]
        if count % 2:
            even += row[used[count - 1]] * weights[used[count - 1], 0]
        into[0] = even + odd + biases[0]
        return
    for h in range(outputs):
        into[h] = 0.0
    i = 0
    while i + 4 <= count:  # four at a time: each sum is read and written once
        a, b, c, d = used[i], used[i + 1], used[i + 2], used[i + 3]
        to_a, to_b, to_c, to_d = weights[a], weights[b], weights[c], weights[d]
        a_is, b_is, c_is, d_is = row[a], row[b], row[c], row[d]
        for h in range(outputs):
            into[h] += (a_is * to_a[h] + b_is * to_b[h]) + (c_is * to_c[h] + d_is * to_d[h])
        i += 4
    while i < count:
        to_a, a_is = weights[used[i]], row[used[i]]
        for h in range(outputs):
            into[h] += a_is * to_a[h]
        i += 1
    for h in range(outputs):
        into[h] += biases[h]


@part
def _normal(value: float, mean: float, deviation: float) -> float:
    value = (value - mean) / deviation
    return -BEYOND if value < -BEYOND else BEYOND if value > BEYOND else value


@part
def _between_knots(logs: Floats, tables: Tables, scale: Floats) -> None:
    """Fill (H, J): never less than before, linear in the logarithm between knots."""
    knots, joints = logs.shape
    for j in range(joints):
        for k in range(1, knots):
            if logs[k - 1, j] > logs[k, j] or isnan(logs[k - 1, j]):
                logs[k, j] = logs[k - 1, j]
        for h in range(len(scale)):
            lower, higher = logs[tables.below[h], j], logs[tables.above[h], j]
            value = lower + tables.part[h] * (higher - lower)
            value = _LEAST_LOG if value < _LEAST_LOG else _MOST_LOG if value > _MOST_LOG else value
            scale[h, j] = inf if tables.other[j] or not isfinite(value) else exp(value)


# -- its inputs ------------------------------------------------------------------------------------


@part
def _log_speed(value: float) -> float:
    return log1p(SPEED * (MOST_SPEED if value > MOST_SPEED else value))


@part
def _log_error(value: float) -> float:
    return log1p(ERROR * (MOST_ERROR if value > MOST_ERROR else value))


@part
def _size(x: float, y: float, z: float) -> float:
    return sqrt(x * x + y * y + z * z)


@part
def _inputs_now(given: tuple[Floats, Bools], tables: Tables, now: Floats, velocity: Floats) -> None:
    """Fill the first eleven columns of (J, ``NOW``) by (T, J, 3) places and what was observed.

    ``velocity`` (4, J, 3) is room to work in: over each of ``BACK``, and before.
    """
    history, observed = given
    length, joints = observed.shape
    backs = (_SHORT, _STEPS, _LONG, _STEPS)
    for b in range(4):
        end = length - 1 - (BEFORE - _STEPS if b == 3 else 0)
        start = max(end - backs[b], 0)
        per_s = tables.rate_hz / max(end - start, 1)
        end = length - 1 if end < 0 else end
        for j in range(joints):
            both = observed[end, j] and observed[start, j]
            for i in range(3):
                moved = history[end, j, i] - history[start, j, i] if both else 0.0
                velocity[b, j, i] = moved * per_s
    start, count = max(length - 1 - _STEPS, 0), 0
    x = y = z = 0.0
    for j in tables.trunk:
        count += observed[length - 1, j] and observed[start, j]
        x, y, z = x + velocity[1, j, 0], y + velocity[1, j, 1], z + velocity[1, j, 2]
    count = max(count, 1)
    x, y, z = x / count, y / count, z / count
    fastest = total = 0.0
    for j in range(joints):
        v, before = velocity[1, j], velocity[3, j]
        speed = _size(v[0], v[1], v[2])
        fastest = speed if speed > fastest or isnan(speed) else fastest
        total += speed
        now[j, 1] = _log_speed(speed)
        now[j, 0] = _log_speed(_size(velocity[0, j, 0], velocity[0, j, 1], velocity[0, j, 2]))
        whole = _size(velocity[2, j, 0], velocity[2, j, 1], velocity[2, j, 2])
        now[j, 2] = _log_speed(whole)
        now[j, 3] = _log_speed(_size(v[0] - x, v[1] - y, v[2] - z))
        change = _size(v[0] - before[0], v[1] - before[1], v[2] - before[2])
        now[j, 4] = _log_speed(8.0 * change)
        path, share = _path(history, observed, j, tables.rate_hz)
        now[j, 5] = _log_speed(path)
        now[j, 6] = _log_speed(0.0 if path < whole else path - whole)
        now[j, 10] = share
    trunk, fast = _log_speed(_size(x, y, z)), _log_speed(fastest)
    mean = _log_speed(total / joints)
    for j in range(joints):
        now[j, 7], now[j, 8], now[j, 9] = trunk, fast, mean


@part
def _path(history: Floats, observed: Bools, j: int, rate_hz: float) -> tuple[float, float]:
    """How fast a joint went along its path of late, m/s, and in which share of it it was seen."""
    length = len(observed)
    first = max(length - 1 - _LONG, 0)
    steps, seen, path = 0, 0, 0.0
    for t in range(first, length):
        seen += observed[t, j]
        if t > first and observed[t, j] and observed[t - 1, j]:
            here, there = history[t, j], history[t - 1, j]
            path += _size(here[0] - there[0], here[1] - there[1], here[2] - there[2])
            steps += 1
    return path * rate_hz / max(steps, 1), seen / (length - first)


@part
def _inputs_of_errors(error_m: Floats, residual_m: float, now: Floats) -> None:
    """Fill the other columns, by (2, J) errors and the residual."""
    joints = len(now)
    for i in range(2):
        known, total = 0, 0.0
        for j in range(joints):
            error = error_m[i, j]
            unknown = isnan(error)
            now[j, 11 + i] = 0.0 if unknown else _log_error(error)
            now[j, 13 + i] = 1.0 if unknown else 0.0
            if not unknown:
                known += 1
                total += MOST_ERROR if error > MOST_ERROR else error
        body = _log_error(total / max(known, 1))
        for j in range(joints):
            now[j, 15 + i] = body
    unknown = isnan(residual_m)
    residual = 0.0 if unknown else _log_error(residual_m)
    for j in range(joints):
        now[j, 17], now[j, 18] = residual, 1.0 if unknown else 0.0


@part
def _inputs_ahead(
    places: tuple[Floats, Floats], tables: Tables, which: tuple[int, int], observed: bool
) -> tuple[float, float, float, float]:
    """The inputs of one knot and joint, by its last place (3,) and forecast places (H, J, 3)."""
    last, forecast = places
    k, j = which
    knot = tables.knots[k]
    at = forecast[knot - 1, j]
    moved = speed = 0.0
    if observed:
        moved = _size(at[0] - last[0], at[1] - last[1], at[2] - last[2])
    if knot > 1:
        earlier = forecast[knot - 2, j]
        speed = _size(at[0] - earlier[0], at[1] - earlier[1], at[2] - earlier[2])
    elif observed:
        speed = moved
    lead = knot / tables.rate_hz
    return _log_speed(moved), _log_speed(speed * tables.rate_hz), lead, log(lead)
