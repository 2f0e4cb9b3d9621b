"""Publications on a ROS 2 node; see ``hri_predict.contracts.link.Transport``."""

import contextlib
import threading
import time
from collections import deque
from collections.abc import Callable
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseArray
from rclpy.duration import Duration
from rclpy.event_handler import PublisherEventCallbacks
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import QoSProfile, ReliabilityPolicy, qos_policy_name_from_kind
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64, Int64, String, UInt8MultiArray
from visualization_msgs.msg import MarkerArray

from hri_drivers.links.ros2.codec import FRAMES, JOINT_STATES, Publication
from hri_drivers.wires.ros2 import SpinningNode
from hri_drivers.wires.ros2_heard import Graph, Heard
from hri_drivers.wires.ros2_settings import Ros2Settings
from hri_predict.base.errors import LinkError, first_line
from hri_predict.protocol.ros.cdr import byte_array
from hri_predict.protocol.ros.link_topics import Topics, type_of

CLASSES: dict[str, Any] = {
    "std_msgs/msg/UInt8MultiArray": UInt8MultiArray,
    "std_msgs/msg/Float64": Float64,
    "std_msgs/msg/Int64": Int64,
    "std_msgs/msg/String": String,
    "diagnostic_msgs/msg/DiagnosticArray": DiagnosticArray,
    "visualization_msgs/msg/MarkerArray": MarkerArray,
    "geometry_msgs/msg/PoseArray": PoseArray,
}
EACH_PERSON = 64  # queue of topics with a message for each person and horizon
CAPACITY = 512  # received publications that wait
OWN = 256  # own frames that are remembered, for more than a second; ROS 2 gives them back
ACKNOWLEDGED_S = 0.2  # longest wait at the end for subscribers to acknowledge the last messages
LOOK_S = 1.0  # interval at which other publishers are looked for
SAY_S = 10.0  # minimum time between two equal lines


