"""The contract of a source of scenes."""

from typing import Any, Protocol

from pydantic import Field

from hri_predict.joint_map import JointMap
from hri_predict.scene import Scene
from hri_predict.settings import Pose, Region, Settings


class SourceSettings(Settings):
    """What every source has in common (``source:`` in the configuration)."""

    kind: str
    room_from_source: Pose = Field(description="pose of the source's frame in the room; required")
    min_latency_s: float = Field(
        0.0, ge=0, le=2, description="least delay from capture to stamp, which no one can measure"
    )
    stale_s: float | None = Field(
        None, gt=0, le=2, description="age at which input is stale; default 3 periods + 20 ms"
    )
    field_of_view: Region | None = Field(
        None, description="what the sensor sees (room frame); the rest counts as occupied"
    )
    faults: list[dict[str, Any]] = Field([], description="faults to inject; see hri_sim.faults")


class Source(Protocol):
    """Yields scenes as they arrive. A recording, a simulator, a live sender: nobody can tell which.

    A source never blocks: the node asks ``poll`` when ``next_ns`` says that it is worth asking.
    That one shape serves real time (a thread sleeps until ``next_ns``) and the virtual clock.

    Attributes:
        joint_map: names of the source's joints and how they become canonical ones.
        rate_hz: nominal scenes per second.
        declares_noise: ``True`` where two captures never have bit-identical joints, so that
            identical ones mean a frozen sensor.
    """

    joint_map: JointMap
    rate_hz: float
    declares_noise: bool

    def open(self, start_ns: int) -> None:
        """Start; the first scene is captured at ``start_ns`` of the node's clock or later.

        Raises:
            HriPredictError: it cannot start; the message says what to do.
        """

    def next_ns(self) -> int | None:
        """When ``poll`` may next have a scene (node's clock); ``None`` when there will be none."""

    def poll(self, now_ns: int) -> Scene | None:
        """Return the oldest scene that has arrived by ``now_ns`` and was not returned, if any."""

    def close(self) -> None:
        """Release what it holds."""
