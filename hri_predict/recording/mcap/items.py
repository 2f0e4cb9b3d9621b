"""Inputs and outputs of the node, as items of a recording.

The receiving code decides whether to write each immediately or hold it for a while.
Arrays are decimated and copied when an item is created, so the node may reuse its own.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from hri_predict.contracts.link import Received
from hri_predict.contracts.predictor import Forecast
from hri_predict.contracts.scene import Scene
from hri_predict.node.listeners import Listener, Tick
from hri_predict.people.snapshot import PeopleSnapshot
from hri_predict.recording.mcap import view
from hri_predict.recording.mcap.format import (
    forecast_to_dict,
    message_to_dict,
    scene_to_dict,
    sent_to_json,
    zones_to_dict,
)
from hri_predict.recording.mcap.info import RecordingInfo
from hri_predict.recording.mcap.schemas import advice_topic
from hri_predict.recording.mcap.to_dict import advice_to_dict, status_to_dict
from hri_predict.zones.types import Zones

Counters = Callable[[], Mapping[str, Any]]
"""Gives counters of the node and its links, as the loop's thread sees them."""

_SECOND_NS = 1_000_000_000


@dataclass(frozen=True, slots=True)
class Item:
    """A message of a recording, not yet encoded.

    ``log_ns`` is of the node's clock. ``encode`` gives its content, or already its JSON; with
    ``wants_utc`` it takes its UTC as a last argument.
    """

    topic: str
    log_ns: int
    encode: Callable[..., dict[str, Any] | bytes]
    args: tuple[Any, ...]
    wants_utc: bool = False


@dataclass(frozen=True, slots=True, kw_only=True)
class Rates:
    """Rates at which bulky data are kept; scenes, states and advice always are.

    Attributes:
        zones_hz, poses_hz: zones and forecasts per second; 0: none.
        view_hz: pictures per second for 3D views; 0: none.
        sent: keep what links wrote, byte for byte.
        horizon_stride: keep every n-th step of forecasts and zones.
    """

    zones_hz: float = 5.0
    poses_hz: float = 5.0
    view_hz: float = 5.0
    sent: bool = True
    horizon_stride: int = 5


class Every:
    """Determines, at each tick, whether an action of rate ``hz`` is due."""

    def __init__(self, hz: float) -> None:
        self._period_ns = round(1e9 / hz) if hz > 0 else None
        self._next_ns: int | None = None

    def is_due(self, now_ns: int) -> bool:
        """Whether the action is due at this tick; it always is at the first."""
        if self._period_ns is None:
            return False
        if self._next_ns is not None and now_ns < self._next_ns:
            return False
        begun_ns = now_ns if self._next_ns is None else self._next_ns
        missed = (now_ns - begun_ns) // self._period_ns
        self._next_ns = begun_ns + (missed + 1) * self._period_ns
        return True


