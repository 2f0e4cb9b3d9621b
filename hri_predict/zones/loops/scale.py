"""The learned scale as loops: the inputs of its network, and the network.

``learned_scale`` explains each value and implements the same as array operations. Positions and
inputs are in double precision; normalised inputs and the network are in single precision.
"""

from math import exp, inf, isfinite, isnan, log, log1p, sqrt
from typing import NamedTuple

import numpy as np

from hri_predict.base.arrays import Bools, Floats, Ints, Singles
from hri_predict.base.machine.compiled import part

BACK = (1, 3, 10)
"""Numbers of steps over which speeds are measured."""
BEFORE = 4
"""Offset in steps of the earlier speed, over 3 steps, from which the acceleration is computed."""
LEAST_M, MOST_M = 0.01, 5.0
"""Bounds of the scale."""
BEYOND = 4.0
"""Maximum distance of inputs from the fitted mean, in standard deviations."""
SPEED, ERROR = 5.0, 20.0
"""Factor k of log(1 + k·x), which indexes the table."""
MOST_SPEED, MOST_ERROR = 20.0, 2.0
_LEAST_LOG, _MOST_LOG = log(LEAST_M), log(MOST_M)
_SHORT, _STEPS, _LONG = BACK


class EvidenceArrays(NamedTuple):
    """``learned_scale.Evidence`` in the form used by the loops."""

    history: Floats
    observed: Bools
    forecast: Floats
    error_m: Floats
    residual_m: Floats
    std: Floats


class Tables(NamedTuple):
    """The network, and constants that do not depend on a person. K knots, N inputs.

    Attributes:
        rate_hz: steps per second.
        trunk: indices of the joints whose mean is the trunk's motion.
        knots: (K,) steps at which the network runs, from 1.
        below, above, part: (H,) the knots before and after each step, and the fraction between
            them.
        mean, deviation: (N,) mean and standard deviation of the inputs.
        now, ahead: (., hidden) rows of the first layer.
        first: (J, hidden) contribution of each joint's kind to it, with the biases.
        rest: the layers after the first.
        other: (J,) joints without a kind.
    """

    rate_hz: float
    trunk: Ints
    knots: Ints
    below: Ints
    above: Ints
    part: Floats
    mean: Floats
    deviation: Floats
    now: Singles
    ahead: Singles
    first: Singles
    rest: tuple[tuple[Singles, Singles], ...]
    other: Bools


def scale_by_loops(seen: EvidenceArrays, tables: Tables) -> Floats:
    """Return (P, H, J) metres; see ``LearnedScale``."""
    people, joints = seen.observed.shape[0], seen.observed.shape[2]
    scale = np.empty((people, len(tables.below), joints))
    logs = np.empty((len(tables.knots), joints))
    now, moved = np.empty((joints, tables.now.shape[0])), np.empty((4, joints, 3))
    ahead = np.empty((len(tables.knots), joints, 5))
    normal_now = np.empty(now.shape, np.float32)
    normal_ahead = np.empty(ahead.shape, np.float32)
    for p in range(people):
        given = seen.history[p], seen.observed[p]
        _inputs_now(given, tables, now, moved)
        _inputs_of_errors(seen.error_m[p], seen.residual_m[p], now)
        _inputs_ahead(given, seen.forecast[p], tables, ahead)
        _inputs_of_spread(seen.std, p, tables, ahead)
        _normalise((now, ahead), (normal_now, normal_ahead), tables.mean, tables.deviation)
        _network(normal_now, normal_ahead, tables, logs)
        _between_knots(logs, tables, scale[p])
    return scale


# -- the network -----------------------------------------------------------------------------------


