"""Joint zones as loops. ``joint_zones`` explains the rules and has the same as array operations."""

from math import ceil, inf, isfinite, sqrt
from typing import NamedTuple

import numpy as np

from hri_predict.base.arrays import Bools, Floats, Ints
from hri_predict.base.machine.compiled import part
from hri_predict.zones.reach import BONE_FACTOR, BONE_MARGIN_M, VELOCITY_STEPS, BodyReach

NEVER_S = 1e3
"""Age assumed for a joint that was never seen: at any human speed it may then be anywhere."""
UNBOUNDED_M = 1e5
"""Radius of a joint before the cut to physical limits."""
FAR_M = 1e4
"""Maximum coordinate of a position in a room."""
FRESH_S = 1e-6
UNSEEN = 1.15
"""Factor for the radius of an unseen joint, applied to the root of the sum of squares of the
calibrated radius and the radius of its inferred position (docs/measured/unseen-joints.md)."""
LIMB_M = 0.85
"""Maximum distance of a limb ahead of its body: an arm's reach by ISO 13855:2010."""

Spheres = tuple[Floats, Floats, Floats, Floats, Floats]
"""``mid``, ``radius``, ``path``, ``inflation`` and ``joint_age`` of ``JointSpheres``."""


class CapturedBodies(NamedTuple):
    """N people at their captures: P people in view, then lost people. J joints.

    Attributes:
        last, joint_age: (N, J, 3) and (N, J) last seen positions and ages, as in the snapshot.
        growth: (N, J) growth speed of a joint without a forecast, m/s.
        limbs: (N, J) speed of a lost person's joint in excess of its body's, m/s.
        inferred: (N, J) maximum distance of the joint from its inferred position, metres.
        age: (N,) seconds from capture to now.
        waited: (N,) seconds from capture to the time of entry 0.
        unknown: (P,) whether a person's speed is unknown.
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
    """Forecast data for the P people in view; empty arrays: no data.

    Attributes:
        given: whether there is a forecast.
        judged: whether the forecast has calibrated radii; ``claimed``, ``widen`` and ``outside``
            are then valid.
        positions, std: positions and standard deviations of the forecast.
        claimed: (P, H, J) radii before widening.
        widen, outside: (P, H) ``widen`` and (P,) ``out_of_distribution`` of ``Trust``.
    """

    given: bool
    judged: bool
    positions: Floats
    std: Floats
    claimed: Floats
    widen: Floats
    outside: Bools


class Rule(NamedTuple):
    """Constants. ``speed`` and ``acceleration`` (J,) are limits of the uncalibrated rule.

    ``calibrated``: whether the predictor is calibrated; physical limits then bound joints without a
    radius.
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


def spheres_by_loops(bodies: CapturedBodies, ahead: Ahead, rule: Rule) -> Spheres:
    """See ``JointSpheres``."""
    count, joints = bodies.joint_age.shape
    here, entries = len(bodies.unknown), len(rule.times_s)
    path, mid = np.empty((count, entries, joints, 3)), np.empty((count, entries, joints, 3))
    radius, inflation = np.empty((count, entries, joints)), np.empty((count, entries, joints))
    last, joint_age = np.zeros((count, joints, 3)), np.empty((count, joints))
    follows = np.zeros((count, joints), np.bool_)
    until, knots = np.empty(entries), np.empty((rule.trusted_steps + 1, 3))
    off, bone = np.empty((entries, joints)), np.empty(joints)
    _clean(bodies, last, joint_age)
    if ahead.given:
        _follow(ahead, bodies.unknown, rule.trusted_steps, (joint_age, follows))
    cuts = rule.calibrated or follows.any()
    for n in range(count):
        for k in range(entries):
            until[k] = bodies.age[n] + rule.times_s[k]
        until[0] = bodies.waited[n]
        if n < here and ahead.given:
            _deviate(ahead, rule, (n, until), off)
        for j in range(joints):
            speed, age, limb = bodies.growth[n, j], joint_age[n, j], bodies.limbs[n, j]
            if n < here and bodies.unknown[n] and age >= FRESH_S:
                speed = rule.physical_m_s  # within reach of the joints that are seen
            if follows[n, j]:
                for i in range(3):
                    knots[0, i] = last[n, j, i]
                    for h in range(rule.trusted_steps):
                        knots[h + 1, i] = ahead.positions[n, h, j, i]
                _enclose(knots, until, rule.rate_hz, (path[n, :, j], inflation[n, :, j]))
                within = bodies.inferred[n, j] if ahead.judged else 0.0
                for k in range(entries):
                    spread = off[k, j]
                    if within > 0.0 and k > 0:
                        spread = UNSEEN * sqrt(spread * spread + within * within)
                    radius[n, k, j] = inflation[n, k, j] + spread
            else:
                for k in range(entries):
                    for i in range(3):
                        path[n, k, j, i] = last[n, j, i]
                    unseen = until[k] + age
                    grown = speed * unseen + min(limb * unseen, LIMB_M)
                    radius[n, k, j] = inflation[n, k, j] = grown
        for k in range(entries):
            for j in range(joints):
                inflation[n, k, j] += bodies.inferred[n, j]
                for i in range(3):
                    mid[n, k, j, i] = path[n, k, j, i]
        if cuts and n < here:
            _cut_by_motion(
                (bodies, rule, n), (last[n], joint_age[n], follows[n]), until, (mid[n], radius[n])
            )
        for k in range(entries):
            for j in range(joints):
                if k == 0 or not (follows[n, j] and ahead.judged):
                    radius[n, k, j] += bodies.inferred[n, j]
        if cuts and n < here:
            _bones((last[n], joint_age[n]), bodies.inferred[n], rule, bone)
            _cut_by_bones((rule.reach.order, rule.reach.parents), bone, mid[n], radius[n])
    return mid, radius, path, inflation, joint_age


