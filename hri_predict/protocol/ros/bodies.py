"""Bodies in one ROS message, in the message's own frame, metres (REP-103).

``geometry_msgs/PoseArray``: the joints of one person after the other, in the joint map's order;
people are numbered by their place. Orientations are not used.

``visualization_msgs/MarkerArray``, as Azure Kinect's driver publishes it: a marker for each joint,
whose id is the body's number times 100 plus the joint's
(github.com/microsoft/Azure_Kinect_ROS_Driver, ``k4a_ros_device.cpp``). Lines and texts among them
are not joints. Deleted markers are not there.
"""

from collections.abc import Callable
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
_ADD = 0


class MessageError(ValueError):
    """The message does not place people; one line with the remedy."""


@dataclass(frozen=True, slots=True, eq=False)
class Body:
    """One person: number, 0..65535, and (J, 3) metres, NaN where a joint was not seen."""

    id: int
    positions: Floats


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Bodies:
    """All people in one message.

    Attributes:
        stamp_ns: the header's, ns of the publisher's clock; ``None`` where the message has no
            header: an empty ``MarkerArray``.
        frame: name of the frame; "" where the message has no header.
        people: each with another id.
    """

    stamp_ns: int | None
    frame: str
    people: tuple[Body, ...]


def of_pose_array(message: Any, joints: int) -> Bodies:
    """Bodies of a ``PoseArray`` of people with this number of joints.

    Raises:
        MessageError: another number of joints, or too many people.
    """
    count, rest = divmod(len(message.poses), joints)
    if rest:
        raise MessageError(
            f"{len(message.poses)} poses are not a multiple of the {joints} joints of the joint "
            f"map; correct 'joint_map'"
        )
    _check_people(count)
    places = [(p.position.x, p.position.y, p.position.z) for p in message.poses]
    points = np.array(places, np.float64).reshape(count, joints, 3)
    return Bodies(
        stamp_ns=_stamp(message.header),
        frame=plain_frame(message.header.frame_id),
        people=tuple(Body(k + 1, _known(points[k])) for k in range(count)),
    )


def of_marker_array(message: Any, joints: int) -> Bodies:
    """Bodies of a ``MarkerArray`` of people with this number of joints.

    Raises:
        MessageError: an id beyond the joints, a joint that comes twice, two frames, two stamps, or
            too many people.
    """
    shown = [m for m in message.markers if m.action == _ADD and m.type in _SOLID]
    if not shown:
        return Bodies(stamp_ns=None, frame="", people=())
    first = shown[0].header
    found: dict[int, Floats] = {}
    seen: set[int] = set()
    for marker in shown:
        if _capture(marker.header) != _capture(first):
            raise MessageError("its markers have different frames or stamps; publish one capture")
        body, joint = divmod(int(marker.id), IDS_PER_BODY)
        if joint >= joints or marker.id in seen or not 0 <= body <= MAX_ID:
            raise MessageError(
                f"marker {marker.id} is not joint 0 to {joints - 1} of a body, each once (id = "
                f"body x 100 + joint); correct 'joint_map' or the publisher"
            )
        seen.add(marker.id)
        points = found.setdefault(body, np.full((joints, 3), np.nan))
        place = marker.pose.position
        points[joint] = place.x, place.y, place.z
    _check_people(len(found))
    return Bodies(
        stamp_ns=_stamp(first),
        frame=plain_frame(first.frame_id),
        people=tuple(Body(number, _known(points)) for number, points in sorted(found.items())),
    )


READERS: dict[str, Callable[[Any, int], Bodies]] = {
    POSE_ARRAY: of_pose_array,
    MARKER_ARRAY: of_marker_array,
}
"""Types of messages that place people, and how each is read."""


def _capture(header: Any) -> tuple[str, int, int]:
    return header.frame_id, header.stamp.sec, header.stamp.nanosec


def _stamp(header: Any) -> int:
    try:
        return stamp_ns(header.stamp)
    except ValueError as error:
        raise MessageError(f"{error}; correct the publisher") from None


def _check_people(count: int) -> None:
    if count > MAX_PEOPLE:
        raise MessageError(f"{count} people; at most {MAX_PEOPLE} in one message")


def _known(points: Floats) -> Floats:
    """The points, a point with a coordinate that is not a number as not seen at all."""
    return np.where(np.isfinite(points).all(axis=1, keepdims=True), points, np.nan)
