"""Joint zones as loops. ``joint_zones`` says what they mean, and has the same as arrays."""

from math import ceil, inf, isfinite, sqrt
from typing import NamedTuple

import numpy as np

from hri_predict.arrays import Bools, Floats
from hri_predict.machine.compiled import part
from hri_predict.risk.zones.reach import (
    BONE_FACTOR,
    BONE_MARGIN_M,
    VELOCITY_STEPS,
    BodyReach,
)

NEVER_S = 1e3
"""Age of a joint that was never seen: at any human speed it may be anywhere."""
UNBOUNDED_M = 1e5
"""Radius of a joint before the cut to what bodies can do."""
FAR_M = 1e4
"""A coordinate beyond this is no position in a room."""
FRESH_S = 1e-6
LIMB_M = 0.85
"""How far a limb gets ahead of its body: an arm's reach by ISO 13855:2010."""

Spheres = tuple[Floats, Floats, Floats, Floats, Floats]
"""``mid``, ``radius``, ``path``, ``inflation`` and ``joint_age`` of ``JointSpheres``."""


class Bodies(NamedTuple):
    """N people at their captures, P of them here and then the lost ones. J joints.

    Attributes:
        last, joint_age: (N, J, 3) and (N, J) where and when last seen, as in the snapshot.
        growth: (N, J) m/s of a joint that is not forecast.
        limbs: (N, J) how much faster than its body a lost person's joint was.
        inferred: (N, J) metres: the joint is so near to where it is taken to be.
        age: (N,) seconds from capture to now.
        waited: (N,) seconds from capture to the time of entry 0.
        unknown: (P,) whose speed is unknown.
        history, measured: (P, T, J, 3) and (P, T, J).
    """

    last: Floats
    joint_age: Floats
    growth: Floats
    limbs: Floats
    inferred: Floats
    age: Floats
    waited: Floats
    unknown: Bools
    history: Floats
    measured: Bools


class Ahead(NamedTuple):
    """What is known of the future of the P people who are here; empty arrays: nothing.

    Attributes:
        given: whether there is a forecast.
        judged: whether it has calibrated radii, and ``claimed``, ``widen`` and ``outside`` say how
            far they hold.
        positions, std: of the forecast.
        claimed: (P, H, J) radii before widening.
        widen, outside: (P, H) and (P,), see ``Trust``.
    """

    given: bool
    judged: bool
    positions: Floats
    std: Floats
    claimed: Floats
    widen: Floats
    outside: Bools


class Rule(NamedTuple):
    """What does not change. ``speed`` and ``acceleration`` (J,) are those of the standard.

    ``calibrated``: whether the predictor is, so that physical limits bound what has no radius.
    """

    times_s: Floats
    rate_hz: float
    horizon_steps: int
    trusted_steps: int
    calibrated: bool
    speed: Floats
    acceleration: Floats
    velocity_error_m_s: float
    physical_m_s: float
    std_factor: float
    reach: BodyReach