@part
def _clean(bodies: CapturedBodies, last: Floats, joint_age: Floats) -> None:
    """Fill in positions and ages of joints; a joint outside any room counts as never seen."""
    for n in range(len(last)):
        for j in range(last.shape[1]):
            seen = bodies.joint_age[n, j] >= 0
            for i in range(3):
                seen = seen and abs(bodies.last[n, j, i]) < FAR_M  # false for NaN too
            joint_age[n, j] = min(bodies.joint_age[n, j], NEVER_S) if seen else NEVER_S
            for i in range(3):
                last[n, j, i] = bodies.last[n, j, i] if seen else 0.0


@part
def _follow(ahead: Ahead, unknown: Bools, steps: int, into: tuple[Floats, Bools]) -> None:
    """Fill in which joints of the newest capture follow the forecast."""
    joint_age, follows = into
    for n in range(len(unknown)):
        for j in range(follows.shape[1]):
            followed = joint_age[n, j] < FRESH_S
            if ahead.judged:
                followed = followed and not ahead.outside[n]
                for h in range(steps):
                    followed = followed and isfinite(ahead.claimed[n, h, j])
            else:
                followed = followed and not unknown[n]
            follows[n, j] = followed


@part
def _enclose(knots: Floats, until: Floats, rate_hz: float, into: tuple[Floats, Floats]) -> None:
    """Apply ``sphere_geometry.enclosed`` to one joint with knots (H+1, 3): fill (K+1, 3) and
    (K+1,)."""
    path, radius = into
    final = len(knots) - 1
    before, from_x, from_y, from_z = 0, 0.0, 0.0, 0.0
    for k in range(len(until)):
        bound = until[1] * rate_hz - 1.0 if k == 0 else until[k] * rate_hz
        bound = 0.0 if bound < 0.0 else float(final) if bound > final else bound
        below = min(int(bound), max(final - 1, 0))
        above, on = min(below + 1, final), bound - below
        x = knots[below, 0] + on * (knots[above, 0] - knots[below, 0])
        y = knots[below, 1] + on * (knots[above, 1] - knots[below, 1])
        z = knots[below, 2] + on * (knots[above, 2] - knots[below, 2])
        if k == 0:
            radius[0] = 0.0
            path[0, 0], path[0, 1], path[0, 2] = knots[0, 0], knots[0, 1], knots[0, 2]
        else:
            mid_x, mid_y, mid_z = 0.5 * (from_x + x), 0.5 * (from_y + y), 0.5 * (from_z + z)
            size = 0.5 * _size(x - from_x, y - from_y, z - from_z)
            if before + 1 < bound:  # a knot lies between both ends
                at = min(before + 1, final)
                d_x, d_y, d_z = knots[at, 0] - mid_x, knots[at, 1] - mid_y, knots[at, 2] - mid_z
                size = max(size, _size(d_x, d_y, d_z))
            radius[k] = size
            path[k, 0], path[k, 1], path[k, 2] = mid_x, mid_y, mid_z
        before, from_x, from_y, from_z = below, x, y, z


@part
def _deviate(ahead: Ahead, rule: Rule, when: tuple[int, Floats], off: Floats) -> None:
    """Fill (K+1, J) with the largest distances from a person's forecast, metres."""
    n, until = when
    end, most = rule.trusted_steps / rule.rate_hz, rule.horizon_steps - 1
    claimed, widen, std = ahead.claimed, ahead.widen, ahead.std
    speed, acceleration, error = rule.speed, rule.acceleration, rule.velocity_error_m_s
    for j in range(off.shape[1]):
        off[0, j] = 0.0
    for k in range(1, len(off)):
        steps, t = until[k] * rule.rate_hz, min(until[k], end)
        beyond = rule.physical_m_s * max(until[k] - end, 0.0)
        at = min(max(ceil(steps - 1e-6) - 1, 0), rule.trusted_steps - 1)
        after = ceil(steps) - 1
        for j in range(off.shape[1]):
            if ahead.judged:
                within = claimed[n, at, j] * widen[n, at]
            else:
                within = min(speed[j] * t, (0.5 * acceleration[j] * t + error) * t)
            within += beyond
            if len(std):
                largest = max(
                    std[n, min(max(after, 0), most), j], std[n, min(max(after - 1, 0), most), j]
                )
                within = max(within, rule.std_factor * largest)
            off[k, j] = within


