"""Joint zones as array operations; see ``joint_zones`` for the rules."""

import numpy as np

from hri_predict.base.arrays import Bools, Floats
from hri_predict.zones.loops.spheres import (
    FAR_M,
    FRESH_S,
    LIMB_M,
    NEVER_S,
    UNBOUNDED_M,
    UNSEEN,
    Ahead,
    CapturedBodies,
    Rule,
    Spheres,
)
from hri_predict.zones.sphere_geometry import enclosed


def spheres_by_arrays(bodies: CapturedBodies, ahead: Ahead, rule: Rule) -> Spheres:
    """See ``JointSpheres``."""
    people = len(bodies.unknown)
    seen = (np.abs(bodies.last) < FAR_M).all(-1) & (bodies.joint_age >= 0)  # false for NaN too
    last = np.where(seen[..., None], bodies.last, 0.0)
    joint_age = np.where(seen, np.minimum(bodies.joint_age, NEVER_S), NEVER_S)
    bodies = bodies._replace(last=last, joint_age=joint_age)
    follows = _followed(bodies, ahead, rule)
    # a hidden joint of a person of unknown speed is within its reach of those that are seen
    hidden = bodies.unknown[:, None] & ~(joint_age[:people] < FRESH_S)
    speed = bodies.growth.copy()
    speed[:people] = np.where(hidden, rule.physical_m_s, speed[:people])
    until = bodies.age[:, None] + rule.times_s  # (N, K+1) seconds since capture
    until[:, 0] = bodies.waited
    unseen = until[..., None] + joint_age[:, None]
    growth = speed[:, None] * unseen
    growth += np.minimum(bodies.limbs[:, None] * unseen, LIMB_M)
    if not follows.any():
        shape = (*until.shape, last.shape[1], 3)
        path = np.broadcast_to(last[:, None], shape)
        inflation, around = growth, growth
    else:
        path, inflation = enclosed(_knots(last, follows, ahead, rule), until * rule.rate_hz)
        off = _deviation(until, ahead, rule)
        if ahead.judged:
            both = UNSEEN * np.sqrt(off**2 + bodies.inferred[:, None] ** 2)
            off[:, 1:] = np.where(bodies.inferred[:, None] > 0, both, off)[:, 1:]
        around = inflation + np.where(follows[:, None], off, growth)
        inflation = np.where(follows[:, None], inflation, inflation + growth)
    inferred = np.repeat(bodies.inferred[:, None], around.shape[1], axis=1)
    known = inferred.copy()  # what the radii hold already
    known[:, 1:] = np.where((follows & ahead.judged)[:, None], 0.0, inferred[:, 1:])
    if rule.calibrated or follows.any():
        mid, radius = _cut((path, around, known), bodies, follows, (until, rule))
    else:
        mid, radius = path, around + known
    return mid, radius, path, inflation + inferred, joint_age


def _followed(bodies: CapturedBodies, ahead: Ahead, rule: Rule) -> Bools:
    """Return (N, J) whether a joint follows the forecast."""
    people = len(bodies.unknown)
    follows = bodies.joint_age < FRESH_S
    follows[people:] = False
    if not ahead.given:
        return np.zeros_like(follows)
    if not ahead.judged:
        follows[:people] &= ~bodies.unknown[:, None]
        return follows
    # a joint without a radius, and a person out of distribution, have physical limits
    has = np.isfinite(ahead.claimed[:, : rule.trusted_steps]).all(1)
    follows[:people] &= has & ~ahead.outside[:, None]
    return follows


def _knots(last: Floats, follows: Bools, ahead: Ahead, rule: Rule) -> Floats:
    """Return (N, trusted steps + 1, J, 3) the forecast path from the capture on; other joints stay
    in place."""
    trusted = ahead.positions[:, : rule.trusted_steps]
    people = len(trusted)
    knots = np.repeat(last[:, None], rule.trusted_steps + 1, axis=1)
    moves = np.broadcast_to(follows[:people, None, :, None], trusted.shape)
    np.copyto(knots[:people, 1:], trusted, where=moves)
    return knots