class Items(Listener):
    """A listener that turns all input and output into items. A subclass takes them.

    Args:
        info: description of the recording.
        rates: see ``Rates``.
        counters: asked once a second; ``None``: they are not kept.
    """

    def __init__(
        self, info: RecordingInfo, rates: Rates | None = None, counters: Counters | None = None
    ) -> None:
        self._about, self._rates, self._counters = info, rates or Rates(), counters
        self._names = tuple(name for name, _ in info.robots)
        self._zones_due = Every(self._rates.zones_hz)
        self._poses_due = Every(self._rates.poses_hz)
        self._view_due = Every(self._rates.view_hz)
        self._counters_due, self._frames_due = Every(1.0), Every(1.0)

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
        now_ns, assessment = tick.now_ns, tick.assessment
        about = tick.reasons, tick.named_zones
        self._put("/status", now_ns, status_to_dict, tick.status, now_ns, *about)
        for advice in tick.advices:
            robot, why = self._robot(advice.robot), tick.grounds(advice.robot)
            topic = advice_topic(robot[0])
            self._put(topic, now_ns, advice_to_dict, advice, now_ns, robot, why)
        snapshot, forecast = tick.snapshot, tick.forecast
        there = snapshot is not None and bool(snapshot.ids) and forecast is not None
        if there and self._poses_due.is_due(now_ns):
            assert snapshot is not None
            assert forecast is not None
            self._forecast(snapshot, forecast)
        if assessment is not None and assessment.zones.ids and self._zones_due.is_due(now_ns):
            self._zones(now_ns, assessment.zones)
        self._shown(tick)
        if self._counters is not None and self._counters_due.is_due(now_ns):
            people = dict(tick.snapshot.counters) if tick.snapshot is not None else {}
            self._put("/node", now_ns, _node_to_dict, now_ns, people, self._counters())

    def _robot(self, robot: int) -> tuple[str, tuple[str, ...]]:
        return self._about.robots[robot] if robot < len(self._about.robots) else (str(robot), ())

    def _shown(self, tick: Tick) -> None:
        if not self._view_due.is_due(tick.now_ns):
            return
        lifetime_s = 2.0 / self._rates.view_hz  # one that is lost makes no gap
        picture = view.seen(tick, self._names, lifetime_s)
        self._put("/view/scene", tick.now_ns, view.scene_update, picture, wants_utc=True)
        if picture.people:
            self._put("/view/people", tick.now_ns, view.people_poses, picture, wants_utc=True)
        if self._about.frames and self._frames_due.is_due(tick.now_ns):
            frames = view.frame_transforms
            self._put("/view/frames", tick.now_ns, frames, self._about, wants_utc=True)

    def _forecast(self, snapshot: PeopleSnapshot, forecast: Forecast) -> None:
        """The decimated steps are copied here, so the caller may reuse its arrays."""
        count, stride = forecast.positions.shape[1], self._rates.horizon_stride
        steps = list(range(stride - 1, count, stride)) or [count - 1]
        captures = [int(c) for c in snapshot.capture_ns]
        kept, now_ns = forecast.positions[:, steps], snapshot.now_ns
        what = forecast_to_dict, snapshot.ids, captures, steps, kept
        self._put("/forecast", now_ns, _stamped, now_ns, *what)

    def _zones(self, now_ns: int, zones: Zones) -> None:
        """The decimated horizons (the first, the body now, always) are copied here."""
        capsules = zones.capsules
        kept = np.arange(0, capsules.radius.shape[1], self._rates.horizon_stride)
        packed = np.concatenate(
            (capsules.a[:, kept], capsules.b[:, kept], capsules.radius[:, kept, :, None]), axis=-1
        )
        times_s = np.asarray(zones.times_s)[kept]
        what = zones_to_dict, zones.ids, zones.segments, times_s, packed
        self._put("/zones", now_ns, _stamped, now_ns, *what)

    def sent(self, link: str, unit: Any, now_ns: int) -> None:
        """``unit`` (bytes, or a CAN frame) was written to ``link``."""
        if not self._rates.sent:
            return
        if isinstance(unit, bytes | bytearray | memoryview):
            self._put("/sent", now_ns, sent_to_json, link, None, bytes(unit))
        else:
            self._put("/sent", now_ns, sent_to_json, link, unit.arbitration_id, bytes(unit.data))

    def _put(
        self,
        topic: str,
        log_ns: int,
        encode: Callable[..., dict[str, Any] | bytes],
        *args: Any,
        wants_utc: bool = False,
    ) -> None:
        self.take(Item(topic, log_ns, encode, args, wants_utc))


def _stamped(now_ns: int, encode: Callable[..., dict[str, Any]], *args: Any) -> dict[str, Any]:
    return {"now_ns": now_ns, **encode(*args)}


def _received_to_dict(link: str, received: Received) -> dict[str, Any]:
    fields = message_to_dict(received.message)
    return {"link": link, "received_ns": received.received_ns, **fields}


def _node_to_dict(
    now_ns: int, people: Mapping[str, int], counters: Mapping[str, Any]
) -> dict[str, Any]:
    return {"now_ns": now_ns, "people": people, "node": {}, "links": {}, **counters}
