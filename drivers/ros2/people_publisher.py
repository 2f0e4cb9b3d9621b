"""Publishes a test person on a ROS 2 topic, to test the node's ``kind: ros2`` or as a template.

Needs only ROS 2 (Jazzy or later); ``--message ros4hri`` also hri_msgs and tf2_msgs,
``--message zed`` also zed_msgs. Stamp each capture with the camera's exposure time, and publish
every capture, even if no person is present.
"""

import argparse
import math
import random
import time
from typing import Any

import rclpy
from geometry_msgs.msg import Pose, PoseArray, TransformStamped
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from visualization_msgs.msg import Marker, MarkerArray

STANDING = [  # the joints of configs/skeletons/canonical.yaml; x forward, y left, z up, metres
    (0, 0, 0.95), (0, 0, 1.2), (0, 0, 1.5), (0.02, 0, 1.65), (0, 0, 1.8),
    (0, 0.2, 1.45), (0, 0.25, 1.15), (0, 0.26, 0.9), (0, 0.26, 0.8),
    (0, -0.2, 1.45), (0, -0.25, 1.15), (0, -0.26, 0.9), (0, -0.26, 0.8),
    (0, 0.1, 0.93), (0, 0.1, 0.5), (0, 0.1, 0.1), (0.15, 0.1, 0.02),
    (0, -0.1, 0.93), (0, -0.1, 0.5), (0, -0.1, 0.1), (0.15, -0.1, 0.02),
]  # fmt: skip
FRAMES = {  # of REP-155, by the joints above
    0: "body", 3: "head", 5: "l_shoulder", 6: "l_elbow", 7: "l_wrist", 9: "r_shoulder",
    10: "r_elbow", 11: "r_wrist", 13: "l_hip", 14: "l_knee", 15: "l_ankle", 17: "r_hip",
    18: "r_knee", 19: "r_ankle",
}  # fmt: skip
BODY_34 = {  # keypoints of ZED, by the joints above; the ears are beside the head
    0: 0, 1: 1, 2: 3, 3: 26, 5: 5, 6: 6, 7: 7, 8: 9, 9: 12, 10: 13, 11: 14, 12: 16,
    13: 18, 14: 19, 15: 20, 16: 21, 17: 22, 18: 23, 19: 24, 20: 25,
}  # fmt: skip
LEFT_EAR, RIGHT_EAR, EAR_M = 29, 31, 0.075
LOOSE = {6: 0.4, 7: 0.8, 8: 1.0, 10: -0.4, 11: -0.8, 12: -1.0}  # of joints: share of the swing
CLOCKS = {
    "utc": time.time_ns,
    "boot": lambda: time.clock_gettime_ns(time.CLOCK_BOOTTIME),
    "sim": lambda: time.monotonic_ns() - _START_NS + 10**9,
    "zero": lambda: 0,
}
_START_NS = time.monotonic_ns()


def moving(seconds: float, person: int) -> list[tuple[float, float, float]]:
    """Return the joints of a swaying test person with moving arms, with 2 mm of sensor noise, so
    that captures never repeat. Person 0 stands at (2, 0), each further person 1.5 m farther left.
    """
    sway = 0.012 * (math.sin(1.5 * seconds) + math.sin(0.97 * seconds + 1))
    swing = 0.08 * math.sin(2.3 * seconds) + 0.06 * math.sin(3.1 * seconds + 2)
    joints = []
    for k, (x, y, z) in enumerate(STANDING):
        ahead = LOOSE.get(k, 0.0) * swing + sway * z
        place = (2 + x + ahead, 1.5 * person + y, z)
        joints.append(tuple(v + random.gauss(0.0, 0.002) for v in place))
    return joints


def pose_array(people: list[list[tuple[float, float, float]]]) -> PoseArray:
    """Return the joints of all people, one person after the other."""
    message = PoseArray()
    for person in people:
        for x, y, z in person:
            pose = Pose()
            pose.position.x, pose.position.y, pose.position.z = float(x), float(y), float(z)
            message.poses.append(pose)
    return message


def marker_array(people: list[list[tuple[float, float, float]]]) -> MarkerArray:
    """A sphere for each joint; its id is the body's number times 100 plus the joint's."""
    message = MarkerArray()
    for number, person in enumerate(people, start=1):
        for joint, (x, y, z) in enumerate(person):
            marker = Marker(id=100 * number + joint, type=Marker.SPHERE, action=Marker.ADD)
            marker.pose.position.x, marker.pose.position.y = float(x), float(y)
            marker.pose.position.z = float(z)
            message.markers.append(marker)
    return message


def stamped(owners: list[Any], frame: str, stamp_ns: int) -> None:
    """Set the stamp of each header, and its frame if it has none."""
    for owner in owners:
        owner.header.frame_id = owner.header.frame_id or frame
        owner.header.stamp.sec, owner.header.stamp.nanosec = divmod(stamp_ns, 10**9)


class OneTopic:
    """People in one message."""

    def __init__(self, node: Node, wanted: argparse.Namespace) -> None:
        self._frame = wanted.frame
        self._poses = wanted.message == "pose_array"
        best = ReliabilityPolicy.BEST_EFFORT if wanted.best_effort else ReliabilityPolicy.RELIABLE
        kind = PoseArray if self._poses else MarkerArray
        qos = QoSProfile(depth=10, reliability=best)
        self._publisher = node.create_publisher(kind, wanted.topic, qos)

    def send(self, people: list[list[tuple[float, float, float]]], stamp_ns: int) -> None:
        """Publish one capture; markers have their own headers."""
        message = pose_array(people) if self._poses else marker_array(people)
        stamped([message] if self._poses else message.markers, self._frame, stamp_ns)
        self._publisher.publish(message)


