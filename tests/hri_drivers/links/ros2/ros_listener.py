"""A program: subscribes to topics as anyone's node does, and prints each message as a JSON line."""

import contextlib
import json
import sys
import time
from typing import Any

import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseArray
from rclpy.duration import Duration
from rclpy.executors import ExternalShutdownException
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from std_msgs.msg import Float64, Int64, String, UInt8MultiArray
from visualization_msgs.msg import MarkerArray

TYPES = {
    "advice": String,
    "speed_fraction": Float64,
    "speed_ovr": Int64,
    "frames": UInt8MultiArray,
    "diagnostics": DiagnosticArray,
    "zones": MarkerArray,
    "forecast_markers": MarkerArray,
    "forecast": PoseArray,
}
QOS = {
    "default": QoSProfile(depth=10),  # of `ros2 topic echo`, and RViz's markers
    "sensor": QoSProfile(depth=10, reliability=ReliabilityPolicy.BEST_EFFORT),
    "impatient": QoSProfile(depth=10, deadline=Duration(seconds=0.001)),
    "latched": QoSProfile(depth=10, durability=DurabilityPolicy.TRANSIENT_LOCAL),
}


def shown(message: Any) -> Any:
    """The part of a message that a test looks at."""
    if isinstance(message, DiagnosticArray):
        return [(status.name, status.level[0], status.message) for status in message.status]
    if isinstance(message, MarkerArray):
        return [(marker.ns, marker.id, marker.color.r) for marker in message.markers]
    if isinstance(message, PoseArray):
        return [(p.position.x, p.position.y, p.position.z) for p in message.poses]
    return list(message.data) if isinstance(message, UInt8MultiArray) else message.data


def main() -> None:
    rclpy.init()
    node = rclpy.create_node("listener")

    def print_from(topic: str) -> Any:
        def heard(message: Any) -> None:
            row = {"topic": topic, "at": time.time(), "data": shown(message)}
            print(json.dumps(row), flush=True)

        return heard

    for argument in sys.argv[1:]:
        topic, _, qos = argument.partition("=")
        kind = TYPES[topic.rpartition("/")[2]]
        node.create_subscription(kind, topic, print_from(topic), QOS[qos or "default"])
    with contextlib.suppress(KeyboardInterrupt, ExternalShutdownException):
        rclpy.spin(node)


if __name__ == "__main__":
    main()
