"""Adds unseen joints to a snapshot.

Tracks hold only measured joints: identity, posture, size, repeats and the speeds of lost people are
based on these. Inferred joints are added here, for the predictor and the risk stage.
"""

from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hri_predict.base.arrays import Bools, Floats, Ints
from hri_predict.base.skeleton import JOINTS
from hri_predict.people.body.body_model import LEAST_JOINTS
from hri_predict.people.body.inferred import Filled, Inference
from hri_predict.people.snapshot import Inferred, LostPerson, PeopleSnapshot, RecentCaptures

PER_S = 1.5
"""Growth of a carried joint's error in metres per second: holds for 99 % of shoulders and hips up
to 0.5 s, carried by the head or the arms, in the recordings of the data pack (fit and test,
including people who run, dance and jump)."""
LONGEST_S = 0.3
"""Maximum time for which a pair is carried."""
_PAIRS = tuple(
    np.array([JOINTS.index(f"{side}_{joint}") for side in ("l", "r")])
    for joint in ("shoulder", "hip")
)
_HEAD = np.array([JOINTS.index(name) for name in ("head", "head_top")])


class Carried(NamedTuple):
    """Bodies with carried joints: positions (P, T, J, 3), whether joints are seen or carried (P, T,
    J), and (P, T, J) maximum error of a carried joint in metres; 0 for all others."""

    positions: Floats
    observed: Bools
    within_m: Floats


def carry(positions: Floats, measured: Bools, rate_hz: float) -> Carried:
    """Carry the last seen pair through steps without a complete pair.

    Without both shoulders or both hips a body has no heading, and hidden joints cannot be inferred.
    A tracker loses a shoulder for a few captures at a time, so the last seen pair is used instead,
    moved as the head, or all seen joints, have moved since. If little else of the body is seen, no
    pair is carried.

    Args:
        positions: (P, T, J, 3) metres, finite, in the room; any value where not measured.
        measured: (P, T, J).
        rate_hz: steps per second.
    """
    found = Carried(positions.copy(), measured.copy(), np.zeros(measured.shape))
    whole = np.stack([measured[..., pair].all(-1) for pair in _PAIRS], axis=-1)  # (P, T, 2)
    step = np.arange(measured.shape[1])[:, None]
    last = np.maximum.accumulate(np.where(whole, step, -1), axis=1)
    age_s = (step - last) / rate_hz
    due = ~whole.any(-1) & (measured.sum(-1) >= LEAST_JOINTS)
    newest = last.argmax(-1)  # the shoulders, if both were seen then
    for number, pair in enumerate(_PAIRS):
        carries = due & (newest == number) & (last[..., number] >= 0)
        carries &= age_s[..., number] <= LONGEST_S + 1e-9
        turned = _turned(positions, whole[..., number], pair)
        for person, at in np.argwhere(carries):
            since = last[person, at, number]
            if turned[person, since]:
                continue
            shift = _shift(positions[person], measured[person], since, at)
            if shift is None:
                continue
            missing = pair[~measured[person, at, pair]]
            found.positions[person, at, missing] = positions[person, since, missing] + shift
            found.observed[person, at, missing] = True
            found.within_m[person, at, missing] = PER_S * age_s[person, at, number]
    return found


def _turned(positions: Floats, whole: Bools, pair: NDArray[np.intp]) -> Bools:
    """Return (P, T) whether a pair points in the opposite direction of one or two steps before:
    left and right were swapped in one of them, and the body would be completed back to front."""
    across = positions[:, :, pair[0]] - positions[:, :, pair[1]]
    found = np.zeros_like(whole)
    for lag in (1, 2):
        against = np.einsum("pti,pti->pt", across[:, lag:], across[:, :-lag]) < 0
        found[:, lag:] |= whole[:, lag:] & whole[:, :-lag] & against
    return found


def _shift(positions: Floats, measured: Bools, since: int, at: int) -> Floats | None:
    """Return (3,) motion of a body (T, J, 3) between two steps; ``None``: no common joint."""
    both = measured[since] & measured[at]
    head = both[_HEAD]
    of = _HEAD[head] if head.any() else np.flatnonzero(both)
    if not of.size:
        return None
    moved: Floats = (positions[at, of] - positions[since, of]).mean(0)
    return moved


