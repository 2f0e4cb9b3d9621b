"""A recording as arrays at one rate, for formats that hold only frames of joints.

These formats cannot distinguish "the room is empty" from "not seen". Both become unobserved joints,
the cautious choice, and are counted. So do people in scenes that their source doubted.
"""

from collections import Counter
from dataclasses import dataclass, field, replace
from itertools import pairwise

import numpy as np

from hri_predict.base.arrays import Floats
from hri_predict.base.errors import RecordingError
from hri_predict.recording.bounded import check_joints
from hri_predict.recording.cutting import of_person, people_of, true_times
from hri_predict.recording.recording import Recording


@dataclass(frozen=True)
class Written:
    """The result of writing a recording.

    Attributes:
        frames: number of frames written.
        people: ids of the people in them.
        dropped: data that the format cannot hold: a plural noun and a count.
        notes: further notes for the user, one line each.
        joints: number of joints written; ``None``: all that the recording has.
    """

    frames: int
    people: list[int]
    dropped: Counter[str] = field(default_factory=Counter)
    notes: list[str] = field(default_factory=list)
    joints: int | None = None


@dataclass(frozen=True, eq=False, kw_only=True)
class Frames:
    """Frames at an even rate.

    Attributes:
        rate_hz: frames per second.
        ids: ids of the people.
        joints: names of the joints.
        positions: (F, P, J, 3) metres, x forward, y left, z up; NaN where not observed.
        written: losses so far.
    """

    rate_hz: float
    ids: tuple[int, ...]
    joints: tuple[str, ...]
    positions: Floats
    written: Written


def frames_of(recording: Recording) -> Frames:
    """Return all people of a recording in even frames; missing frames have no joints.

    Raises:
        RecordingError: it shows no person outside scenes in doubt, or is too long for the
            memory.
    """
    recording = _without_doubted(recording)
    ids = people_of(recording)
    if not ids:
        raise RecordingError(
            f"recording {recording.path}: shows no person without doubt; this format holds only "
            f"people: choose .csv or .mcap"
        )
    slots, rate_hz = _slots(recording)
    joints = recording.joint_map.source_joints
    check_joints(recording.path, slots[-1] + 1, len(ids), len(joints))
    positions = np.full((slots[-1] + 1, len(ids), len(joints), 3), np.nan)
    written = Written(slots[-1] + 1, ids)
    column = {person: k for k, person in enumerate(ids)}
    for slot, scene in zip(slots, recording.scenes, strict=True):
        for person in scene.people:
            seen = person.observed & np.isfinite(person.positions).all(axis=-1)
            positions[slot, column[person.id]] = np.where(seen[:, None], person.positions, np.nan)
        if scene.sees_room:
            written.dropped["absences of a person"] += len(ids) - len(scene.people)
        elif not scene.doubts:
            written.dropped["scenes of a blind source"] += 1
    empty = slots[-1] + 1 - len(slots)
    if empty:
        written.notes.append(f"{empty} frames are missing in the recording; they have no joints")
    written.dropped["messages of controllers"] += len(recording.received)
    if len(ids) == 1 and ids[0] != 1:
        written.notes.append(
            f"the file does not store that this is person {ids[0]}: give --person when reading it"
        )
    return Frames(
        rate_hz=rate_hz, ids=tuple(ids), joints=joints, positions=positions, written=written
    )


def frames_of_one(recording: Recording) -> Frames:
    """As ``frames_of``, for formats of one person: the person in the most scenes.

    Raises:
        RecordingError: see ``frames_of``.
    """
    recording = _without_doubted(recording)
    counts = Counter(person.id for scene in recording.scenes for person in scene.people)
    others = 0
    if counts:
        recording, others = of_person(recording, min(counts, key=lambda n: (-counts[n], n)))
    frames = frames_of(recording)
    if others:
        frames.written.dropped["other people"] += others
        frames.written.notes.append(
            f"the format holds one person: {frames.ids[0]} is written; choose with --person"
        )
    return frames


def _without_doubted(recording: Recording) -> Recording:
    """Return the recording without the people in scenes that their source doubted.

    A frame cannot say that its people are in doubt, and a replay would rely on them.
    """
    scenes = [
        replace(scene, people=(), sees_room=False) if scene.doubts else scene
        for scene in recording.scenes
    ]
    return replace(recording, scenes=scenes)


def _slots(recording: Recording) -> tuple[list[int], float]:
    """Return the increasing frame number of each scene, and the frame rate in Hz."""
    times_ns = true_times(recording)
    nominal = recording.rate_hz
    steps = [max(1, round((b - a) * 1e-9 * nominal)) for a, b in pairwise(times_ns)]
    counted = [0, *np.cumsum(steps, dtype=np.int64).tolist()]
    even = [round((ns - times_ns[0]) * 1e-9 * nominal) for ns in times_ns]
    if all(a < b for a, b in pairwise(even)) and abs(even[-1] - counted[-1]) < 1:
        return even, nominal
    # The source's true rate differs from its nominal one: count the periods in each step.
    span_s = (times_ns[-1] - times_ns[0]) * 1e-9
    return counted, counted[-1] / span_s if span_s > 0 else nominal
