"""Bodies in one ROS message, in the frame of the message, metres (REP-103).

``hri_msgs/IdsList`` and ``zed_msgs/ObjectsStamped`` have separate modules: ``tracked``, ``zed``.

``geometry_msgs/PoseArray``: the joints of each person in turn, in the joint map's order; a person's
id is the index in the message. Orientations are not used.

``visualization_msgs/MarkerArray``, as published by the Azure Kinect driver: one marker per joint,
with the marker id 100 times the body's number plus the joint's number
(github.com/microsoft/Azure_Kinect_ROS_Driver, ``k4a_ros_device.cpp``). Lines and texts beside them
are not joints; deleted markers are ignored. A message that draws something, but no joint, is
refused: it may show people in another way, so the room may not be empty.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from hri_predict.base.arrays import Floats
from hri_predict.protocol.ros.frame_tree import plain_frame
from hri_predict.protocol.ros.stamps import stamp_ns

POSE_ARRAY = "geometry_msgs/msg/PoseArray"
MARKER_ARRAY = "visualization_msgs/msg/MarkerArray"
MAX_PEOPLE = 64
MAX_ID = 65_535
IDS_PER_BODY = 100
_SOLID = range(4)  # arrow, cube, sphere, cylinder: have one place
_BESIDE = (4, 5, 9)  # line strip, line list, text: bones and labels
_ADD = 0


class MessageError(ValueError):
    """The message does not give positions of people; one line with the remedy."""


@dataclass(frozen=True, slots=True, eq=False)
class Body:
    """One person.

    Attributes:
        id: number, 0..65535.
        positions: (J, 3) metres, NaN where a joint was not seen.
        name: suffix of the names of the person's frames in ``/tf``; "" without such frames.
    """

    id: int
    positions: Floats
    name: str = ""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Bodies:
    """All people in one message.

    Attributes:
        stamp_ns: stamp in the header, ns of the publisher's clock; ``None`` without a header, as in
            an empty ``MarkerArray``.
        frame: name of the frame; "" if the message has no header.
        people: the people, with distinct ids.
        by_frames: whether only ``/tf`` gives the positions, with separate frames for each person.
    """

    stamp_ns: int | None
    frame: str
    people: tuple[Body, ...]
    by_frames: bool = False


def of_pose_array(message: Any, names: Sequence[str]) -> Bodies:
    """Return the bodies in a ``PoseArray`` of people with these joints.

    Raises:
        MessageError: the number of joints is wrong, or there are too many people.
    """
    joints = len(names)
    count, rest = divmod(len(message.poses), joints)
    if rest:
        raise MessageError(
            f"{len(message.poses)} poses are not a multiple of the {joints} joints of the joint "
            f"map; correct 'joint_map'"
        )
    check_people(count)
    places = [(p.position.x, p.position.y, p.position.z) for p in message.poses]
    points = np.array(places, np.float64).reshape(count, joints, 3)
    return Bodies(
        stamp_ns=stamp(message.header),
        frame=plain_frame(message.header.frame_id),
        people=tuple(Body(k + 1, known(points[k])) for k in range(count)),
    )


def of_marker_array(message: Any, names: Sequence[str]) -> Bodies:
    """Return the bodies in a ``MarkerArray`` of people with these joints.

    Raises:
        MessageError: an id outside the joint map, a repeated joint, two frames, two stamps, too
            many people, or markers that are not one for each joint.
    """
    drawn = [m for m in message.markers if m.action == _ADD]
    shown = [m for m in drawn if m.type in _SOLID]
    other = [m.type for m in drawn if m.type not in (*_SOLID, *_BESIDE)]
    if other or (drawn and not shown):
        raise MessageError(
            f"it draws markers of type {(other or [drawn[0].type])[0]}, which are not one for each "
            f"joint; publish a sphere (type 2) for each joint, id = body x 100 + joint"
        )
    if not shown:
        return Bodies(stamp_ns=None, frame="", people=())
    joints, first = len(names), shown[0].header
    found: dict[int, Floats] = {}
    seen: set[int] = set()
    for marker in shown:
        if _capture(marker.header) != _capture(first):
            raise MessageError("its markers have different frames or stamps; publish one capture")
        body, joint = divmod(int(marker.id), IDS_PER_BODY)
        if joint >= joints or marker.id in seen or not 0 <= body <= MAX_ID:
            raise MessageError(
                f"marker {marker.id} is not joint 0 to {joints - 1} of a body, or is repeated (id "
                "= body x 100 + joint); correct 'joint_map' or the publisher"
            )
        seen.add(marker.id)
        points = found.setdefault(body, np.full((joints, 3), np.nan))
        place = marker.pose.position
        points[joint] = place.x, place.y, place.z
    check_people(len(found))
    return Bodies(
        stamp_ns=stamp(first),
        frame=plain_frame(first.frame_id),
        people=tuple(Body(number, known(points)) for number, points in sorted(found.items())),
    )


def _capture(header: Any) -> tuple[str, int, int]:
    return header.frame_id, header.stamp.sec, header.stamp.nanosec


def stamp(header: Any) -> int:
    """Return the stamp of a header, ns.

    Raises:
        MessageError: it is not a valid time.
    """
    try:
        return stamp_ns(header.stamp)
    except ValueError as error:
        raise MessageError(f"{error}; correct the publisher") from None


def check_people(count: int) -> None:
    """Refuse too many people.

    Raises:
        MessageError: there are more than ``MAX_PEOPLE``.
    """
    if count > MAX_PEOPLE:
        raise MessageError(f"{count} people; at most {MAX_PEOPLE} in one message")


def known(points: Floats) -> Floats:
    """Return the points; one with a coordinate that is not finite becomes NaN in all three."""
    return np.where(np.isfinite(points).all(axis=1, keepdims=True), points, np.nan)