def spheres_by_loops(bodies: Bodies, ahead: Ahead, rule: Rule) -> Spheres:
    """See ``JointSpheres``."""
    count, joints = bodies.joint_age.shape
    here, entries = len(bodies.unknown), len(rule.times_s)
    mid, path = np.empty((count, entries, joints, 3)), np.empty((count, entries, joints, 3))
    radius, inflation = np.empty((count, entries, joints)), np.empty((count, entries, joints))
    last, joint_age = np.zeros((count, joints, 3)), np.empty((count, joints))
    follows = np.zeros((count, joints), np.bool_)
    until, bone = np.empty(entries), np.empty(joints)
    cuts = rule.calibrated
    for n in range(count):
        for j in range(joints):
            seen = _clean(bodies.last[n, j], bodies.joint_age[n, j])
            joint_age[n, j] = NEVER_S
            if seen:
                joint_age[n, j] = min(bodies.joint_age[n, j], NEVER_S)
                last[n, j] = bodies.last[n, j]
            if ahead.given and n < here and joint_age[n, j] < FRESH_S:
                follows[n, j] = _is_followed(ahead, bodies.unknown, rule.trusted_steps, (n, j))
                cuts = cuts or follows[n, j]
    for n in range(count):
        for k in range(entries):
            until[k] = bodies.age[n] + rule.times_s[k]
        until[0] = bodies.waited[n]
        for j in range(joints):
            speed = bodies.growth[n, j]
            if n < here and bodies.unknown[n] and joint_age[n, j] >= FRESH_S:
                speed = rule.physical_m_s  # within reach of the joints that are seen
            for k in range(entries):
                path[n, k, j] = last[n, j]
                unseen = until[k] + joint_age[n, j]
                grown = speed * unseen + min(bodies.limbs[n, j] * unseen, LIMB_M)
                radius[n, k, j] = inflation[n, k, j] = grown
            if follows[n, j]:
                knots = last[n, j], ahead.positions[n, :, j]
                _enclose(knots, until * rule.rate_hz, path[n, :, j], inflation[n, :, j])
                for k in range(entries):
                    off = _deviation(ahead, rule, (n, j), until[k]) if k else 0.0
                    radius[n, k, j] = inflation[n, k, j] + off
        mid[n] = path[n]
        if cuts and n < here:
            for j in range(joints):
                if rule.calibrated or follows[n, j]:
                    if not follows[n, j]:
                        radius[n, 1:, j] = UNBOUNDED_M
                    own = bodies.history[n, :, j], bodies.measured[n, :, j], last[n, j]
                    times = until, joint_age[n, j]
                    _cut_by_motion(own, times, (rule, j), (mid[n, :, j], radius[n, :, j]))
        for k in range(entries):
            for j in range(joints):
                inflation[n, k, j] += bodies.inferred[n, j]
                radius[n, k, j] += bodies.inferred[n, j]
        if cuts and n < here:
            _bones(last[n], joint_age[n] < FRESH_S, bodies.inferred[n], (rule, bone))
            _cut_by_bones(rule.reach, bone, mid[n], radius[n])
    return mid, radius, path, inflation, joint_age


@part
def _clean(last: Floats, joint_age: float) -> bool:
    """Whether a joint was ever seen, in a room."""
    near = abs(last[0]) < FAR_M and abs(last[1]) < FAR_M and abs(last[2]) < FAR_M
    return near and joint_age >= 0


@part
def _is_followed(ahead: Ahead, unknown: Bools, steps: int, which: tuple[int, int]) -> bool:
    """Whether a fresh joint follows the forecast."""
    n, j = which
    if not ahead.judged:
        return not unknown[n]
    if ahead.outside[n]:
        return False
    known = True
    for h in range(steps):
        known = known and isfinite(ahead.claimed[n, h, j])
    return known


@part
def _enclose(knots: tuple[Floats, Floats], steps: Floats, path: Floats, radius: Floats) -> None:
    """``spheres.enclosed`` of one joint: fill (K+1, 3) and (K+1,)."""
    last, forecast = knots
    final = len(forecast)
    before, from_x, from_y, from_z = 0, 0.0, 0.0, 0.0
    radius[0] = 0.0
    path[0] = last
    for k in range(len(steps)):
        bound = steps[1] - 1.0 if k == 0 else steps[k]
        bound = 0.0 if bound < 0.0 else float(final) if bound > final else bound
        below = min(int(bound), max(final - 1, 0))
        on = bound - below
        lower = last if below == 0 else forecast[below - 1]
        upper = forecast[min(below, final - 1)]
        x = lower[0] + on * (upper[0] - lower[0])
        y = lower[1] + on * (upper[1] - lower[1])
        z = lower[2] + on * (upper[2] - lower[2])
        if k:
            path[k, 0], path[k, 1] = 0.5 * (from_x + x), 0.5 * (from_y + y)
            path[k, 2] = 0.5 * (from_z + z)
            radius[k] = 0.5 * _size(x - from_x, y - from_y, z - from_z)
            if before + 1 < bound:  # a knot lies between both ends
                corner = forecast[min(before, final - 1)]
                off = _size(corner[0] - path[k, 0], corner[1] - path[k, 1], corner[2] - path[k, 2])
                radius[k] = max(radius[k], off)
        before, from_x, from_y, from_z = below, x, y, z


@part
def _deviation(ahead: Ahead, rule: Rule, which: tuple[int, int], until: float) -> float:
    """Largest distance of a joint from the forecast by then, metres."""
    n, j = which
    end, steps = rule.trusted_steps / rule.rate_hz, until * rule.rate_hz
    if ahead.judged:
        at = min(max(ceil(steps - 1e-6) - 1, 0), rule.trusted_steps - 1)
        within = ahead.claimed[n, at, j] * ahead.widen[n, at]
    else:
        t = min(until, end)
        free = (0.5 * rule.acceleration[j] * t + rule.velocity_error_m_s) * t
        within = min(rule.speed[j] * t, free)
    within += rule.physical_m_s * max(until - end, 0.0)
    if len(ahead.std):
        after, most = ceil(steps) - 1, rule.horizon_steps - 1
        std = ahead.std[n, min(max(after, 0), most), j]
        std = max(std, ahead.std[n, min(max(after - 1, 0), most), j])
        within = max(within, rule.std_factor * std)
    return within