_GAIN = 2.2
"""Maximum speed of an inferred joint relative to the fastest seen joint: the crown's position is
1.6 times the head minus 0.6 times the neck."""
_KEPT_S = 0.5
"""Time constant with which a joint's last measured offset from its inferred position decays: its
recent position is more informative than the posture."""
_STEPS_BEFORE, _LEAST_BEFORE, _SETTLED_BEFORE = 12, 2, 4
"""The recent position is trusted if the joint was known in two of the steps before. A single
capture that shows a hidden arm is as often the other arm or part of a bench: then the posture may
be right, and the joint may be in either position. With four, the joint is still near: see
``RECENT_M_S``."""
_CHANGE_STEPS = 4
"""Number of steps over which a change of position counts as uncertainty."""
RECENT_M_S = 1.0
"""Increase of the speed at which a hidden joint may leave its continued position, over its last
speed on the body."""
_SPEED_STEPS = slice(2, 6)
"""Lags, from 1, over which that speed is measured: over fewer steps, noise looks like speed."""
HIDDEN_ARM = 1.5
"""Factor on the posture's uncertainty for an arm that stays hidden from the elbow on. It is often
hidden because it reaches into something, which the posture does not show. More than one in a
hundred of its joints were outside the plain radius in one of four recordings, and outside the
enlarged radius in one of a hundred (docs/measured/unseen-joints.md)."""
_ELBOW_SHOWN = 0.5
"""Minimum share of a body's steps in which the elbow must be seen for the posture to show the
forearm, unless the elbow is seen now."""
_ARMS = tuple(
    [JOINTS.index(f"{side}_{joint}") for joint in ("elbow", "wrist", "hand")] for side in "lr"
)


def with_inferred(snapshot: PeopleSnapshot, inference: Inference, rate_hz: float) -> PeopleSnapshot:
    """Return the snapshot with its inferred joints; see ``PeopleSnapshot.inferred``.

    Args:
        snapshot: snapshot of measured joints.
        inference: inference of joints, see ``body.inferred``.
        rate_hz: steps per second of the history.
    """
    lost = tuple(_lost(person, inference) for person in snapshot.lost)
    measured = snapshot.observed
    if measured.all():
        return replace(snapshot, lost=lost) if lost else snapshot
    carried = carry(snapshot.history, measured, rate_hz)
    arms = hidden_arms(measured)
    filled = _by_carried(inference.fill(carried.positions, carried.observed), carried)
    filled = _continued(filled, inference, measured, rate_hz=rate_hz, carried=carried)
    held = _held(filled, measured)
    held.within_m[:, -1] *= np.where(arms, HIDDEN_ARM, 1.0)
    joints: Bools = np.asarray(held.observed[:, -1] & ~measured[:, -1])
    newest = held.positions[:, -1]
    recent, shown = snapshot.recent, np.asarray(measured[:, -1])
    if recent is not None:
        shown = np.asarray(recent.observed.any(1))
        completed = inference.fill(recent.positions, recent.observed)
        new = completed.observed & ~shown[:, None]
        recent = RecentCaptures(
            recent.age_s,
            np.where(new[..., None], completed.positions, recent.positions),
            recent.observed | new,
        )
    return replace(
        snapshot,
        history=held.positions,
        observed=held.observed,
        last_positions=np.where(joints[..., None], newest, snapshot.last_positions),
        joint_age_s=np.where(joints, 0.0, snapshot.joint_age_s),
        lost=lost,
        recent=recent,
        inferred=Inferred(joints, np.where(joints, held.within_m[:, -1], 0.0), measured, shown),
    )


def hidden_arms(measured: Bools) -> Bools:
    """Return (P, J) joints of arms that are hidden from the elbow on in a history (P, T, J).

    One capture that shows such an arm does not count: see ``_LEAST_BEFORE``. Nor do glimpses of the
    elbow show where wrist and hand are: see ``_ELBOW_SHOWN``.
    """
    least = min(_LEAST_BEFORE, measured.shape[1])
    steps = measured.any(2).sum(1)  # (P,)
    found = np.zeros((len(measured), measured.shape[2]), bool)
    for arm in _ARMS:
        shown: Bools = np.asarray(measured[:, :, arm].any(2))
        never = shown.sum(1) < least
        seldom = ~shown[:, -1] & (shown.sum(1) < _ELBOW_SHOWN * steps)
        outer = measured[:, :, arm[1:]].any(2).sum(1) < least
        found[:, arm[0]] = never
        found[:, arm[1:]] = (outer & (never | seldom))[:, None]
    return found


