"""Checks for joints that were never seen, and for coordinates that are not positions in a room."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from hri_predict.base.arrays import Bools, Floats
from hri_predict.base.errors import RecordingError
from hri_predict.base.skeleton import JOINTS
from hri_predict.contracts.scene import Person
from hri_predict.people.body.relative import hips_are_origin
from hri_predict.people.body.stature import is_adult, stature_m
from hri_predict.people.body.unseen import at_origin, contradicts, out_of_reach
from hri_predict.recording.plausibility import judged
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
    far: Bools = observed & (single @ out_of_reach(joints, seen)[0] > 0)
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


KINDS = ("csv", "npy")
_SHALLOW = 0.02
"""Depth of the hips' midpoint per size of the body in the picture: the origin, with rounding."""
_MOST = 0.95
"""Share of the judged frames that must match."""
_PAIRS = [[JOINTS.index(f"{side}_{part}") for side in "lr"] for part in ("hip", "shoulder")]


def check_not_picture(recording: Recording) -> None:
    """Refuse image landmarks: image coordinates with a depth relative to the hips.

    MediaPipe's ``pose_landmarks`` (normalised, or times the picture's size) have x to the right and
    y down in the image, and z "with the midpoint of hips as the origin" (MediaPipe, "Pose landmark
    detection guide", output). No unit makes them a person's place in the room.

    Raises:
        RecordingError: one line with the remedy.
    """
    if recording.kind not in KINDS:
        return
    found = []
    for scene in judged(recording):
        for person in scene.people:
            raw = person.positions @ recording.joint_map.rotation
            joints, seen = recording.joint_map.map(raw, person.observed)
            if not seen[_PAIRS].all():
                continue
            hips, shoulders = joints[_PAIRS].mean(axis=1)
            size = float(np.ptp(joints[seen][:, :2], axis=0).max())
            below = hips[1] - shoulders[1] > 0.1 * size
            aside = np.abs(hips[:2]).max() > 0.1 * size  # or else the hips are the origin
            found.append(bool(below and aside and abs(hips[2]) < _SHALLOW * size))
    if found and np.mean(found) >= _MOST:
        raise RecordingError(
            f"recording {recording.path}: its coordinates are those of a picture (x and y in the "
            f"image, depth from the hips), which hold no place in the room; record positions in "
            f"metres: a depth camera's, or triangulated ones"
        )


WINDOW_S = 2.0


def check_relative(recording: Recording) -> None:
    """Refuse a recording whose origin is between the hips; see ``people.body.relative``.

    Raises:
        RecordingError: one line with the remedy.
    """
    if recording.kind in SYNTHETIC:
        return
    origin = np.array([0.0, 0.0, -recording.floor_m])
    stamps, positions, observed = _first_person(recording)
    if _relative(stamps, positions, observed, origin):
        raise RecordingError(
            f"recording {recording.path}: its coordinates are relative to the hips, which stay in "
            f"place while the body moves; export positions in the room (MediaPipe's world landmarks"
            f" have none)"
        )


def _first_person(recording: Recording) -> tuple[Floats, Floats, Bools]:
    """Stamps (n,) s, canonical joints (n, J, 3) and (n, J) of the first person in the recording."""
    number = next((p.id for scene in recording.scenes for p in scene.people), None)
    seen = [(s.stamp_ns, p) for s in recording.scenes for p in s.people if p.id == number]
    stamps = np.array([stamp * 1e-9 for stamp, _ in seen])
    if not seen:
        return stamps, np.zeros((0, 0, 3)), np.zeros((0, 0), np.bool_)
    raw = np.stack([p.positions for _, p in seen]), np.stack([p.observed for _, p in seen])
    return stamps, *recording.joint_map.map(*raw)


def _relative(stamps: Floats, positions: Floats, observed: Bools, origin: Floats) -> bool:
    """Whether the hips are the origin in most windows.

    Never of a body of the wrong size: in a wrong unit the whole way lies about the origin.
    """
    stature = stature_m(list(zip(positions, observed, strict=True)))
    if stature is None or not is_adult(stature):
        return False
    found = []
    for start in np.arange(stamps[0], max(stamps[-1] - WINDOW_S, stamps[0]) + 1e-6, WINDOW_S):
        part = (stamps >= start) & (stamps < start + WINDOW_S)
        if part.any():
            found.append(hips_are_origin(positions[part], observed[part], origin))
    return 2 * sum(found) > len(found)
