"""Topics of a bag that could contain people, and the matching joint maps."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from hri_predict.base.errors import RecordingError, nearest
from hri_predict.contracts.joint_map import load_joint_map, map_names
from hri_predict.protocol.ros.bodies import IDS_PER_BODY, MARKER_ARRAY, POSE_ARRAY
from hri_predict.protocol.ros.placing import READERS
from hri_predict.protocol.ros.tracked import IDS_LIST, ROOT
from hri_predict.protocol.ros.zed import OBJECTS, keypoints_of
from hri_predict.recording.ros.about import PEOPLE, about
from hri_predict.recording.ros.bag import Bag, open_bag

NO_ORDER = ("bvh", "motive21", "qualisys24", "rokoko23", "ros4hri", "unity22")
"""Maps whose joints are found by their names."""
LOOKED_AT = 100
"""Number of messages searched for people in a topic."""


@dataclass(frozen=True, slots=True, kw_only=True)
class BagTopic:
    """A topic whose message type can carry people's positions.

    Attributes:
        name: the topic's name.
        kind: type of the messages.
        count: number of messages.
        joints: number of poses, or of different joints among markers, in the first message with
            people; 0 if there are none, or if ``/tf`` has them.
        frame: frame of these people; "" if there are none.
        joint_maps: shipped maps with that many joints; or the map for this message type.
        is_named: whether the bag names the joints, because this node wrote it.
    """

    name: str
    kind: str
    count: int
    joints: int
    frame: str
    joint_maps: tuple[str, ...]
    is_named: bool = False


def topics_of(path: Path) -> list[BagTopic]:
    """Return the topics that could contain people.

    Raises:
        ConfigError: rosbags is not installed.
        RecordingError: the bag cannot be read.
        OSError: likewise.
    """
    with open_bag(path) as bag:
        names = sorted({c.topic for c in bag.connections if c.msgtype in READERS})
        if PEOPLE in names and about(path, bag) is not None:  # the rest is what the node said
            return [replace(_topic(bag, PEOPLE), joint_maps=(), is_named=True)]
        return [_topic(bag, name) for name in names]


def connections_of(path: Path, bag: Bag, topic: str | None) -> list[Any]:
    """The connections of the people's topic.

    Raises:
        RecordingError: it is not in the bag, or it is not said which of several is meant.
    """
    possible = [c for c in bag.connections if c.msgtype in READERS]
    names = sorted({c.topic for c in possible})
    types = ", ".join(READERS)
    if not names:
        raise RecordingError(f"recording {path}: no topic can be people ({types}); name another")
    if topic is None and PEOPLE in names and about(path, bag) is not None:
        topic = PEOPLE
    if topic is None and len(names) > 1:
        raise RecordingError(
            f"recording {path}: {len(names)} topics could be people: {', '.join(names[:5])}; give "
            f"--topic to replay or convert ('hri-predict topics' lists them)"
        )
    wanted = topic or names[0]
    found = [c for c in possible if c.topic in (wanted, f"/{wanted}")]
    if not found:
        raise RecordingError(
            f"recording {path}: no topic {wanted} of a type that can be people"
            f"{nearest(wanted, names)} (available: {', '.join(names[:5])}); correct --topic"
        )
    return found


def maps_with(joints: int) -> tuple[str, ...]:
    """Names of the shipped maps with this number of joints."""
    loaded = ((name, load_joint_map(name)) for name in map_names() if name not in NO_ORDER)
    return tuple(name for name, each in loaded if len(each.source_joints) == joints)


def _topic(bag: Bag, name: str) -> BagTopic:
    own = [c for c in bag.connections if c.topic == name and c.msgtype in READERS]
    kind, joints, frame = own[0].msgtype, 0, ""
    for k, (_, _, data) in enumerate(bag.messages(own)):
        joints, frame = looked_at(bag.read(data, kind), kind)
        if joints or (kind == IDS_LIST and frame) or k >= LOOKED_AT:
            break
    return BagTopic(
        name=name,
        kind=kind,
        count=sum(c.msgcount for c in own),
        joints=joints,
        frame=frame,
        joint_maps=_suggested(kind, joints),
    )


def looked_at(message: Any, kind: str) -> tuple[int, str]:
    """Number of joints in a message of people, and its frame; see ``BagTopic``."""
    if kind == POSE_ARRAY:
        return len(message.poses), message.header.frame_id
    if kind == IDS_LIST:
        return 0, f"{ROOT}_{message.ids[0]}" if message.ids else ""
    if kind == OBJECTS:
        return keypoints_of(message), message.header.frame_id
    joints = {marker.id % IDS_PER_BODY for marker in message.markers if marker.action == 0}
    return (max(joints) + 1, message.markers[0].header.frame_id) if joints else (0, "")


def _suggested(kind: str, joints: int) -> tuple[str, ...]:
    """Maps with all joints of the first message; or, of poses, with those of one of several."""
    if kind == IDS_LIST:
        return ("ros4hri",)
    exact = maps_with(joints) if joints else ()
    if kind == OBJECTS:
        return tuple(name for name in exact if name.startswith("zed"))
    if exact or kind == MARKER_ARRAY:
        return exact
    return next((maps_with(joints // n) for n in range(2, 9) if not joints % n
                 and maps_with(joints // n)), ())  # fmt: skip
