"""What the node takes in and gives out, as items that a recording may hold.

Whoever keeps them decides what to do with each: write it at once, or hold it for a while. Arrays
are decimated and copied when an item is made, so that the node may use its own again.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from hri_predict.link import Received
from hri_predict.node.listeners import Listener, Tick
from hri_predict.people.snapshot import PeopleSnapshot
from hri_predict.predictors.base import Forecast
from hri_predict.recording.mcap.format import (
    forecast_to_dict,
    message_to_dict,
    scene_to_dict,
    sent_to_dict,
    zones_to_dict,
)
from hri_predict.risk.types import Zones
from hri_predict.scene import Scene


@dataclass(frozen=True, slots=True)
class Item:
    """A message of a recording, not yet encoded."""

    topic: str
    log_ns: int
    encode: Callable[..., dict[str, Any]]
    args: tuple[Any, ...]


class Items(Listener):
    """A listener that turns all input and output into items. A subclass takes them.

    Args:
        horizon_stride: keep every n-th step of forecast and zones.
        zones_every: keep the zones of every n-th tick; they are the bulkiest, and follow from the
            forecast.
    """

    def __init__(self, *, horizon_stride: int = 5, zones_every: int = 5) -> None:
        self._stride, self._zones_every = max(1, horizon_stride), max(1, zones_every)
        self._ticks = 0

    def take(self, item: Item) -> None:
        """Take one item; from any thread, without waiting."""
        raise NotImplementedError

    def on_scene(self, scene: Scene, receipt_ns: int) -> None:
        """A scene was received."""
        self._put("/scene", receipt_ns, scene_to_dict, scene, receipt_ns)

    def on_received(self, link: str, received: Received) -> None:
        """A controller's message was received on ``link``."""
        self._put("/received", received.received_ns, _received_to_dict, link, received)

    def on_tick(self, tick: Tick) -> None:
        """A tick is over; what it computed is recorded, in shadow mode too."""
        self._put("/status", tick.now_ns, message_to_dict, tick.status)
        for advice in tick.advices:
            self._put("/advice", tick.now_ns, message_to_dict, advice)
        if tick.forecast is not None and tick.snapshot is not None and tick.snapshot.ids:
            self._forecast(tick.snapshot, tick.forecast)
        due = self._ticks % self._zones_every == 0
        self._ticks += 1
        if due and tick.assessment is not None and tick.assessment.zones.ids:
            self._zones(tick.now_ns, tick.assessment.zones)

    def _forecast(self, snapshot: PeopleSnapshot, forecast: Forecast) -> None:
        """The decimated steps are copied here, so the caller may reuse its arrays."""
        count = forecast.positions.shape[1]
        steps = list(range(self._stride - 1, count, self._stride)) or [count - 1]
        captures = [int(c) for c in snapshot.capture_ns]
        kept = forecast.positions[:, steps]
        self._put(
            "/forecast", snapshot.now_ns, forecast_to_dict, snapshot.ids, captures, steps, kept
        )

    def _zones(self, now_ns: int, zones: Zones) -> None:
        """The decimated horizons (the first, the body now, always) are copied here."""
        capsules = zones.capsules
        kept = np.arange(0, capsules.radius.shape[1], self._stride)
        packed = np.concatenate(
            (capsules.a[:, kept], capsules.b[:, kept], capsules.radius[:, kept, :, None]), axis=-1
        )
        times_s = np.asarray(zones.times_s)[kept]
        self._put("/zones", now_ns, zones_to_dict, zones.ids, zones.segments, times_s, packed)

    def sent(self, link: str, unit: Any, now_ns: int) -> None:
        """``unit`` (bytes, or a CAN frame) was written to ``link``."""
        if isinstance(unit, bytes | bytearray | memoryview):
            self._put("/sent", now_ns, sent_to_dict, link, None, bytes(unit))
        else:
            self._put("/sent", now_ns, sent_to_dict, link, unit.arbitration_id, bytes(unit.data))

    def _put(
        self, topic: str, log_ns: int, encode: Callable[..., dict[str, Any]], *args: Any
    ) -> None:
        self.take(Item(topic, log_ns, encode, args))


def _received_to_dict(link: str, received: Received) -> dict[str, Any]:
    fields = message_to_dict(received.message)
    return {"link": link, "received_ns": received.received_ns, **fields}