def _by_carried(filled: Filled, carried: Carried) -> Filled:
    """Return inferred joints, including the uncertainty of the carried joints used."""
    inferred = filled.observed & ~carried.observed
    by_others = np.where(inferred, carried.within_m.max(-1, keepdims=True), 0.0)
    return filled._replace(within_m=filled.within_m + carried.within_m + by_others)


def _continued(
    filled: Filled, inference: Inference, measured: Bools, *, rate_hz: float, carried: Carried
) -> Filled:
    """Return inferred positions that connect to the known ones before and after them.

    A joint that is suddenly hidden would jump to its inferred position, and a predictor would treat
    this as motion. The offset of the inferred position is known where the joint was last measured
    and where it is next; of a joint that is never measured, where a rule gives its position. Within
    a gap, both offsets are weighted by nearness in time; at an end of the history, the only offset
    decays. The last offset is as uncertain as the change of the joint's position on the body in the
    steps before, or fully uncertain if the joint was known only once. A joint that was hidden just
    now is still near: see ``RECENT_M_S``.
    """
    known = measured | filled.by_rule & ~measured.any(1, keepdims=True)
    steps = known.shape[1]
    step, hidden = np.arange(steps)[:, None], ~known
    last = np.maximum.accumulate(np.where(known, step, -1), axis=1)  # (P, T, J)
    next_ = np.minimum.accumulate(np.where(known, step, steps)[:, ::-1], axis=1)[:, ::-1]
    edge = np.zeros_like(known)  # known, and hidden in the step before or after
    edge[:, :-1] |= hidden[:, 1:]
    edge[:, 1:] |= hidden[:, :-1]
    edge &= known
    if not edge.any():  # a bench hides the same joints all the time
        return filled
    rows = np.nonzero(edge.any(-1))
    there = inference.fill(filled.positions[rows], measured[rows] & ~edge[rows])
    edge[rows] &= there.observed
    off = np.zeros_like(filled.positions)
    off[rows] = filled.positions[rows] - there.positions
    off[~edge] = 0.0
    since, until = (step - last) / rate_hz, (next_ - step) / rate_hz
    before, after = last >= 0, next_ < steps
    share = np.where(before & after, until / np.maximum(since + until, 1e-9), 0.0)
    first = np.where(before & ~after, np.exp(-since / _KEPT_S), share)
    second = np.where(after & ~before, np.exp(-until / _KEPT_S), before * after - share)
    seen_last, next_ = np.maximum(last, 0), np.minimum(next_, steps - 1)
    of_last = np.take_along_axis(off, seen_last[..., None], axis=1)
    add = first[..., None] * of_last
    add += second[..., None] * np.take_along_axis(off, next_[..., None], axis=1)
    inferred = filled.observed & ~carried.observed & hidden
    unsure_m = first * np.linalg.norm(of_last, axis=-1)
    unsure_m[:, -1] = 0.0  # of the newest step the zones are made
    found = filled._replace(
        positions=np.where(inferred[..., None], filled.positions + add, filled.positions),
        within_m=np.where(inferred, filled.within_m + unsure_m, filled.within_m),
    )
    now_m = _within_now(
        filled, known, carried, last=last[:, -1], off=of_last[:, -1], tied=edge, rate_hz=rate_hz
    )
    found.within_m[:, -1] = np.where(inferred[:, -1], now_m, filled.within_m[:, -1])
    return found


def _within_now(
    filled: Filled,
    known: Bools,
    carried: Carried,
    *,
    last: Ints,
    off: Floats,
    tied: Bools,
    rate_hz: float,
) -> Floats:
    """Return (P, J) maximum errors of the newest continued positions, in metres.

    Args:
        filled, carried: bodies (P, T, J).
        known: (P, T, J) see ``_continued``.
        last: (P, J) last known step; -1: none.
        off: (P, J, 3) offset of the inferred position there.
        tied: (P, T, J) whether offsets are known.
        rate_hz: steps per second.
    """
    since_s = (known.shape[1] - 1 - last) / rate_hz
    kept = np.where(last >= 0, np.exp(-since_s / _KEPT_S), 0.0)
    off_m, at = np.linalg.norm(off, axis=-1), np.maximum(last, 0)
    before = _before(filled.positions, known, at, rate_hz)
    unsure_m = np.where(before.known >= _LEAST_BEFORE, before.changed_m, off_m)
    by_posture_m = filled.within_m[:, -1] + kept * unsure_m
    carried_m = carried.within_m.max(-1, keepdims=True)
    recent_m = before.changed_m + since_s * (RECENT_M_S + before.speed_m_s)
    recent_m += (1.0 - kept) * off_m + _at(filled.within_m + carried_m, at) + carried_m[:, -1]
    is_recent = (before.known >= _SETTLED_BEFORE) & _at(tied, at)
    return np.where(is_recent, np.minimum(by_posture_m, recent_m), by_posture_m)