# -- the cut to what bodies can do, as in ``reach`` ------------------------------------------------


@part
def _size(x: float, y: float, z: float) -> float:
    return sqrt(x * x + y * y + z * z)


@part
def _along(d: float, radius: float, other: float) -> tuple[float, float]:
    """As ``spheres.along``."""
    both, way = radius + other, max(d, 1e-12)
    x = 0.5 * (d + (radius - other) * both / way)
    if x > 0 and x < d and d < both:
        disc = sqrt(max((radius - x) * (radius + x), 0.0))
        return x / way, min(disc, min(radius, other))
    if other < radius or d >= both:
        return 1.0, other
    return 0.0, radius


@part
def _cut_to(mid: Floats, radius: float, centre: tuple[float, float, float], bound: float) -> float:
    """Cut a sphere to another one, unless it lies within: move ``mid``, return the radius."""
    x, y, z = centre[0] - mid[0], centre[1] - mid[1], centre[2] - mid[2]
    square, room = x * x + y * y + z * z, bound - radius
    if room >= 0 and square <= room * room:
        return radius
    on, within = _along(sqrt(square), radius, bound)
    mid[0] += on * x
    mid[1] += on * y
    mid[2] += on * z
    return within


@part
def _cut_by_motion(
    seen: tuple[Floats, Bools, Floats],
    times: tuple[Floats, float],
    of: tuple[Rule, int],
    sphere: tuple[Floats, Floats],
) -> None:
    """Cut one joint's spheres, but for entry 0, to what speed and acceleration allow."""
    history, measured, last = seen
    until, joint_age = times
    rule, j = of
    mid, radius = sphere
    reach, length = rule.reach, len(measured)
    known, x, y, z = False, 0.0, 0.0, 0.0
    if length > VELOCITY_STEPS:
        then = length - 1 - VELOCITY_STEPS
        known = measured[length - 1] and measured[then]
        if known:
            per_s = reach.rate_hz / VELOCITY_STEPS
            x = (history[length - 1, 0] - history[then, 0]) * per_s
            y = (history[length - 1, 1] - history[then, 1]) * per_s
            z = (history[length - 1, 2] - history[then, 2]) * per_s
    speed = _size(x, y, z)
    for k in range(1, len(until)):
        t = until[k]
        since = max(t - 1.0 / rule.rate_hz, 0.0)
        start = last[0], last[1], last[2]
        around = _cut_to(mid[k], radius[k], start, reach.speed[j] * (t + joint_age))
        if known:
            middle, half = 0.5 * (since + t), 0.5 * (t - since)
            change = (reach.burst[j] + 0.5 * reach.sustained[j] * t) * t
            on = last[0] + x * middle, last[1] + y * middle, last[2] + z * middle
            around = _cut_to(mid[k], around, on, change + speed * half)
        radius[k] = around


@part
def _bones(last: Floats, seen: Bools, inferred: Floats, into: tuple[Rule, Floats]) -> None:
    """Fill (J,) how far each joint is from its parent at most."""
    rule, bone = into
    for j in rule.reach.order:
        of = rule.reach.parents[j]
        bone[j] = rule.reach.bone[j] if seen[j] or rule.calibrated else inf
        if seen[j] and seen[of]:
            apart = _size(
                last[j, 0] - last[of, 0], last[j, 1] - last[of, 1], last[j, 2] - last[of, 2]
            )
            bone[j] = (apart + inferred[j] + inferred[of]) * BONE_FACTOR + BONE_MARGIN_M


@part
def _cut_by_bones(reach: BodyReach, bone: Floats, mid: Floats, radius: Floats) -> None:
    """Cut all joints' spheres, but for entry 0, from the root outwards."""
    for k in range(1, len(radius)):
        for j in reach.order:
            of = reach.parents[j]
            parent = mid[k, of, 0], mid[k, of, 1], mid[k, of, 2]
            radius[k, j] = _cut_to(mid[k, j], radius[k, j], parent, radius[k, of] + bone[j])
