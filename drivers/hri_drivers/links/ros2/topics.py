"""Names of the link's topics."""

from collections.abc import Mapping

ALL = (
    "frames", "controller_frames", "zones", "forecast", "forecast_markers", "/diagnostics",
    *(f"robot_{robot}/{what}" for robot in range(8)
      for what in ("speed_fraction", "speed_ovr", "advice")),
)  # fmt: skip
"""All topics of a link."""


class Topics:
    """Full names of topics.

    Args:
        namespace: put before the names of all topics that are not absolute.
        remap: other names, relative or absolute, by the topic's own.
    """

    def __init__(self, namespace: str, remap: Mapping[str, str]) -> None:
        self._namespace = "/" + namespace.strip("/")
        self._remap = remap

    def full(self, topic: str) -> str:
        """Return the full name of a topic, such as ``/hri/robot_0/advice``."""
        name = self._remap.get(topic, topic)
        return name if name.startswith("/") else f"{self._namespace}/{name}"


def unknown(remap: Mapping[str, str]) -> list[str]:
    """Return the topics in ``remap`` that the link does not have."""
    return [topic for topic in remap if topic not in ALL]


def doubled(topics: Topics, remap: Mapping[str, str]) -> list[str]:
    """Return full names that ``remap`` gives to more than one topic."""
    names = [topics.full(topic) for topic in remap]
    kept = {topics.full(topic) for topic in ALL if topic not in remap}
    return sorted({name for name in names if names.count(name) > 1 or name in kept})