class Ros2Transport:
    """A ROS 2 node that publishes, and receives frames from other nodes and from controllers.

    Args:
        settings: the node's.
        topics: names of the topics.
        silence_s: deadline and lifespan of the advice.
        take: whether to receive frames from controllers.
        joint_states: topic of the robot's JointStates; ``None``: none.

    Attributes:
        overflowed: publications lost because they were not read in time; the oldest go first.
        say: called with one line about what others must correct, from any thread.
    """

    def __init__(
        self,
        settings: Ros2Settings,
        topics: Topics,
        *,
        silence_s: float,
        take: bool,
        joint_states: str | None = None,
    ) -> None:
        self.overflowed = 0
        self.say: Callable[[str], None] = lambda line: None
        self._spinning = SpinningNode(settings)
        self._topics = topics
        self._silence_s = silence_s
        self._heard = list(FRAMES.values()) if take else [FRAMES["node"]]
        self._joint_states = joint_states
        self._node: Node | None = None
        self._publishers: dict[str, Publisher] = {}
        self._own: deque[bytes] = deque(maxlen=OWN)
        self._arrived = threading.Condition()
        self._inbox: deque[Publication] = deque(maxlen=CAPACITY)
        self._said: dict[str, float] = {}
        self._looked_s = 0.0

    def open(self) -> None:
        """Create the node and its subscriptions.

        Raises:
            LinkError: ROS 2 does not start; one line with the remedy.
        """
        self.close()
        node = self._spinning.open()
        try:
            for topic in self._heard:
                node.create_subscription(
                    UInt8MultiArray,
                    self._topics.full(topic),
                    lambda message, topic=topic: self._hear(topic, bytes(message.data)),
                    QoSProfile(depth=EACH_PERSON),
                )
            if self._joint_states is not None:
                states = self._joint_states
                graph = Graph(lambda: node.get_publishers_info_by_topic(states))
                node.create_subscription(
                    JointState,
                    states,
                    lambda content, info: self._hear_state(content, info, graph),
                    QoSProfile(depth=EACH_PERSON, reliability=ReliabilityPolicy.BEST_EFFORT),
                    raw=True,
                )
            self._node = node
            self._publisher(FRAMES["node"])
            self._spinning.spin()
        except Exception as error:  # RCLError, InvalidHandle, ValueError of a name
            self.close()
            raise LinkError(
                f"ROS 2: {first_line(error)[:200]}; correct 'namespace' or 'remap'"
            ) from error

    def write(self, unit: Publication) -> None:
        """Publish; does not wait for subscribers.

        Raises:
            LinkError: the node is gone.
        """
        if self._node is None:
            raise LinkError("the ROS 2 node is closed; open it first")
        try:
            if unit.data:
                self._own.append(unit.data)
                self._publisher(unit.topic).publish(byte_array(unit.data))
            for topic, content in unit.plain:
                self._publisher(topic).publish(content)
        except Exception as error:  # RCLError, InvalidHandle: its context was shut down
            raise LinkError(f"ROS 2: {first_line(error)[:200]}; reopening") from error

    def read(self, timeout_s: float) -> list[Publication]:
        """Return what has arrived from others.

        Raises:
            LinkError: the node is gone.
        """
        with self._arrived:
            if not self._inbox and timeout_s > 0:
                self._arrived.wait(timeout_s)
            units = list(self._inbox)
            self._inbox.clear()
        node = self._node
        if node is None or not node.context.ok():
            raise LinkError("the ROS 2 node is closed; reopening")
        if (now_s := time.monotonic()) - self._looked_s > LOOK_S:
            self._looked_s = now_s
            self._look_for_others(node)
        return units

    def close(self) -> None:
        """Wait until the last advice is acknowledged, then destroy the node; never raises."""
        publishers, self._publishers = self._publishers, {}
        self._node = None
        until_s = time.monotonic() + ACKNOWLEDGED_S
        for publisher in publishers.values():
            left_s = until_s - time.monotonic()
            if left_s > 0:
                with contextlib.suppress(Exception):
                    publisher.wait_for_all_acked(Duration(seconds=left_s))
        self._spinning.close()
        with self._arrived:
            self._inbox.clear()
            self._arrived.notify_all()

    def _publisher(self, topic: str) -> Publisher:
        """Return a topic's publisher, created on first use: the robots are not known earlier."""
        found = self._publishers.get(topic)
        if found is None:
            assert self._node is not None
            full = self._topics.full(topic)
            events = PublisherEventCallbacks(
                incompatible_qos=lambda event: self._refused(
                    topic, qos_policy_name_from_kind(event.last_policy_kind)
                ),
                incompatible_type=lambda event: self._refused(topic, "message type"),
                use_default_callbacks=False,
            )
            found = self._publishers[topic] = self._node.create_publisher(
                _type(topic),
                full,
                quality(topic, self._silence_s),
                event_callbacks=events,
            )
        return found

    def _hear(self, topic: Any, frame: bytes) -> None:
        """Called in the node's thread."""
        if frame not in self._own:
            self._keep(Publication(frame, topic))

    def _hear_state(self, content: bytes, info: dict[str, Any], graph: Graph) -> None:
        """Called in the node's thread."""
        heard = Heard.from_ros(0, content, info, unstated=graph.gid(info))
        self._keep(Publication(heard.packed(), JOINT_STATES))

    def _keep(self, unit: Publication) -> None:
        with self._arrived:
            self.overflowed += len(self._inbox) == CAPACITY
            self._inbox.append(unit)
            self._arrived.notify_all()

    def _refused(self, topic: str, policy: str) -> None:
        self._say(
            f"{self._topics.full(topic)}: a subscriber does not receive it, because it requests "
            f"another {policy}; offered is {offered(topic, self._silence_s)}"
        )

    def _look_for_others(self, node: Node) -> None:
        """Report other publishers on this node's advice topics."""
        for topic in list(self._publishers):
            full = self._topics.full(topic)
            if topic.startswith("robot_") and (count := node.count_publishers(full)) > 1:
                self._say(
                    f"{full}: {count} publishers; another node advises this robot too: stop it, "
                    "or give one of them another 'namespace'"
                )

    def _say(self, line: str) -> None:
        now_s = time.monotonic()
        if now_s - self._said.get(line, -SAY_S) >= SAY_S:
            self._said[line] = now_s
            self.say(line)


def quality(topic: str, silence_s: float) -> QoSProfile:
    """Return the offered QoS of a topic; ``docs/guides/ros2.md`` has the table.

    Advice is reliable, keeps only the newest message, and expires after ``silence_s``. Forecasts
    are sensor data: best effort. Markers are reliable, because RViz requires it, and expire after
    half a second.
    """
    if topic == "/diagnostics":
        return QoSProfile(depth=10)
    if topic == "forecast":
        return QoSProfile(depth=EACH_PERSON, reliability=ReliabilityPolicy.BEST_EFFORT)
    if topic in ("zones", "forecast_markers"):
        return QoSProfile(depth=EACH_PERSON, lifespan=Duration(seconds=0.5))
    silence = Duration(seconds=silence_s)
    depth = EACH_PERSON if topic in FRAMES.values() else 1
    return QoSProfile(depth=depth, deadline=silence, lifespan=silence)


def offered(topic: str, silence_s: float) -> str:
    """Return the type and the QoS of a topic as text."""
    qos = quality(topic, silence_s)
    words = [_type(topic).__name__, qos.reliability.name.lower().replace("_", " "), "volatile"]
    for name, duration in (("deadline", qos.deadline), ("lifespan", qos.lifespan)):
        if 0 < duration.nanoseconds < 10**12:
            words.append(f"{name} {duration.nanoseconds * 1e-9:g} s")
    return ", ".join(words)


def _type(topic: str) -> Any:
    return CLASSES[type_of(topic)]
