"""Reads the people of a bag as a recording.

Scenes are by the stamps of the headers; where those are zero or go back, by the times of receipt.
Positions are in the topmost frame above the one in which they were published (``map``, ``world``,
or the base of the camera), as ``/tf`` and ``/tf_static`` of the bag say.
"""

from collections import Counter, deque
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from hri_predict.base.arrays import Floats
from hri_predict.base.errors import RecordingError
from hri_predict.base.settings import MAX_COORDINATE_M
from hri_predict.contracts.joint_map import JointMap
from hri_predict.contracts.scene import Person, Scene
from hri_predict.protocol.ros.bodies import Bodies, MessageError
from hri_predict.protocol.ros.frame_tree import FrameTree
from hri_predict.protocol.ros.messages import TF_MESSAGE
from hri_predict.protocol.ros.placing import PeopleReader
from hri_predict.protocol.ros.stamps import CLOSE_NS
from hri_predict.recording.bounded import READING, check_joints, watched
from hri_predict.recording.mcap.info import RecordingInfo
from hri_predict.recording.one_clock import on_one_clock
from hri_predict.recording.recording import Recording, check_gaps, check_rate
from hri_predict.recording.ros.about import PEOPLE, about
from hri_predict.recording.ros.bag import Bag, open_bag
from hri_predict.recording.ros.topics import connections_of, looked_at
from hri_predict.recording.wanted import Wanted

KIND = "rosbag"
WAIT_NS = 1_000_000_000
"""Delay before a message is placed, because some transforms arrive after it."""
Read = tuple[int, Bodies]
"""Receipt, ns, and people."""


def read_bag(path: Path, wanted: Wanted) -> Recording:
    """Read the people of one topic.

    Raises:
        ConfigError: rosbags is not installed.
        RecordingError: the bag is damaged, has no such topic, or its joints are not known.
        OSError: it cannot be read.
    """
    with open_bag(path) as bag:
        people = connections_of(path, bag, wanted.topic)
        own = about(path, bag) if people[0].topic == PEOPLE else None
        joint_map = _map(path, wanted, people[0].topic, own)
        frame = wanted.frame or _topmost(bag, people)
        read = list(_placed(bag, people, frame, joint_map.source_joints))
    refused = Counter(each for each in read if isinstance(each, str))
    found = [each for each in read if not isinstance(each, str)]
    if not found:
        why = f": {next(iter(refused))}" if refused else ""
        raise RecordingError(
            f"recording {path}: topic {people[0].topic} has no message that can be used{why}"
        )
    recording = _recording(path, joint_map, found, notes=_notes(frame, refused))
    return recording if own is None else _as_recorded(recording, own)


def _as_recorded(recording: Recording, own: RecordingInfo) -> Recording:
    """Return the recording with the bag's own description, if this node wrote the bag."""
    return replace(
        recording,
        rate_hz=own.rate_hz,
        declares_noise=own.declares_noise,
        config=own.config,
        last_latch_id=own.last_latch_id,
        in_room=own.in_room,
        utc_ns=recording.utc_ns if own.has_utc else (),
    )


def _map(path: Path, wanted: Wanted, topic: str, own: RecordingInfo | None) -> JointMap:
    stated = wanted.joint_map or (None if own is None else own.joint_map)
    if stated is None:
        raise RecordingError(
            f"recording {path}: topic {topic} does not name its joints; give --joint-map "
            f"('hri-predict topics {path}' names those that fit)"
        )
    made = stated.with_units(wanted.unit_m or 1.0)
    return made.with_axes(wanted.axes or ["x", "y", "z"])


def _topmost(bag: Bag, people: list[Any]) -> str:
    """The topmost frame above that of the first message with a frame."""
    tree = FrameTree()
    frames = [c for c in bag.connections if c.msgtype == TF_MESSAGE]
    for connection, _, data in bag.messages(frames):
        tree.add(bag.read(data, TF_MESSAGE), static=_is_static(connection))
    for connection, _, data in bag.messages(people):
        _, frame = looked_at(bag.read(data, connection.msgtype), connection.msgtype)
        if frame:
            return tree.root(frame)
    return ""


def _placed(bag: Bag, people: list[Any], frame: str, joints: Sequence[str]) -> Iterator[Read | str]:
    """Yield receipt and people of each message, or why it cannot be used."""
    tree = FrameTree()
    frames = [c for c in bag.connections if c.msgtype == TF_MESSAGE]
    for _, _, data in bag.messages([c for c in frames if _is_static(c)]):
        tree.add(bag.read(data, TF_MESSAGE), static=True)
    reader = PeopleReader(joints, frame, tree)
    moving = [c for c in frames if not _is_static(c)]
    waiting: deque[tuple[int, str, Any]] = deque()
    total = sum(c.msgcount for c in (*people, *moving))
    for connection, at_ns, data in watched(bag.messages([*people, *moving]), READING, total):
        while waiting and waiting[0][0] < at_ns - WAIT_NS:
            yield _read(reader, *waiting.popleft())
        message = bag.read(data, connection.msgtype)
        if connection.msgtype == TF_MESSAGE:
            tree.add(message, static=False)
        else:
            waiting.append((at_ns, connection.msgtype, message))
    for each in waiting:
        yield _read(reader, *each)


