"""Subscribes to the topics, and returns messages as bytes."""

import importlib
import threading
import time
from collections import deque
from collections.abc import Callable
from typing import Any

from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.node import Node
from rclpy.qos import (
    DurabilityPolicy,
    QoSProfile,
    ReliabilityPolicy,
    qos_policy_name_from_kind,
)

from hri_drivers.sources.ros2.settings import KINDS, Ros2SourceSettings
from hri_drivers.wires.ros2 import SpinningNode
from hri_drivers.wires.ros2_heard import NO_GID, TF, TF_STATIC, Graph, Heard
from hri_predict.base.errors import SourceError
from hri_predict.contracts.source import SourceCounters
from hri_predict.protocol.ros.messages import TF_MESSAGE
from hri_predict.protocol.ros.placing import READERS

WAITING = 64
"""Maximum number of waiting messages with people; the oldest are dropped."""
TRANSFORMS = 512
"""Maximum number of waiting transforms: each body of ROS4HRI has its own publisher."""
SILENT_S = 3.0
"""Time without a message after which the reason is sought,"""
LOOK_AGAIN_S = 10.0
"""and interval at which it is sought again."""


class Ros2Receiver:
    """See ``hri_drivers.sources.live.Receiver``.

    Args:
        settings: the source's.
        counters: keeps a line about publishers that cannot be received.

    Raises:
        ImportError: the package of the messages is not installed.
    """

    def __init__(self, settings: Ros2SourceSettings, counters: SourceCounters) -> None:
        self._settings = settings
        self._counters = counters
        self._spinning = SpinningNode(settings)
        self._node: Node | None = None
        self._arrived = threading.Condition()
        self._people: deque[bytes] = deque(maxlen=WAITING)
        self._transforms: deque[bytes] = deque(maxlen=TRANSFORMS)
        self._look_s = 0.0
        self._type = _imported(KINDS[settings.message])
        self._tf_type = _transforms_type(needed=settings.needs_tf)

    def open(self) -> None:
        """Start the node and subscribe.

        Raises:
            LinkError: ROS 2 cannot start.
        """
        self.close()
        node = self._spinning.open()
        for index, topic in enumerate(self._settings.topics):
            self._subscribe(node, topic, index, kind=self._type, qos=self._qos(WAITING))
        if self._tf_type is not None:
            self._subscribe(node, "/tf", TF, kind=self._tf_type, qos=self._qos(TRANSFORMS))
            latched = QoSProfile(
                depth=TRANSFORMS,
                reliability=ReliabilityPolicy.RELIABLE,
                durability=DurabilityPolicy.TRANSIENT_LOCAL,
            )
            self._subscribe(node, "/tf_static", TF_STATIC, kind=self._tf_type, qos=latched)
        self._node = node
        self._look_s = time.monotonic() + SILENT_S
        self._spinning.spin()

    def read(self, timeout_s: float) -> list[bytes]:
        """Return the units that have arrived, transforms first; wait at most ``timeout_s``.

        Raises:
            SourceError: the node is closed.
        """
        node = self._node
        if node is None:
            raise SourceError("the ROS 2 node is closed; open it first")
        with self._arrived:
            if not (self._people or self._transforms):
                self._arrived.wait(timeout_s)
            units = [*self._transforms, *self._people]
            if self._people:
                self._look_s = time.monotonic() + SILENT_S
            self._transforms.clear()
            self._people.clear()
        if time.monotonic() > self._look_s:
            self._look_s = time.monotonic() + LOOK_AGAIN_S
            self._say_who_is_missing(node)
        return units

    def close(self) -> None:
        """Stop the node; never raises, safe to call twice."""
        self._node = None
        self._spinning.close()
        with self._arrived:
            self._people.clear()
            self._transforms.clear()

    def _qos(self, depth: int) -> QoSProfile:
        """The same as rclpy's sensor data, unless ``reliability`` requires more."""
        return QoSProfile(
            depth=depth,
            reliability=ReliabilityPolicy[self._settings.reliability.upper()],
            durability=DurabilityPolicy.VOLATILE,
        )

    def _subscribe(self, node: Node, topic: str, index: int, *, kind: Any, qos: QoSProfile) -> None:
        transforms = index in (TF, TF_STATIC)  # from many publishers, by right
        queue = self._transforms if transforms else self._people
        graph = Graph(lambda: node.get_publishers_info_by_topic(topic))

        def hear(content: bytes, info: dict[str, Any]) -> None:
            gid = NO_GID if transforms else graph.gid(info)
            unit = Heard.from_ros(index, content, info, unstated=gid).packed()
            with self._arrived:
                queue.append(unit)
                self._arrived.notify_all()

        node.create_subscription(
            kind,
            topic,
            hear,
            qos,
            raw=True,
            event_callbacks=SubscriptionEventCallbacks(
                incompatible_qos=self._refused_by_qos(topic),
                use_default_callbacks=False,
            ),
        )

    def _refused_by_qos(self, topic: str) -> Callable[[Any], None]:
        def note(event: Any) -> None:
            policy = qos_policy_name_from_kind(event.last_policy_kind).lower()
            self._counters.refused += 1
            self._counters.note(
                f"{topic}: a publisher offers another {policy} than is asked for, and is not "
                f"heard; correct its QoS, or 'reliability'"
            )

        return note

    def _say_who_is_missing(self, node: Node) -> None:
        """Note the first topic that no node publishes as configured, and those that exist
        instead."""
        wanted = KINDS[self._settings.message]
        for topic in self._settings.topics:
            kinds = {info.topic_type for info in node.get_publishers_info_by_topic(topic)}
            if kinds and wanted not in kinds:
                self._counters.note(
                    f"{topic}: is {min(kinds)}, not {wanted}; correct 'message' or 'topics'"
                )
                return
            if not kinds:
                self._counters.note(
                    f"{topic}: no publisher; start it, or correct 'topics', 'domain_id' or "
                    f"'discovery'{self._instead(node)}"
                )
                return

    def _instead(self, node: Node) -> str:
        possible = sorted(
            f"{topic} ({kinds[0].rsplit('/', 1)[-1]})"
            for topic, kinds in node.get_topic_names_and_types()
            if kinds[0] in READERS and topic not in self._settings.topics
        )
        return f"; available: {', '.join(possible[:5])}" if possible else ""


def _imported(kind: str) -> Any:
    """The class of a message type.

    Raises:
        ImportError: its package is not installed.
    """
    package, _, name = kind.split("/")
    return getattr(importlib.import_module(f"{package}.msg"), name)


def _transforms_type(*, needed: bool) -> Any:
    """The class of ``/tf``'s messages, which the extra does not include; ``None``: not installed.

    Raises:
        ImportError: likewise, and it is needed.
    """
    try:
        return _imported(TF_MESSAGE)
    except ImportError:
        if needed:
            raise
        return None