# -- the cut to what bodies can do, as in ``reach`` ------------------------------------------------

_Xyz = tuple[float, float, float]


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
def _cut(mid: _Xyz, radius: float, centre: _Xyz, bound: float) -> tuple[_Xyz, float]:
    """Cut a sphere to another one, unless it is already inside."""
    x, y, z = centre[0] - mid[0], centre[1] - mid[1], centre[2] - mid[2]
    square, room = x * x + y * y + z * z, bound - radius
    if room >= 0 and square <= room * room:
        return mid, radius
    on, within = _along(sqrt(square), radius, bound)
    return (mid[0] + on * x, mid[1] + on * y, mid[2] + on * z), within


@part
def _cut_by_motion(
    person: tuple[CapturedBodies, Rule, int],
    seen: tuple[Floats, Floats, Bools],
    until: Floats,
    spheres: tuple[Floats, Floats],
) -> None:
    """Cut a person's spheres, except for entry 0, to the limits of speed and acceleration."""
    bodies, rule, n = person
    last, joint_age, follows = seen
    mid, radius = spheres
    history, measured, reach = bodies.history, bodies.measured, rule.reach
    fastest, burst, sustained = reach.speed, reach.burst, reach.sustained
    now, step_s, calibrated = measured.shape[1] - 1, 1.0 / rule.rate_hz, rule.calibrated
    then, per_s = now - VELOCITY_STEPS, reach.rate_hz / VELOCITY_STEPS
    for j in range(len(follows)):
        if not (calibrated or follows[j]) or (
            calibrated and follows[j] and bodies.inferred[n, j] > 0.0
        ):
            continue
        known = then >= 0 and measured[n, now, j] and measured[n, then, j]
        x = y = z = 0.0
        if known:
            x = (history[n, now, j, 0] - history[n, then, j, 0]) * per_s
            y = (history[n, now, j, 1] - history[n, then, j, 1]) * per_s
            z = (history[n, now, j, 2] - history[n, then, j, 2]) * per_s
        speed, start = _size(x, y, z), (last[j, 0], last[j, 1], last[j, 2])
        for k in range(1, len(until)):
            t = until[k]
            around = radius[k, j] if follows[j] else UNBOUNDED_M
            at, around = _cut(
                (mid[k, j, 0], mid[k, j, 1], mid[k, j, 2]),
                around,
                start,
                fastest[j] * (t + joint_age[j]),
            )
            if known:
                since = max(t - step_s, 0.0)
                middle, half = 0.5 * (since + t), 0.5 * (t - since)
                change = (burst[j] + 0.5 * sustained[j] * t) * t
                on = (start[0] + x * middle, start[1] + y * middle, start[2] + z * middle)
                at, around = _cut(at, around, on, change + speed * half)
            mid[k, j, 0], mid[k, j, 1], mid[k, j, 2] = at
            radius[k, j] = around


@part
def _bones(seen: tuple[Floats, Floats], inferred: Floats, rule: Rule, bone: Floats) -> None:
    """Fill (J,) with the maximum distance of each joint from its parent."""
    last, joint_age = seen
    order, parents, longest = rule.reach.order, rule.reach.parents, rule.reach.bone
    for j in order:
        of, fresh = parents[j], joint_age[j] < FRESH_S
        bone[j] = longest[j] if fresh or rule.calibrated else inf
        if fresh and joint_age[of] < FRESH_S:
            x, y = last[j, 0] - last[of, 0], last[j, 1] - last[of, 1]
            apart = _size(x, y, last[j, 2] - last[of, 2])
            bone[j] = (apart + inferred[j] + inferred[of]) * BONE_FACTOR + BONE_MARGIN_M


@part
def _cut_by_bones(tree: tuple[Ints, Ints], bone: Floats, mid: Floats, radius: Floats) -> None:
    """Cut all joints' spheres, except for entry 0, from the root outwards."""
    order, parents = tree
    for k in range(1, len(radius)):
        for j in order:
            of = parents[j]
            at, radius[k, j] = _cut(
                (mid[k, j, 0], mid[k, j, 1], mid[k, j, 2]),
                radius[k, j],
                (mid[k, of, 0], mid[k, of, 1], mid[k, of, 2]),
                radius[k, of] + bone[j],
            )
            mid[k, j, 0], mid[k, j, 1], mid[k, j, 2] = at
