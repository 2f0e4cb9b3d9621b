"""Names and types of the topics that carry the node's output."""

from collections.abc import Mapping

ALL = (
    "frames", "controller_frames", "zones", "forecast", "forecast_markers", "/diagnostics",
    *(f"robot_{robot}/{what}" for robot in range(8)
      for what in ("speed_fraction", "speed_ovr", "advice")),
)  # fmt: skip
"""All topics of a link."""
TYPES = {
    "frames": "std_msgs/msg/UInt8MultiArray",
    "controller_frames": "std_msgs/msg/UInt8MultiArray",
    "speed_fraction": "std_msgs/msg/Float64",
    "speed_ovr": "std_msgs/msg/Int64",
    "advice": "std_msgs/msg/String",
    "/diagnostics": "diagnostic_msgs/msg/DiagnosticArray",
    "zones": "visualization_msgs/msg/MarkerArray",
    "forecast_markers": "visualization_msgs/msg/MarkerArray",
    "forecast": "geometry_msgs/msg/PoseArray",
}
"""Type of each topic, keyed by the last part of its name."""


def type_of(topic: str) -> str:
    """Return the type of a topic of the link, such as ``robot_0/advice``."""
    return TYPES[topic if topic in TYPES else topic.rpartition("/")[2]]


class Topics:
    """Full names of topics.

    Args:
        namespace: prefix of all topic names that are not absolute.
        remap: replacement names, relative or absolute, by topic name.
    """

    def __init__(self, namespace: str, remap: Mapping[str, str]) -> None:
        self._namespace = "/" + namespace.strip("/")
        self._remap = remap

    def full(self, topic: str) -> str:
        """Return the full name of a topic, such as ``/hri/robot_0/advice``."""
        name = self._remap.get(topic, topic)
        return name if name.startswith("/") else f"{self._namespace}/{name}"


def unknown(remap: Mapping[str, str]) -> list[str]:
    """Return the topics in ``remap`` that do not exist in the link."""
    return [topic for topic in remap if topic not in ALL]


def doubled(topics: Topics, remap: Mapping[str, str]) -> list[str]:
    """Return the full names that ``remap`` assigns to more than one topic."""
    names = [topics.full(topic) for topic in remap]
    kept = {topics.full(topic) for topic in ALL if topic not in remap}
    return sorted({name for name in names if names.count(name) > 1 or name in kept})
