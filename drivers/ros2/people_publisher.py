"""Publishes a test person on a ROS 2 topic: to try the node's ``kind: ros2``, or to start from.

Needs ROS 2 (Jazzy or later) alone. Stamp each capture with the time at which the camera looked, and
publish every capture, also when no one is there.
"""

import argparse
import math
import random
import time

import rclpy
from geometry_msgs.msg import Pose, PoseArray
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
LOOSE = {6: 0.4, 7: 0.8, 8: 1.0, 10: -0.4, 11: -0.8, 12: -1.0}  # of joints: share of the swing
CLOCKS = {
    "utc": time.time_ns,
    "boot": lambda: time.clock_gettime_ns(time.CLOCK_BOOTTIME),
    "sim": lambda: time.monotonic_ns() - _START_NS + 10**9,
    "zero": lambda: 0,
}
_START_NS = time.monotonic_ns()


def moving(seconds: float, person: int) -> list[tuple[float, float, float]]:
    """Joints of a test person who sways and moves the arms, never the same way twice, as seen by a
    sensor with 2 mm of noise. Person 0 stands at (2, 0), the next ones 1.5 m farther left each.
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
    """The joints of one person after the other."""
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


def stamped(message: PoseArray | MarkerArray, frame: str, stamp_ns: int) -> None:
    """Give the message its frame and stamp; those of markers are their own."""
    for owner in [message] if isinstance(message, PoseArray) else message.markers:
        owner.header.frame_id = frame
        owner.header.stamp.sec, owner.header.stamp.nanosec = divmod(stamp_ns, 10**9)


def arguments() -> argparse.Namespace:
    """Read the command line."""
    parser = argparse.ArgumentParser(description="Publish a test person on a ROS 2 topic.")
    parser.add_argument("--topic", default="/people")
    parser.add_argument("--message", choices=["pose_array", "marker_array"], default="pose_array")
    parser.add_argument("--frame", default="map")
    parser.add_argument("--rate", type=float, default=30.0, help="messages per second")
    parser.add_argument("--seconds", type=float, default=math.inf, help="stop after this time")
    parser.add_argument("--people", type=int, default=1, help="0: the room is seen and empty")
    parser.add_argument("--joints", type=int, default=len(STANDING), help="leave out the others")
    parser.add_argument("--clock", choices=list(CLOCKS), default="utc", help="clock of the stamps")
    parser.add_argument("--shift", type=float, default=0.0, help="seconds to add to the stamps")
    parser.add_argument("--best-effort", action="store_true", help="QoS; default: reliable")
    return parser.parse_args()


def main() -> None:
    """Publish until stopped."""
    wanted = arguments()
    rclpy.init()
    node = Node("people_publisher")
    best = ReliabilityPolicy.BEST_EFFORT if wanted.best_effort else ReliabilityPolicy.RELIABLE
    kind, make = (
        (PoseArray, pose_array) if wanted.message == "pose_array" else (MarkerArray, marker_array)
    )
    publisher = node.create_publisher(kind, wanted.topic, QoSProfile(depth=10, reliability=best))
    start, sent = time.monotonic(), 0
    try:
        while time.monotonic() - start < wanted.seconds:
            at_ns = CLOCKS[wanted.clock]() + round(wanted.shift * 1e9)
            seconds = time.monotonic() - start
            message = make([moving(seconds, k)[: wanted.joints] for k in range(wanted.people)])
            stamped(message, wanted.frame, at_ns)
            publisher.publish(message)
            sent += 1
            time.sleep(max(0.0, start + sent / wanted.rate - time.monotonic()))
    except KeyboardInterrupt:
        pass
    node.destroy_node()
    rclpy.try_shutdown()


if __name__ == "__main__":
    main()
