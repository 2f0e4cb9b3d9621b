"""Writes a recording as a ROS 2 bag: the people and the node's output.

Topics are those of the ROS 2 link with ``/recorded`` before them, so a bag played near a live cell
does not reach robots that listen to the link: a recorded *clear* is not advice.
"""

import heapq
import json
import math
import os
import struct
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from operator import itemgetter
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import yaml

from hri_predict.base.errors import RecordingError
from hri_predict.base.files import load_yaml
from hri_predict.contracts.scene import Person
from hri_predict.protocol.messages import Advice, Message, Pose, Status, Zone, ZoneCapsule
from hri_predict.protocol.ros.bodies import IDS_PER_BODY, MARKER_ARRAY, MAX_PEOPLE
from hri_predict.protocol.ros.cdr import Point, string
from hri_predict.protocol.ros.link_topics import Topics, type_of
from hri_predict.protocol.ros.markers import people_markers
from hri_predict.protocol.ros.messages import typestore
from hri_predict.protocol.ros.plain import PlainMessages, Sample
from hri_predict.recording.bounded import WRITING, watched
from hri_predict.recording.cutting import people_of, true_times
from hri_predict.recording.frames import Written
from hri_predict.recording.mcap.format import sent_from_dict, whole
from hri_predict.recording.mcap.info import RecordingInfo
from hri_predict.recording.mcap.messages import Told, read_messages, recording_info
from hri_predict.recording.recording import Recording
from hri_predict.recording.ros.about import ABOUT, PEOPLE, PREFIX, STRING

TOPICS = ("/status", "/advice", "/forecast", "/zones")
FAILS = (KeyError, ValueError, TypeError, IndexError, OverflowError, AttributeError, struct.error)
"""Raised by a message that this version does not know, or that is damaged."""


class Outputs:
    """Reads them.

    The node's output in a recording, as the ROS 2 link would have published it: the link's own
    functions make the messages (``hri_predict.protocol.ros.plain``). A recording keeps every
    advice, but zones and forecasts at ``zones_hz`` and ``poses_hz``, rounded to 1 mm.

    Args:
        recording: with ``outputs_ns``.
        frame_id: the room's frame in ROS.
        at_ns: a message's time in the bag.
        dropped: counts messages that cannot be converted.

    Attributes:
        frame_id: as above.
        full_speed_m_s: see ``full_speed``; ``None`` leaves the output out.
    """

    def __init__(
        self,
        recording: Recording,
        frame_id: str,
        at_ns: Callable[[Told], int],
        dropped: Counter[str],
    ) -> None:
        self.full_speed_m_s = full_speed(recording.config)
        self._recording, self.frame_id = recording, frame_id
        self._at_ns, self._dropped = at_ns, dropped

    def samples(self) -> Iterator[tuple[int, Sample]]:
        """Yield time (ns) and sample of each, as recorded.

        Raises:
            RecordingError, OSError: as ``read_messages``.
        """
        if self._recording.outputs_ns is None or self.full_speed_m_s is None:
            return
        first_ns, last_ns = self._recording.outputs_ns
        rate_hz = recording_info(self._recording.path).forecast_rate_hz
        now_ns = 0
        plain = PlainMessages(self.full_speed_m_s, self.frame_id, wall_ns=lambda: now_ns)
        for told in read_messages(self._recording.path, TOPICS):
            if not first_ns <= told.node_ns <= last_ns:
                continue
            now_ns = self._at_ns(told)
            try:
                samples = [s for m in messages_of(told, rate_hz) for s in plain.of(m)]
            except FAILS:
                self._dropped[f"messages on {told.topic} that this version cannot read"] += 1
                continue
            yield from ((now_ns, sample) for sample in samples)


def full_speed(config: str) -> float | None:
    """Return the full speed, 1.0 in speed fractions, m/s; ``None`` if a configuration has none.

    It is that of its first ``ros2`` link; or else the highest ``max_speed_m_s`` of its robots, by
    which fractions are lowest.
    """
    try:
        data = load_yaml(config)
    except (yaml.YAMLError, ValueError, RecursionError):
        return None
    links = [link for link in _mappings(data, "links") if link.get("kind") == "ros2"]
    stated = [link.get("full_speed_m_s") for link in links][:1]
    found = [robot.get("max_speed_m_s") for robot in _mappings(data, "robots")]
    speeds = [s for s in stated or found if isinstance(s, int | float) and 0 < s < math.inf]
    return max(map(float, speeds), default=None)


def messages_of(told: Told, rate_hz: float) -> list[Message]:
    """Return the node's messages of one recorded message.

    Raises:
        one of ``FAILS``: it is damaged, or this version does not know it.
    """
    data = told.data
    if told.topic == "/status":
        return [sent_from_dict(Status, data)]
    if told.topic == "/forecast":
        return list(_poses(data, rate_hz))
    if told.topic == "/zones":
        return list(_zones(data, rate_hz))
    return [sent_from_dict(Advice, data)]


def _poses(data: Mapping[str, Any], rate_hz: float) -> Iterator[Pose]:
    for p, person in enumerate(data["ids"]):
        age_s = (whole(data["now_ns"]) - whole(data["capture_ns"][p])) * 1e-9
        for k, step in enumerate(data["steps"]):
            joints = tuple((j, *_place(xyz)) for j, xyz in enumerate(data["positions"][p][k]))
            yield Pose(
                person=whole(person, 0, 65_535),
                step=step + 1,
                horizon_s=(step + 1) / rate_hz if rate_hz > 0 else math.nan,
                joints=joints,
                age_s=age_s,
            )


def _zones(data: Mapping[str, Any], rate_hz: float) -> Iterator[Zone]:
    for k, ahead_s in enumerate(data["times_s"]):
        for p, person in enumerate(data["ids"]):
            capsules = tuple(
                ZoneCapsule(s, _place(row[:3]), _place(row[3:6]), _number(row[6]))
                for s, row in enumerate(data["capsules"][p][k])
            )
            step = round(ahead_s * rate_hz) if rate_hz > 0 else k
            yield Zone(
                person=whole(person, 0, 65_535), step=step, horizon_s=ahead_s, capsules=capsules
            )


def _place(xyz: Any) -> tuple[float, float, float]:
    x, y, z = map(_number, xyz)
    return x, y, z


def _number(value: Any) -> float:
    return math.nan if value is None else float(value)


def _mappings(data: Any, key: str) -> list[dict[str, Any]]:
    found = data.get(key) if isinstance(data, dict) else None
    return [each for each in found if isinstance(each, dict)] if isinstance(found, list) else []


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
        RecordingError: bodies have too many joints, scenes too many people, or nothing is left.
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
    if recording.outputs_ns is None and not any(scene.sees_room for scene in recording.scenes):
        raise RecordingError(
            f"recording {recording.path}: no scene saw the room without doubt, and a bag "
            f"holds no other scenes; convert it to csv or mcap"
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
