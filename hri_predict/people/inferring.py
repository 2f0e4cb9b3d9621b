"""Completes a snapshot by the joints that the source never delivers.

Tracks hold measured joints alone: identity, posture, size, repeats and the speeds of lost people
rest on nothing else. Inferred joints appear here, in what the predictor and the risk stage read.
"""

from dataclasses import replace

import numpy as np

from hri_predict.base.arrays import Bools, Floats
from hri_predict.people.body.inferred import Filled, Inference
from hri_predict.people.snapshot import Inferred, LostPerson, PeopleSnapshot, RecentCaptures

_GAIN = 2.2
"""No inferred joint moves faster than this times the fastest joint that it rests on: the crown's
place weighs the head 1.6 times, less 0.6 times the neck."""


def with_inferred(snapshot: PeopleSnapshot, inference: Inference, rate_hz: float) -> PeopleSnapshot:
    """The snapshot with its inferred joints; see ``PeopleSnapshot.inferred``.

    An inferred joint is observed in a step in which all that it rests on is. Otherwise it stays
    where it was then, and its age goes on.

    Args:
        snapshot: of delivered joints.
        inference: for the source's joint map.
        rate_hz: steps per second of the history.
    """
    joints = inference.joints
    if not joints.any():
        return snapshot
    filled = inference.fill(snapshot.history, snapshot.observed)
    held = _held(filled, joints)
    seen = filled.observed.any(1) & joints
    steps = snapshot.history.shape[1]
    behind = filled.observed[:, ::-1].argmax(1)  # (P, J) steps since it was seen
    recent = snapshot.recent
    if recent is not None:
        completed = inference.fill(recent.positions, recent.observed)
        recent = RecentCaptures(recent.age_s, completed.positions, completed.observed)
    return replace(
        snapshot,
        history=held.positions,
        observed=held.observed,
        last_positions=np.where(
            seen[..., None], held.positions[:, steps - 1], snapshot.last_positions
        ),
        joint_age_s=np.where(seen, behind / rate_hz, snapshot.joint_age_s),
        lost=tuple(_lost(person, inference) for person in snapshot.lost),
        recent=recent,
        inferred=Inferred(joints, np.where(seen, held.within_m[:, steps - 1], 0.0)),
    )


def _held(filled: Filled, joints: Bools) -> Filled:
    """Inferred joints stay where they were last seen in (P, T, ...)."""
    if filled.observed[..., joints].all():
        return filled
    step = np.arange(filled.observed.shape[1])[:, None]
    newest = np.maximum.accumulate(np.where(filled.observed, step, -1), axis=1)
    newest = np.where(joints, np.maximum(newest, 0), step)
    return Filled(
        np.take_along_axis(filled.positions, newest[..., None], axis=1),
        filled.observed,
        np.take_along_axis(filled.within_m, newest, axis=1),
    )


def _lost(person: LostPerson, inference: Inference) -> LostPerson:
    """A lost person with the joints that the last capture allows to infer."""
    newest: Bools = person.joint_age_s <= person.joint_age_s.min()
    filled = inference.fill(np.nan_to_num(person.positions), newest)
    seen = filled.observed & inference.joints
    anchors: Floats = np.where(inference.anchors, person.limbs_m_s, 0.0).max(1)
    return replace(
        person,
        positions=np.where(seen[:, None], filled.positions, person.positions),
        joint_age_s=np.where(seen, person.joint_age_s.min(), person.joint_age_s),
        limbs_m_s=np.where(seen, _GAIN * anchors, person.limbs_m_s),
        inferred_m=filled.within_m,
    )