class Ros4hri:
    """The list of bodies, and their frames: ``body_ID`` by the tracker, and then the others."""

    def __init__(self, node: Node, wanted: argparse.Namespace) -> None:
        from hri_msgs.msg import IdsList
        from tf2_msgs.msg import TFMessage

        self._kinds = IdsList, TFMessage
        self._wanted = wanted
        if wanted.part != "frames":
            self._ids = node.create_publisher(IdsList, wanted.topic, 1)
        if wanted.part != "list":
            self._tf = node.create_publisher(TFMessage, "/tf", 100)

    def send(self, people: list[list[tuple[float, float, float]]], stamp_ns: int) -> None:
        """Publish one capture."""
        ids_list, transforms = self._kinds
        part, frame = self._wanted.part, self._wanted.frame
        edges = [
            edge for number, person in enumerate(people) for edge in self._edges(number, person)
        ]
        stamped(edges, frame, stamp_ns)
        if part != "list":
            roots = [edge for edge in edges if edge.header.frame_id == frame]
            self._tf.publish(transforms(transforms=roots))
        if part != "frames":
            message = ids_list(ids=[f"p{number}" for number in range(len(people))])
            stamped([message], frame, stamp_ns)
            self._ids.publish(message)
        if part != "list":
            limbs = [edge for edge in edges if edge.header.frame_id != frame]
            self._tf.publish(transforms(transforms=limbs))

    def _edges(self, number: int, person: list[tuple[float, float, float]]) -> list[Any]:
        made = []
        for joint, name in FRAMES.items():
            edge = TransformStamped(child_frame_id=f"{self._wanted.prefix}{name}_p{number}")
            edge.header.frame_id = f"{self._wanted.prefix}body_p{number}" if joint else ""
            from_place = person[0] if joint else (0.0, 0.0, 0.0)
            shift = edge.transform.translation
            pairs = zip(person[joint], from_place, strict=True)
            shift.x, shift.y, shift.z = (float(a - b) for a, b in pairs)
            made.append(edge)
        return made


class Zed:
    """Bodies of 34 keypoints, as the ZED ROS 2 wrapper publishes them."""

    def __init__(self, node: Node, wanted: argparse.Namespace) -> None:
        from zed_msgs.msg import Object, ObjectsStamped

        self._kinds = Object, ObjectsStamped
        self._frame, self._state = wanted.frame, wanted.tracking_state
        self._publisher = node.create_publisher(ObjectsStamped, wanted.topic, 10)

    def send(self, people: list[list[tuple[float, float, float]]], stamp_ns: int) -> None:
        """Publish one capture."""
        one, objects = self._kinds
        message = objects()
        for number, person in enumerate(people):
            body = one(label=f"Body_{number}", label_id=number, confidence=90.0, body_format=1)
            body.tracking_available = body.skeleton_available = True
            body.tracking_state = self._state
            keypoints = body.skeleton_3d.keypoints
            for keypoint in keypoints[:34]:
                keypoint.kp = [math.nan] * 3
            for joint, index in BODY_34.items():
                keypoints[index].kp = [float(v) for v in person[joint]]
            x, y, z = map(float, person[3])
            keypoints[LEFT_EAR].kp, keypoints[RIGHT_EAR].kp = [x, y + EAR_M, z], [x, y - EAR_M, z]
            message.objects.append(body)
        stamped([message], self._frame, stamp_ns)
        self._publisher.publish(message)


SENDERS: dict[str, Any] = {
    "pose_array": OneTopic,
    "marker_array": OneTopic,
    "ros4hri": Ros4hri,
    "zed": Zed,
}


def arguments() -> argparse.Namespace:
    """Read the command line."""
    parser = argparse.ArgumentParser(description="Publish a test person on a ROS 2 topic.")
    parser.add_argument("--topic", default="/people")
    parser.add_argument("--message", choices=list(SENDERS), default="pose_array")
    parser.add_argument("--frame", default="map")
    parser.add_argument("--rate", type=float, default=30.0, help="messages per second")
    parser.add_argument("--seconds", type=float, default=math.inf, help="stop after this time")
    parser.add_argument("--people", type=int, default=1, help="0: the room is seen and empty")
    parser.add_argument("--joints", type=int, default=len(STANDING), help="leave out the others")
    parser.add_argument("--clock", choices=list(CLOCKS), default="utc", help="clock of the stamps")
    parser.add_argument("--shift", type=float, default=0.0, help="seconds to add to the stamps")
    parser.add_argument("--left", type=float, default=0.0, help="metres to the left of (2, 0)")
    parser.add_argument("--part", choices=["list", "frames"], help="of ros4hri, this alone")
    parser.add_argument("--prefix", default="", help="of the frames of ros4hri")
    parser.add_argument("--tracking-state", type=int, default=1, help="of zed; 1: OK")
    parser.add_argument("--best-effort", action="store_true", help="QoS; default: reliable")
    return parser.parse_args()


def main() -> None:
    """Publish until stopped."""
    wanted = arguments()
    rclpy.init()
    node = Node("people_publisher")
    sender = SENDERS[wanted.message](node, wanted)
    start, sent = time.monotonic(), 0
    try:
        while time.monotonic() - start < wanted.seconds:
            at_ns = CLOCKS[wanted.clock]() + round(wanted.shift * 1e9)
            seconds = time.monotonic() - start
            people = [moving(seconds, k)[: wanted.joints] for k in range(wanted.people)]
            sender.send([[(x, y + wanted.left, z) for x, y, z in p] for p in people], at_ns)
            sent += 1
            time.sleep(max(0.0, start + sent / wanted.rate - time.monotonic()))
    except KeyboardInterrupt:
        pass
    node.destroy_node()
    rclpy.try_shutdown()


if __name__ == "__main__":
    main()
