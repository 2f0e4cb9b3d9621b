"""People published by a ROS 2 node, for the fault table; created and serialised by rclpy."""

from pathlib import Path
from typing import Any

from geometry_msgs.msg import Point, Pose, PoseArray
from rclpy.publisher import Publisher
from rclpy.qos import qos_profile_sensor_data
from rclpy.serialization import serialize_message

from hri_drivers.wires.ros2 import SpinningNode
from hri_drivers.wires.ros2_settings import Ros2Settings
from hri_predict.contracts.scene import Scene
from hri_sim.senders.stream_ends import LiveEnd

DOMAIN = 202  # of the table alone
TOPIC, FRAME = "/hri_bench/people", "map"


class Ros2End(LiveEnd):
    """Sends a ``PoseArray`` of all people."""

    checked = False

    def __init__(self, _folder: Path) -> None:
        self.source: dict[str, Any] = {
            "kind": "ros2", "topics": [TOPIC], "frame": FRAME, "sees_room": True,
            "domain_id": DOMAIN,
        }  # fmt: skip
        self._spinning = SpinningNode(Ros2Settings(domain_id=DOMAIN, node_name="hri_bench"))
        self._publisher: Publisher | None = None

    def start(self) -> None:
        """Start a new node, which others must discover first."""
        self.stop()
        node = self._spinning.open()
        self._publisher = node.create_publisher(PoseArray, TOPIC, qos_profile_sensor_data)
        self._spinning.spin()

    def encode(self, scene: Scene) -> list[bytes]:
        """One message."""
        message = PoseArray()
        message.header.frame_id = FRAME
        message.header.stamp.sec, message.header.stamp.nanosec = divmod(scene.stamp_ns, 10**9)
        message.poses = [
            Pose(position=Point(x=float(x), y=float(y), z=float(z)))
            for person in scene.people
            for x, y, z in person.positions
        ]
        return [bytes(serialize_message(message))]

    def write(self, unit: bytes) -> None:
        """Publish the bytes as they are."""
        if self._publisher is not None:
            self._publisher.publish(unit)

    def stop(self) -> None:
        """Destroy the node."""
        self._publisher = None
        self._spinning.close()