@part
def _network(now: Singles, ahead: Singles, tables: Tables, logs: Floats) -> None:
    """Fill (K, J) with the scale's logarithms."""
    of_now, of_ahead, first, rest = tables.now, tables.ahead, tables.first, tables.rest
    hidden = of_now.shape[1]
    widest = hidden
    for _, biases in rest:
        widest = max(widest, len(biases))
    base = np.empty(hidden, np.float32)
    row, into = np.empty(widest, np.float32), np.empty(widest, np.float32)
    used = np.empty(widest + 1, np.intp)
    for j in range(len(now)):
        for h in range(hidden):
            base[h] = first[j, h]
        for i in range(now.shape[1]):
            value = now[j, i]
            for h in range(hidden):
                base[h] += value * of_now[i, h]
        for k in range(len(ahead)):
            a, b, c, d = ahead[k, j, 0], ahead[k, j, 1], ahead[k, j, 2], ahead[k, j, 3]
            e = ahead[k, j, 4]
            for h in range(hidden):
                shared = a * of_ahead[0, h] + b * of_ahead[1, h]
                shared += c * of_ahead[2, h] + d * of_ahead[3, h]
                row[h] = base[h] + (shared + e * of_ahead[4, h])
            width = hidden
            for weights, biases in rest:
                count = _positive(row, width, used)
                width = len(biases)
                if width == 1:
                    into[0] = _sum(row, used[:count], weights) + biases[0]
                else:
                    _layer(row, used[:count], weights, into)
                    for h in range(width):
                        into[h] += biases[h]
                row, into = into, row
            logs[k, j] = row[0]


@part
def _positive(row: Singles, width: int, used: Ints) -> int:
    """Fill in the indices of inputs that are positive or NaN, and return their number."""
    count = 0
    for k in range(width):  # without a branch, which no processor could foresee
        used[count] = k
        count += 0 if row[k] <= 0.0 else 1
    return count


@part
def _sum(row: Singles, used: Ints, weights: Singles) -> float:
    even = odd = 0.0
    count = len(used)
    for i in range(0, count - 1, 2):
        even += row[used[i]] * weights[used[i], 0]
        odd += row[used[i + 1]] * weights[used[i + 1], 0]
    if count % 2:
        even += row[used[count - 1]] * weights[used[count - 1], 0]
    return even + odd


@part
def _layer(row: Singles, used: Ints, weights: Singles, into: Singles) -> None:
    """Fill in the output of a layer for the inputs ``used``, without biases."""
    count, width, i = len(used), weights.shape[1], 0
    for h in range(width):
        into[h] = 0.0
    while i + 4 <= count:  # four at a time: each sum is read and written once
        a, b, c, d = used[i], used[i + 1], used[i + 2], used[i + 3]
        a_is, b_is, c_is, d_is = row[a], row[b], row[c], row[d]
        for h in range(width):
            shared = a_is * weights[a, h] + b_is * weights[b, h]
            into[h] += shared + (c_is * weights[c, h] + d_is * weights[d, h])
        i += 4
    while i < count:
        a = used[i]
        a_is = row[a]
        for h in range(width):
            into[h] += a_is * weights[a, h]
        i += 1


@part
def _normalise(
    inputs: tuple[Floats, Floats], normal: tuple[Singles, Singles], mean: Floats, deviation: Floats
) -> None:
    now, ahead = inputs
    normal_now, normal_ahead = normal
    count = now.shape[1]
    for i in range(count):
        for j in range(len(now)):
            normal_now[j, i] = _bounded((now[j, i] - mean[i]) / deviation[i], -BEYOND, BEYOND)
    for i in range(5):
        for k in range(len(ahead)):
            for j in range(len(now)):
                value = (ahead[k, j, i] - mean[count + i]) / deviation[count + i]
                normal_ahead[k, j, i] = _bounded(value, -BEYOND, BEYOND)


@part
def _bounded(value: float, least: float, most: float) -> float:
    return least if value < least else most if value > most else value


