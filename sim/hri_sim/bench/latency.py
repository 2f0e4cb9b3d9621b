"""The delay of a scene through the node and onto a wire, in real time.

The whole node runs: people near a moving robot, and zones and poses on the links. The other end of
a serial line is a process that takes bytes at the line's rate (``hri_sim.wires.far_end``). At a
fixed rate, scenes per second exceed ticks per second by one, to cover every phase between scenes
and ticks. With a tick for each capture, the lowest tick rate is four fifths of the source's rate.
"""

import bisect
import contextlib
import itertools
import threading
import time
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from importlib.util import find_spec
from typing import Any, Generic, TypeVar

import numpy as np

from hri_drivers.links.can.link import CanLink, CanLinkSettings
from hri_drivers.links.can.transport import CanTransport
from hri_drivers.links.serial.link import SerialLink, SerialLinkSettings
from hri_drivers.wires.transport import Transport
from hri_predict.base.clock import MonotonicClock
from hri_predict.contracts.link import LinkSettings
from hri_predict.contracts.scene import Scene
from hri_predict.node.listeners import Listener, Tick
from hri_predict.protocol.messages import Status
from hri_predict.run import assemble
from hri_predict.run.config import Config
from hri_predict.run.runtime import run_real_time
from hri_sim.bench import cell
from hri_sim.bench.rows import spread
from hri_sim.wires.child import child
from hri_sim.wires.far_end import can_adapter, serial_line
from hri_sim.wires.samples import CYCLES

U = TypeVar("U")

WARM_UP_S = 1.0  # people need a history, and first calls are slow
_CHANNELS = itertools.count()
FLOOR = 0.8
"""Ratio of ``rate_hz`` to the source's rate, with a tick for each capture."""

Wire = tuple[LinkSettings, Transport[Any]]


@contextlib.contextmanager
def _serial(baudrate: int) -> Iterator[Wire]:
    with child(serial_line, baudrate / 10) as line:
        settings = SerialLinkSettings(name="bench", port=line.receive(), baudrate=baudrate)
        yield settings, SerialLink.make_transport(settings)


@contextlib.contextmanager
def _slcan(fd: bool) -> Iterator[Wire]:
    with child(can_adapter) as adapter:
        settings = CanLinkSettings(
            name="bench",
            interface="slcan",
            channel=adapter.receive(),
            fd=fd,
            options={"sleep_after_open": 0},
        )
        yield settings, CanLink.make_transport(settings)


@contextlib.contextmanager
def _bus(interface: str, channel: str, fd: bool, **options: Any) -> Iterator[Wire]:
    """A bus within this process, with a second bus node that receives all frames."""
    settings = CanLinkSettings(
        name="bench", interface=interface, channel=channel, fd=fd, options=options
    )
    other, ended = (
        CanTransport(interface=interface, channel=channel, fd=fd, options=options),
        threading.Event(),
    )
    other.open()

    def hear() -> None:
        while not ended.is_set():
            other.read(0.1)

    thread = threading.Thread(target=hear, daemon=True)
    thread.start()
    try:
        yield settings, CanLink.make_transport(settings)
    finally:
        ended.set()
        thread.join()
        other.close()


@contextlib.contextmanager
def _zenoh() -> Iterator[Wire]:
    """Through a router to a listener, each a separate process; stamped once zenoh has the unit."""
    from hri_drivers.links.zenoh.link import ZenohLink, ZenohLinkSettings
    from hri_sim.bench.fleet_cost import routed

    with routed() as end:
        settings = ZenohLinkSettings(name="bench", cell="bench", connect=[end])
        yield settings, ZenohLink.make_transport(settings)


KINDS: dict[str, Callable[[], contextlib.AbstractContextManager[Wire]]] = {
    "serial pty 115200": lambda: _serial(115_200),
    "serial pty 921600": lambda: _serial(921_600),
    "CAN virtual": lambda: _bus("virtual", f"bench-{next(_CHANNELS)}", fd=False),
    "CAN FD virtual": lambda: _bus("virtual", f"bench-{next(_CHANNELS)}", fd=True),
    "CAN slcan pty": lambda: _slcan(fd=False),
    "CAN FD slcan pty": lambda: _slcan(fd=True),
    # no hop: it stays on this machine
    "CAN FD udp_multicast": lambda: _bus("udp_multicast", "239.74.163.2", fd=True, hop_limit=0),
}
if find_spec("zenoh") is not None:
    KINDS["zenoh router"] = _zenoh


class _Timed(Generic[U]):
    """A transport that notes when each unit was written."""

    def __init__(self, inner: Transport[U]) -> None:
        self._inner = inner
        self.open, self.read, self.close = inner.open, inner.read, inner.close
        self.written: list[tuple[int, U]] = []

    def write(self, unit: U) -> None:
        """Write, then read the clock."""
        self._inner.write(unit)
        self.written.append((time.monotonic_ns(), unit))


@dataclass(frozen=True, slots=True)
class _Seen:
    """A tick as its listener observed it; ``posted_ns``: time at which its Status was posted."""

    cycle: int
    began_ns: int
    inference_ns: int
    posted_ns: int


@dataclass
class _Watch(Listener):
    """Records the arrival of scenes, the start of ticks, and the duration of each inference."""

    inference_ns: int = 0
    posted_ns: int = 0
    arrived_ns: list[int] = field(default_factory=list)
    ticks: list[_Seen] = field(default_factory=list)

    def on_scene(self, scene: Scene, receipt_ns: int) -> None:
        """Record the scene's arrival."""
        self.arrived_ns.append(receipt_ns)

    def on_tick(self, tick: Tick) -> None:
        """Record the tick."""
        seen = _Seen(tick.status.cycle, tick.now_ns, self.inference_ns, self.posted_ns)
        self.ticks.append(seen)
        self.inference_ns = 0