def _deviation(until: Floats, ahead: Ahead, rule: Rule) -> Floats:
    """Return (N, K+1, J) largest distance from the forecast by each interval's end (N, K+1),
    metres."""
    end = rule.trusted_steps / rule.rate_hz
    beyond = rule.physical_m_s * np.maximum(until - end, 0.0)[..., None]
    people, steps = len(ahead.positions), until * rule.rate_hz
    if not ahead.judged:
        t = np.minimum(until, end)[..., None]
        free = (0.5 * rule.acceleration * t + rule.velocity_error_m_s) * t
        within = np.minimum(rule.speed * t, free)
    else:
        table = ahead.claimed * ahead.widen[..., None]
        at = np.ceil(steps[:people] - 1e-6).astype(np.intp) - 1  # the step that ends it
        person = np.arange(people)[:, None]
        here = table[person, np.minimum(np.maximum(at, 0), rule.trusted_steps - 1)]
        within = np.zeros((*until.shape, here.shape[-1]))
        within[:people] = here
    off: Floats = within + beyond
    if len(ahead.std):
        std = _std_during(ahead.std, steps, rule.horizon_steps)
        off[:people] = np.maximum(off[:people], rule.std_factor * std)
    off[:, 0] = 0.0
    return off


def _std_during(std: Floats, steps: Floats, horizon_steps: int) -> Floats:
    """Convert (P, H, J) at the forecast's steps to the largest (P, K+1, J) during each interval."""
    people = len(std)
    person = np.arange(people)[:, None]
    end = np.ceil(steps[:people]).astype(np.intp)  # forecast step k is at (k + 1)
    after = std[person, np.clip(end - 1, 0, horizon_steps - 1)]
    before = std[person, np.clip(end - 2, 0, horizon_steps - 1)]
    return np.maximum(after, before)


def _cut(
    spheres: tuple[Floats, Floats, Floats],
    bodies: CapturedBodies,
    follows: Bools,
    when: tuple[Floats, Rule],
) -> tuple[Floats, Floats]:
    """Cut zones to the physical limits; entry 0 stays as captured.

    With a calibration, only this cut bounds a joint without a radius, because zones at the
    standard's speeds hold fewer bodies than calibrated zones. Without a calibration, joints without
    a forecast keep the standard's speeds.
    """
    mid, radius, more = spheres
    until, rule = when
    people = len(bodies.unknown)
    inferred, last = bodies.inferred[:people], bodies.last[:people]
    begin = np.maximum(until[:people, 1:] - 1.0 / rule.rate_hz, 0.0)
    age, follows = bodies.joint_age[:people], follows[:people, None]
    around = radius[:people, 1:]
    if rule.calibrated:
        around = np.where(follows, around, UNBOUNDED_M)
    own_mid, own = rule.reach.cut_by_motion(
        mid[:people, 1:],
        around,
        last=last,
        velocity=rule.reach.velocity(bodies.history, bodies.measured),
        since=begin,
        until=until[:people, 1:],
        joint_age=age,
    )
    if rule.calibrated:
        blind = follows & (inferred[:, None] > 0)
        own_mid = np.where(blind[..., None], mid[:people, 1:], own_mid)
        own = np.where(blind, around, own)
    else:
        own_mid = np.where(follows[..., None], own_mid, mid[:people, 1:])
        own = np.where(follows, own, around)
    cut = rule.reach.cut_by_bones(
        own_mid,
        own + more[:people, 1:],
        inferred=inferred,
        last=last,
        seen=age < FRESH_S,
        all_joints=rule.calibrated,
    )
    mid, radius = mid.copy(), radius + more
    mid[:people, 1:], radius[:people, 1:] = cut
    return mid, radius