@part
def _between_knots(logs: Floats, tables: Tables, scale: Floats) -> None:
    """Fill (H, J): never decreasing, with a logarithm that is linear between knots."""
    knots, joints = logs.shape
    below, above, on, other = tables.below, tables.above, tables.part, tables.other
    for j in range(joints):
        for k in range(1, knots):
            if logs[k - 1, j] > logs[k, j] or isnan(logs[k - 1, j]):
                logs[k, j] = logs[k - 1, j]
        for h in range(len(scale)):
            lower, higher = logs[below[h], j], logs[above[h], j]
            value = lower + on[h] * (higher - lower)
            value = _bounded(value, _LEAST_LOG, _MOST_LOG)
            scale[h, j] = inf if other[j] or not isfinite(value) else exp(value)


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
    """Fill the first eleven columns of (J, ``NOW``) from (T, J, 3) positions and observation flags.

    ``velocity`` (4, J, 3) is a work array: velocities over each of ``BACK``, and before.
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
        v_x, v_y, v_z = velocity[1, j, 0], velocity[1, j, 1], velocity[1, j, 2]
        speed = _size(v_x, v_y, v_z)
        fastest = speed if speed > fastest or isnan(speed) else fastest
        total += speed
        now[j, 1] = _log_speed(speed)
        now[j, 0] = _log_speed(_size(velocity[0, j, 0], velocity[0, j, 1], velocity[0, j, 2]))
        whole = _size(velocity[2, j, 0], velocity[2, j, 1], velocity[2, j, 2])
        now[j, 2] = _log_speed(whole)
        now[j, 3] = _log_speed(_size(v_x - x, v_y - y, v_z - z))
        v_x, v_y, v_z = v_x - velocity[3, j, 0], v_y - velocity[3, j, 1], v_z - velocity[3, j, 2]
        now[j, 4] = _log_speed(8.0 * _size(v_x, v_y, v_z))
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
    """Return a joint's recent speed along its path, m/s, and the share of seen steps."""
    length = len(observed)
    first = max(length - 1 - _LONG, 0)
    steps, seen, path = 0, 0, 0.0
    for t in range(first, length):
        seen += observed[t, j]
        if t > first and observed[t, j] and observed[t - 1, j]:
            x = history[t, j, 0] - history[t - 1, j, 0]
            y = history[t, j, 1] - history[t - 1, j, 1]
            z = history[t, j, 2] - history[t - 1, j, 2]
            path += _size(x, y, z)
            steps += 1
    return path * rate_hz / max(steps, 1), seen / (length - first)


@part
def _inputs_of_errors(error_m: Floats, residual_m: float, now: Floats) -> None:
    """Fill the other columns from (2, J) errors and the residual."""
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
    given: tuple[Floats, Bools], forecast: Floats, tables: Tables, ahead: Floats
) -> None:
    """Fill (K, J, ``AHEAD``) but the spread from the past (T, J, 3) and future (H, J, 3)."""
    history, observed = given
    knots, rate_hz, now = tables.knots, tables.rate_hz, len(observed) - 1
    for k in range(len(knots)):
        at = knots[k] - 1
        lead = knots[k] / rate_hz
        log_lead = log(lead)
        for j in range(observed.shape[1]):
            moved = speed = 0.0
            if observed[now, j]:
                x = forecast[at, j, 0] - history[now, j, 0]
                y = forecast[at, j, 1] - history[now, j, 1]
                moved = speed = _size(x, y, forecast[at, j, 2] - history[now, j, 2])
            if at > 0:
                x = forecast[at, j, 0] - forecast[at - 1, j, 0]
                y = forecast[at, j, 1] - forecast[at - 1, j, 1]
                speed = _size(x, y, forecast[at, j, 2] - forecast[at - 1, j, 2])
            ahead[k, j, 0], ahead[k, j, 1] = _log_speed(moved), _log_speed(speed * rate_hz)
            ahead[k, j, 2], ahead[k, j, 3] = lead, log_lead


@part
def _inputs_of_spread(std: Floats, p: int, tables: Tables, ahead: Floats) -> None:
    """Fill the last column; ``std`` is empty if the forecast states none."""
    for k in range(len(tables.knots)):
        for j in range(ahead.shape[1]):
            ahead[k, j, 4] = _log_error(std[p, tables.knots[k] - 1, j]) if len(std) else 0.0
