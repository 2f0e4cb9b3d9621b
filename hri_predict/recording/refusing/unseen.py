"""Removes joints from a recording that its tracker lost but still wrote as a position."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from hri_predict.base.arrays import Bools, Floats
from hri_predict.contracts.scene import Person
from hri_predict.people.body.unseen import at_origin, contradicts, out_of_reach
from hri_predict.recording.recording import Recording, noted

SYNTHETIC = ("cmu", "assembly", "mcap")
"""Kinds in which nothing is lost: layouts of the data pack, and what this node recorded, whose
scenes are in the room."""
_AT_ONCE = 500
Counts = NDArray[np.int64]


def without_unseen(recording: Recording) -> Recording:
    """Return the recording without joints that were never seen, and a note with their number.

    These are joints at exactly the file's origin, and joints farther from the rest of the body than
    bones can be; see ``people.body.unseen``.
    """
    if recording.kind in SYNTHETIC:
        return recording
    origin = np.array([0.0, 0.0, -recording.floor_m])
    single = _single(recording)
    counts = np.zeros(2, np.int64)
    scenes = list(recording.scenes)
    for k in _suspect(recording, origin):
        people = tuple(
            _cleared(recording, person, origin=origin, single=single, counts=counts)
            for person in scenes[k].people
        )
        scenes[k] = replace(scenes[k], people=people)
    if not counts.any():
        return recording
    texts = ("at exactly 0, 0, 0", "farther from the body than bones can be")
    found = [f"{n} {text}" for n, text in zip(counts, texts, strict=True) if n]
    return noted(replace(recording, scenes=scenes), f"joints taken as not seen: {', '.join(found)}")


def _suspect(recording: Recording, origin: Floats) -> list[int]:
    """Indices of the scenes with a joint at the origin, or with two that are too far apart."""
    rows = [(k, person) for k, scene in enumerate(recording.scenes) for person in scene.people]
    found: set[int] = set()
    for start in range(0, len(rows), _AT_ONCE):
        part = rows[start : start + _AT_ONCE]
        positions = np.stack([person.positions for _, person in part])
        observed = np.stack([person.observed for _, person in part])
        zero = observed & at_origin(positions, origin)
        joints, seen = recording.joint_map.map(positions, observed & ~zero)
        wrong = zero.any(axis=1) | contradicts(joints, seen)
        found.update(part[n][0] for n in np.flatnonzero(wrong))
    return sorted(found)


def _cleared(
    recording: Recording, person: Person, *, origin: Floats, single: Floats, counts: Counts
) -> Person:
    """The person without unseen joints, or the person itself; adds to ``counts``."""
    zero = person.observed & at_origin(person.positions, origin)
    observed = person.observed & ~zero
    joints, seen = recording.joint_map.map(person.positions, observed)
    far: Bools = observed & (single @ out_of_reach(joints, seen) > 0)
    if not (zero.any() or far.any()):
        return person
    counts += int(zero.sum()), int(far.sum())
    observed &= ~far
    return replace(
        person, positions=np.where(observed[:, None], person.positions, np.nan), observed=observed
    )


def _single(recording: Recording) -> Floats:
    """(J_source, J) 1 where a canonical joint is this source joint alone."""
    weights = recording.joint_map.weights > 0
    alone: Floats = (weights & (weights.sum(1, keepdims=True) == 1)).T.astype(np.float64)
    return alone