class _Before(NamedTuple):
    """Joints (P, J) in the steps before the last known one: number of steps in which they were
    known, how far they moved since, and how fast, in metres and m/s relative to the body."""

    known: Ints
    changed_m: Floats
    speed_m_s: Floats


def _before(positions: Floats, known: Bools, last: Ints, rate_hz: float) -> _Before:
    """Describe joints before step ``last`` (P, J); positions (P, T, J, 3) and known (P, T, J)."""
    on_body = positions - _body_path(positions, known)[:, :, None]
    lags = np.arange(1, _STEPS_BEFORE + 1)[:, None]
    at = last[:, None] - lags
    there = (at >= 0) & np.take_along_axis(known, np.maximum(at, 0), axis=1)  # (P, lags, J)
    places = np.take_along_axis(on_body, np.maximum(at, 0)[..., None], axis=1)
    newest = np.take_along_axis(on_body, last[:, None, :, None], axis=1)
    far_m = np.where(there, np.linalg.norm(newest - places, axis=-1), 0.0)
    nearest = there.argmax(1)
    jump_m = _at(far_m, nearest)
    speeds = (far_m * rate_hz / lags)[:, _SPEED_STEPS]
    speed_m_s = np.maximum(
        speeds.max(1), jump_m * rate_hz / (nearest + 1) * ~there[:, _SPEED_STEPS].any(1)
    )
    changed_m = np.maximum(far_m[:, :_CHANGE_STEPS].max(1), jump_m)
    return _Before(there.sum(1), changed_m, speed_m_s)


def _body_path(positions: Floats, known: Bools) -> Floats:
    """Return (P, T, 3) the mean motion of the known joints since the first step."""
    both = known[:, 1:] & known[:, :-1]
    moved = np.where(both[..., None], np.diff(positions, axis=1), 0.0).sum(2)
    path = np.zeros((*positions.shape[:2], 3))
    path[:, 1:] = np.cumsum(moved / np.maximum(both.sum(2), 1)[..., None], axis=1)
    return path


def _at(values: Any, step: Ints) -> Any:
    """Return ``values`` (P, T, J) at each joint's step (P, J)."""
    return np.take_along_axis(values, step[:, None], axis=1)[:, 0]


def _held(filled: Filled, measured: Bools) -> Filled:
    """Keep joints that are no longer inferred at their last position, in (P, T, ...)."""
    lacks = ~filled.observed
    if not lacks.any():
        return filled
    step = np.arange(filled.observed.shape[1])[:, None]
    newest = np.maximum.accumulate(np.where(filled.observed, step, -1), axis=1)
    never = newest < 0
    newest = np.where(never | measured, step, newest)
    return filled._replace(
        positions=np.take_along_axis(filled.positions, newest[..., None], axis=1),
        within_m=np.take_along_axis(filled.within_m, newest, axis=1),
    )


def _lost(person: LostPerson, inference: Inference) -> LostPerson:
    """Return a lost person with the joints that can be inferred from the last capture."""
    newest: Bools = person.joint_age_s <= person.joint_age_s.min()
    filled = inference.fill(np.nan_to_num(person.positions), newest)
    seen: Bools = filled.observed & ~newest
    within = filled.within_m * np.where(hidden_arms(newest[None, None])[0], HIDDEN_ARM, 1.0)
    fastest: Floats = person.limbs_m_s[newest].max(initial=0.0)
    return replace(
        person,
        positions=np.where(seen[:, None], filled.positions, person.positions),
        joint_age_s=np.where(seen, person.joint_age_s.min(), person.joint_age_s),
        limbs_m_s=np.where(seen, np.maximum(person.limbs_m_s, _GAIN * fastest), person.limbs_m_s),
        inferred_m=np.where(seen, within, 0.0),
    )
