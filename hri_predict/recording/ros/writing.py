"""Writes a recording as a ROS 2 bag: the people and the node's output.

Topics are those of the ROS 2 link with ``/recorded`` before them, so a bag played near a live cell
does not reach robots that listen to the link: a recorded *clear* is not advice.
"""

import heapq
import json
import os
from collections.abc import Iterator
from operator import itemgetter
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from hri_predict.base.errors import RecordingError
from hri_predict.contracts.scene import Person
from hri_predict.protocol.ros.bodies import IDS_PER_BODY, MARKER_ARRAY, MAX_PEOPLE
from hri_predict.protocol.ros.cdr import Point, string
from hri_predict.protocol.ros.link_topics import Topics, type_of
from hri_predict.protocol.ros.markers import people_markers
from hri_predict.protocol.ros.messages import typestore
from hri_predict.protocol.ros.plain import Sample
from hri_predict.recording.bounded import WRITING, watched
from hri_predict.recording.cutting import people_of, true_times
from hri_predict.recording.frames import Written
from hri_predict.recording.mcap.info import RecordingInfo
from hri_predict.recording.mcap.messages import Told
from hri_predict.recording.recording import Recording
from hri_predict.recording.ros.about import ABOUT, PEOPLE, PREFIX, STRING
from hri_predict.recording.ros.outputs import Outputs

ROOM, OWN = "room", "recording"
"""Frames of scenes in the room, and of those in a motion file's own frame."""
BEGIN_NS = 86_400 * 10**9
"""Start time of a bag without UTC: stamps of zero would mean missing stamps."""
_TOPICS = Topics("/hri", {})


def write_bag_mcap(path: Path, recording: Recording) -> Written:
    """Write an ``.mcap`` of ROS 2; see ``write_bag``."""
    return write_bag(path, recording, "mcap")


def write_bag_sqlite(path: Path, recording: Recording) -> Written:
    """Write a ``.db3`` of ROS 2; see ``write_bag``."""
    return write_bag(path, recording, "sqlite3")


def write_bag(path: Path, recording: Recording, storage: str) -> Written:
    """Write people by their captures, and the node's output by the times of its ticks.

    Scenes of a source that did not see the room are left out, since a message without people would
    say that the room is empty: a replay finds a gap, and says *unknown*.

    Raises:
        ConfigError: rosbags is not installed.
        RecordingError: bodies have too many joints, or scenes too many people.
        OSError: it cannot be written.
    """
    store = typestore("jazzy")  # says what is missing
    from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer

    _check(recording)
    people = people_of(recording)
    written = Written(len(recording.scenes), people)
    frame_id = ROOM if recording.in_room else OWN
    clock = _Clock(recording)
    outputs = Outputs(recording, frame_id, clock.of_message, written.dropped)
    with TemporaryDirectory(dir=path.parent, prefix=f".{path.name}.") as folder:
        writer = Writer(
            Path(folder) / "bag", version=9, storage_plugin=StoragePlugin[storage.upper()]
        )
        if storage == "mcap":
            writer.set_compression(CompressionMode.STORAGE, CompressionFormat.ZSTD)
        connections: dict[str, Any] = {}
        with writer:
            for at_ns, (topic, data), kind in _all(recording, clock, outputs, written):
                if topic not in connections:
                    connections[topic] = writer.add_connection(topic, kind, typestore=store)
                writer.write(connections[topic], at_ns, data)
        (found,) = Path(folder, "bag").glob("bag.*")
        os.replace(found, path)
    _say(recording, outputs, written)
    return written


class _Clock:
    """Converts times of a recording to times of the bag: UTC if known."""

    def __init__(self, recording: Recording) -> None:
        self._utc = bool(recording.utc_ns)
        self._shift_ns = BEGIN_NS - recording.arrival_ns[0]
        times = true_times(recording)
        arrivals = recording.utc_ns or [ns + self._shift_ns for ns in recording.arrival_ns]
        offset_ns = min(a - t for a, t in zip(arrivals, times, strict=True))
        self.captures_ns = [ns + offset_ns for ns in times]

    def of_message(self, told: Told) -> int:
        """Time of a recorded message, ns."""
        return max(told.utc_ns if self._utc else told.node_ns + self._shift_ns, 0)


Stored = tuple[int, Sample, str]
"""Time, topic with content, and type of a message."""


def _all(
    recording: Recording, clock: _Clock, outputs: Outputs, written: Written
) -> Iterator[Stored]:
    info = RecordingInfo(
        joint_map=recording.joint_map,
        rate_hz=recording.rate_hz,
        declares_noise=recording.declares_noise,
        config=recording.config,
        in_room=recording.in_room,
        last_latch_id=recording.last_latch_id,
    )
    about = info.to_metadata() | ({"clocks": "system"} if recording.utc_ns else {})
    begin_ns = max(clock.captures_ns[0], 0)
    yield begin_ns, Sample(ABOUT, string(json.dumps(about))), STRING
    said = (
        (at_ns, Sample(PREFIX + _TOPICS.full(topic), data), type_of(topic))
        for at_ns, (topic, data) in outputs.samples()
    )
    yield from heapq.merge(
        _people(recording, clock, outputs.frame_id, written), said, key=itemgetter(0)
    )


def _people(
    recording: Recording, clock: _Clock, frame_id: str, written: Written
) -> Iterator[Stored]:
    before_ns = -1
    scenes = watched(recording.scenes, WRITING, len(recording.scenes))
    for scene, at_ns in zip(scenes, clock.captures_ns, strict=True):
        if not scene.sees_room:
            written.dropped["scenes of a source that did not see the room: gaps"] += 1
        else:
            before_ns = at_ns = max(at_ns, before_ns + 1)  # several may have arrived at once
            bodies = [(person.id, _joints(person)) for person in scene.people]
            data = people_markers(bodies, stamp_ns=at_ns, frame_id=frame_id)
            yield at_ns, Sample(PEOPLE, data), MARKER_ARRAY


def _joints(person: Person) -> list[Point]:
    nan = float("nan")
    return [
        (x, y, z) if seen else (nan, nan, nan)
        for (x, y, z), seen in zip(person.positions.tolist(), person.observed, strict=True)
    ]


def _check(recording: Recording) -> None:
    joints = len(recording.joint_map.source_joints)
    if joints > IDS_PER_BODY:
        raise RecordingError(
            f"recording {recording.path}: has {joints} joints, and a bag's bodies have at most "
            f"{IDS_PER_BODY}; convert it to csv or mcap"
        )
    most = max(len(scene.people) for scene in recording.scenes)
    if most > MAX_PEOPLE:
        raise RecordingError(
            f"recording {recording.path}: has a scene with {most} people, and a bag has at most "
            f"{MAX_PEOPLE}; choose one with --person, or convert it to mcap"
        )


def _say(recording: Recording, outputs: Outputs, written: Written) -> None:
    if recording.received:
        written.dropped["messages of controllers"] += len(recording.received)
    if recording.kind != "mcap":
        return
    if recording.outputs_ns is None:
        written.notes.append("the node's output was for all people, and is left out")
    elif outputs.full_speed_m_s is None:
        written.notes.append(
            "its configuration states no full speed, so the node's output is left out"
        )
    else:
        written.notes.append(f"speed fractions are of {outputs.full_speed_m_s:g} m/s")