def _read(reader: PeopleReader, at_ns: int, kind: str, message: Any) -> Read | str:
    try:
        return at_ns, reader.place(reader.parse(kind, message))
    except MessageError as error:
        return str(error)


def _is_static(connection: Any) -> bool:
    return bool(connection.topic.endswith("tf_static"))


def _recording(
    path: Path, joint_map: JointMap, found: list[Read], *, notes: list[str]
) -> Recording:
    kept, stamps = _in_order(path, found, notes)
    check_joints(path, len(kept), max(len(b.people) for b in kept), len(joint_map.source_joints))
    check_gaps(path, stamps)
    rate_hz = _rate_hz(stamps)
    check_rate(path, "the stamps' interval", rate_hz)
    scenes = [
        Scene(
            ns - stamps[0], k, True, tuple(_person(p.id, p.positions, joint_map) for p in b.people)
        )
        for k, (ns, b) in enumerate(zip(stamps, kept, strict=True))
    ]
    is_utc = abs(stamps[0] - found[0][0]) < CLOSE_NS
    return Recording(
        path=path,
        kind=KIND,
        joint_map=joint_map,
        rate_hz=rate_hz,
        scenes=scenes,
        arrival_ns=[scene.stamp_ns for scene in scenes],
        note="; ".join(notes),
        utc_ns=stamps if is_utc else (),
    )


def _in_order(path: Path, found: list[Read], notes: list[str]) -> tuple[list[Bodies], list[int]]:
    """Return the messages with increasing times, and these times; adds to the notes.

    Raises:
        RecordingError: most of them would be left out.
    """
    kept: list[Bodies] = []
    times: list[int] = []
    found_ns = _times(found, notes)
    for time_ns, (_, bodies) in zip(found_ns, found, strict=True):
        if time_ns is not None and (not times or time_ns > times[-1]):
            kept.append(bodies)
            times.append(time_ns)
    if lost := len(found) - len(kept):
        notes.append(f"{lost} messages whose stamps do not rise are left out")
    if (wrong := found_ns.count(None)) > len(found) / 2:  # repeated messages do no harm
        raise RecordingError(
            f"recording {path}: the stamps of {wrong} of {len(found)} messages do not rise; record "
            f"it again with one sender on the topic, whose clock runs"
        )
    return kept, times


def _times(found: list[Read], notes: list[str]) -> list[int | None]:
    """Time of each message: its stamp, or where it has none, as long after another as received."""
    stamped = [(at_ns, bodies.stamp_ns) for at_ns, bodies in found if bodies.stamp_ns]
    if not stamped:
        notes.append("stamps are zero: the times of receipt are used")
        return [at_ns for at_ns, _ in found]
    clock = on_one_clock([ns for _, ns in stamped], [at_ns for at_ns, _ in stamped])
    if clock.restarts:
        notes.append(
            f"the clock of the stamps was set back {len(clock.restarts)} times: from there the "
            f"times go on by those of receipt"
        )
    own = iter(clock.times_ns)
    known = zip((at_ns for at_ns, _ in stamped), clock.times_ns, strict=True)
    offset_ns = next(at_ns - ns for at_ns, ns in known if ns is not None)
    times: list[int | None] = []
    for at_ns, bodies in found:
        time_ns = next(own) if bodies.stamp_ns else at_ns - offset_ns
        if time_ns is not None:
            offset_ns = at_ns - time_ns
        times.append(time_ns)
    return times


def _rate_hz(stamps: list[int]) -> float:
    """Return the scenes per second without gaps, from the median interval."""
    if len(stamps) < 2:
        return 1.0
    return float(f"{1e9 / float(np.median(np.diff(stamps))):.6g}")


def _person(number: int, raw: Floats, joint_map: JointMap) -> Person:
    positions = joint_map.to_metres_z_up(raw)
    seen = np.asarray((np.abs(positions) <= MAX_COORDINATE_M).all(axis=1))  # false for NaN
    return Person(number, np.where(seen[:, None], positions, np.nan), seen)


def _notes(frame: str, refused: Counter[str]) -> list[str]:
    notes = [f"positions are in the frame '{frame}'"] if frame else []
    return notes + [f"{n} messages left out: {why}" for why, n in refused.most_common(2)]