def latency(
    kind: str,
    rate_hz: float,
    seconds: float,
    *,
    ticks: str = "fixed",
    predictor: str = "zero_velocity",
    people: int = 2,
) -> dict[str, Any]:
    """Run the node on a wire of this kind.

    Args:
        kind: of ``KINDS``.
        rate_hz: tick rate at a fixed rate, and capture rate of the source.
        seconds: measured time, after a warm-up.
        ticks: as in the configuration: ``fixed`` or ``capture``.
        predictor: name of the predictor.
        people: number of people near the robot.

    Returns:
        Milliseconds, p50, p99 and max: ``wait`` from a scene's arrival until the next tick begins;
        ``inference`` in that tick; ``node`` from its start until Advice and Status are posted,
        without inference; ``link`` from there until their last byte was written; ``total`` is the
        sum of these. ``scenes`` is the number of measured scenes, ``missed`` the number of ticks
        whose Status was replaced by a newer one and never written. ``ticks``, ``late_ticks``,
        ``missed_ticks``, ``sheds``, ``predictor_late``, ``superseded``, ``decimated``: counted over
        the whole run.

    Raises:
        LinkError: this machine has no such wire.
    """
    watch = _Watch()
    with KINDS[kind]() as (settings, transport):
        timed = _Timed(transport)
        config = _config(settings, rate_hz, ticks=ticks, predictor=predictor, people=people)
        assembly = assemble.build(
            config, MonotonicClock(), transports={settings.name: timed}, listeners=[watch]
        )
        _time_inference(assembly.prediction.predictor, watch)
        _time_posting(assembly.links[0], watch)
        pace = run_real_time(
            assembly=assembly, stop=threading.Event(), duration_s=WARM_UP_S + seconds
        )
        link = assembly.links[0]
        receiver = type(link).receiver(settings)  # type: ignore[attr-defined]
    written = _status_times(receiver, timed.written)
    counted = {
        "ticks": pace.ticks,
        "late_ticks": pace.late_ticks,
        "missed_ticks": pace.missed_ticks,
        "sheds": assembly.node.shedding.sheds,
        "predictor_late": assembly.prediction.counters["predictor_late"],
        "superseded": link.counters.superseded,
        "decimated": link.counters.decimated,
    }
    return {"link": kind, "rate_hz": rate_hz} | _figures(watch, written) | counted


def _config(settings: LinkSettings, rate_hz: float, *, ticks: str, **load: Any) -> Config:
    """Return the bench's cell with only this link.

    At a fixed rate, every phase between captures and ticks occurs. With a tick for each capture,
    ``rate_hz`` is the capture rate.
    """
    rates = {"rate_hz": rate_hz}
    if ticks == "capture":
        rates = {"rate_hz": FLOOR * rate_hz, "captures_hz": rate_hz}
    return replace(cell.config(**rates, ticks=ticks, **load), links=(settings,))


def _time_inference(predictor: Any, watch: _Watch) -> None:
    predict = predictor.predict

    def timed(*arguments: Any) -> Any:
        began_ns = time.monotonic_ns()
        try:
            return predict(*arguments)
        finally:
            watch.inference_ns += time.monotonic_ns() - began_ns

    predictor.predict = timed


def _time_posting(link: Any, watch: _Watch) -> None:
    post = link.post

    def timed(message: Any) -> None:
        if isinstance(message, Status):
            watch.posted_ns = time.monotonic_ns()
        post(message)

    link.post = timed


def _status_times(receiver: Any, written: Sequence[tuple[int, Any]]) -> list[tuple[int, int]]:
    """Return (time, cycle) of each Status, decoded from the written units."""
    return [
        (written_ns, message.cycle)
        for written_ns, unit in written
        for message in receiver.feed(unit)
        if isinstance(message, Status)
    ]


def _figures(watch: _Watch, written: Sequence[tuple[int, int]]) -> dict[str, Any]:
    """Match the newest scene of each tick with the first Status of its cycle written after it."""
    start_ns = watch.ticks[0].began_ns + int(WARM_UP_S * 1e9)
    waiting, rows, missed = deque(written), [], 0
    scenes_before = 0
    for tick in watch.ticks[:-1]:  # the last one announces the node's stop
        while waiting and waiting[0][0] < tick.began_ns:
            waiting.popleft()
        scenes = bisect.bisect_right(watch.arrived_ns, tick.began_ns)
        is_new, scenes_before = scenes > scenes_before, scenes
        if tick.began_ns < start_ns or not is_new:
            continue
        soon = itertools.islice(waiting, CYCLES // 2)
        written_ns = next((at for at, cycle in soon if cycle == tick.cycle % CYCLES), None)
        if written_ns is None:
            missed += 1
            continue
        node_ns = tick.posted_ns - tick.began_ns - tick.inference_ns
        wait_ns = tick.began_ns - watch.arrived_ns[scenes - 1]
        rows.append((wait_ns, tick.inference_ns, node_ns, written_ns - tick.posted_ns))
    spans_ms = np.array(rows, dtype=np.float64).reshape(-1, 4) * 1e-6
    names = ("wait_ms", "inference_ms", "node_ms", "link_ms")
    columns = dict(zip(names, spans_ms.T, strict=True))
    columns["total_ms"] = spans_ms.sum(axis=1)
    figures = {name: spread(column, 3) for name, column in columns.items() if len(column)}
    return {"scenes": len(rows), "missed": missed} | figures
