"""Faults of a link, injected between it and its wire."""

import threading
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, ClassVar, Generic, Literal, TypeVar

import numpy as np
from pydantic import Field

from hri_drivers.wires.transport import Transport
from hri_predict.base.clock import Clock
from hri_predict.base.errors import LinkError
from hri_predict.protocol.can import DEFAULT_BASE_ID, CanFrame, CanReceiver, CanSender
from hri_predict.protocol.keyed import Keyed, KeyedReceiver, KeyedSender
from hri_predict.protocol.messages import Advice, Level, NodeState, RobotState, Status
from hri_predict.protocol.reasons import Reason
from hri_predict.protocol.reception import OURS
from hri_predict.protocol.serial import SerialReceiver, SerialSender
from hri_sim.faults import settings
from hri_sim.faults.settings import FaultSettings, faults_from

# -- a second node with the same ids on one wire: it sees an empty room ----------------------------

PERIOD_NS = 40_000_000
SCHEMA_NS = 1_000_000_000
CLEAR = Advice(
    robot=0,
    level=Level.CLEAR,
    reason=Reason.NONE,
    speed_limit_m_s=5.0,
    age_s=0.03,
)
STATUS = Status(node_state=NodeState.RUNNING, reason=Reason.NONE, people=0, predictor=0, cycle=0)


class EmptyRoom:
    """Sends *clear* to every robot whose RobotState it receives, and echoes the state like a node.

    Args:
        base_id: base of the arbitration ids.
    """

    def __init__(self, base_id: int) -> None:
        self._base_id = base_id
        self._sender: Any = None
        self._receiver: Any = None
        self._echoes: dict[int, int] = {}
        self._due_ns = self._schema_ns = 0
        self._cycle = 0

    def hear(self, unit: Any) -> None:
        """Receive a unit from the wire; the sender learns the kind of wire from it."""
        if self._sender is None:
            self._sender, self._receiver = _ends(unit, self._base_id)
        for message in self._receiver.feed(unit):
            if isinstance(message, RobotState):
                self._echoes[message.robot] = message.counter

    def says(self, now_ns: int) -> list[Any]:
        """Return the units that are due by now."""
        if self._sender is None or now_ns < self._due_ns:
            return []
        self._due_ns = now_ns + PERIOD_NS
        self._cycle += 1
        messages: list[Any] = [replace(STATUS, cycle=self._cycle)]
        if now_ns >= self._schema_ns:
            self._schema_ns = now_ns + SCHEMA_NS
            messages.append(OURS)
        for robot, echo in self._echoes.items():
            messages.append(replace(CLEAR, robot=robot, echo=min(echo, 65534)))
        units: list[Any] = []
        for message in messages:
            encoded = self._sender.encode(message)
            units += encoded if isinstance(encoded, list) else [encoded]
        return units


def _ends(unit: Any, base_id: int) -> tuple[Any, Any]:
    """Return a sender and a receiver for the wire that carries such units."""
    if isinstance(unit, CanFrame):
        kind = (unit.fd, base_id, unit.extended)
        return CanSender(*kind), CanReceiver(*kind)
    if isinstance(unit, Keyed):
        return KeyedSender(), KeyedReceiver()
    return SerialSender(), SerialReceiver()


# --------------------------------------------------------------------------------------------------

U = TypeVar("U", bytes, CanFrame, Keyed)

Direction = Literal["out", "in"]
_FLUSH_S = 0.005  # longest time between two checks for delayed units that are due


class LinkFault(FaultSettings):
    """``direction``: ``out`` from the node, ``in`` to it, or ``both``."""

    direction: Literal["out", "in", "both"] = Field(
        "both", description="direction: out (from the node), in (to the node), or both"
    )


class Drop(LinkFault, settings.Drop):
    """Units are lost."""

    soak = ("", "probability=0.05")

    probability: float = Field(0.5, gt=0, le=1, description="chance that a unit is lost")


class Delay(LinkFault, settings.Delay):
    """Units arrive late, in order."""

    soak = ("delay_s=0.02", "delay_s=0.5")

    delay_s: float = Field(0.2, gt=0, le=10, description="delay of every unit")


class Jitter(LinkFault, settings.Jitter):
    """Units arrive late by a random time, still in order."""

    max_s: float = Field(
        0.05, gt=0, le=10, description="units are late by a random time up to this"
    )


class Stretch(LinkFault, settings.Late):
    """Units arrive in order, with a delay that grows by ``rate`` seconds a second, like a queue."""

    soak = ("rate=0.5",)

    rate: float = Field(0.1, gt=0, le=10, description="growth of the delay, seconds per second")

    def late_ns(self, elapsed_ns: int, rng: np.random.Generator) -> int:
        """Return the delay that has grown since the start."""
        return int(self.rate * (elapsed_ns - self.start_s * 1e9))


class BitErrors(LinkFault):
    """Each bit is flipped with probability ``rate``."""

    soak = ("rate=0.001", "rate=0.0001")

    rate: float = Field(1e-3, gt=0, le=0.5, description="chance that a bit is flipped")


class Truncate(LinkFault):
    """Units are cut short with ``probability``."""

    probability: float = Field(0.5, gt=0, le=1, description="chance that a unit is cut short")


class Freeze(LinkFault):
    """The link is silent; nothing passes."""


class Duplicate(LinkFault, settings.Duplicate):
    """Every unit arrives twice."""


class Flood(LinkFault):
    """Every unit arrives ``times`` times, as with a repeater or a runaway sender."""

    soak = ()

    times: int = Field(10, ge=2, le=100, description="number of times that every unit arrives")


class Reorder(LinkFault, settings.Reorder):
    """Every other unit arrives after its successor."""


class Unplug(LinkFault):
    """The device is gone: every call fails."""


class SecondSender(LinkFault):
    """A second node with the same ids sends *clear*; ``direction`` states the receivers.

    ``out``: the controllers; ``in``: the first node.
    """

    base_id: int = Field(DEFAULT_BASE_ID, ge=0, description="base of its arbitration ids")


LINK_FAULTS: dict[str, type[LinkFault]] = {
    "drop": Drop,
    "delay": Delay,
    "jitter": Jitter,
    "stretch": Stretch,
    "bit_errors": BitErrors,
    "truncate": Truncate,
    "freeze": Freeze,
    "duplicate": Duplicate,
    "flood": Flood,
    "reorder": Reorder,
    "unplug": Unplug,
    "second_sender": SecondSender,
}


class _Way(settings.Way[U]):
    """One direction of the wire."""

    def __init__(self, rng: np.random.Generator) -> None:
        super().__init__(rng)
        self.lock = threading.RLock()  # a link's writer and reader both flush what is late


class FaultyTransport(Generic[U]):
    """A transport with faults, itself a ``Transport``.

    A unit is the data that the link passes in one piece. On serial: the bytes of one message when
    writing, the received chunk when reading. On CAN: one frame. A delayed unit leaves at the link's
    next call of ``write`` or ``read``.

    Attributes:
        injected: number of units (calls, for ``unplug``) that each kind of fault affected.
    """

    kinds: ClassVar[Mapping[str, type[FaultSettings]]] = LINK_FAULTS

    def __init__(
        self,
        *,
        inner: Transport[U],
        faults: Sequence[dict[str, Any]],
        clock: Clock,
        seed: int,
        where: str = "link",
    ) -> None:
        """Wrap ``inner``; the faults' times count from the first ``open``.

        Raises:
            ConfigError: a fault of unknown kind or with a wrong key; ``where`` names the place.
        """
        self._inner: Transport[U] = inner
        self._faults = faults_from(faults, LINK_FAULTS, f"{where}.faults")
        self._others = [
            (f, EmptyRoom(f.base_id)) for f in self._faults if isinstance(f, SecondSender)
        ]
        self._unplugs = any(isinstance(f, Unplug) for f in self._faults)
        self._draws = any(isinstance(f, Jitter) for f in self._faults)  # even when nothing passes
        self._makes_late = any(isinstance(f, settings.Late) for f in self._faults)
        self._clock = clock
        self._start_ns: int | None = None
        # one generator for each direction: reads must not change what is written
        self._out: _Way[U] = _Way(np.random.default_rng([seed, 0]))
        self._in: _Way[U] = _Way(np.random.default_rng([seed, 1]))
        self.injected: dict[str, int] = {}

    def open(self) -> None:
        """Open the wire; this fails while the wire is unplugged."""
        if self._start_ns is None:
            self._start_ns = self._clock.now_ns()
        self._check_plugged("out")
        self._inner.open()

    def write(self, unit: U) -> None:
        """Write ``unit`` through the faults, and all delayed units that are due."""
        self._check_plugged("out")
        self._pass(self._out, "out", [unit])
        self._flush()

    def read(self, timeout_s: float) -> list[U]:
        """Return the units that have arrived by now, through the faults."""
        self._check_plugged("in")
        self._flush()
        if self._makes_late:
            timeout_s = min(timeout_s, _FLUSH_S)  # do not sleep past what is due
        arrived = self._inner.read(timeout_s)
        self._pass(self._in, "in", arrived)
        self._flush()
        return self._due(self._in) + self._from_others(arrived)

    def _from_others(self, arrived: Sequence[U]) -> list[U]:
        """Return messages of second senders to the node; also send theirs to the controllers."""
        heard: list[U] = []
        now_ns = self._clock.now_ns()
        for fault, other in self._others:
            for unit in arrived:
                other.hear(unit)
            if fault.active(now_ns - (self._start_ns or 0)):
                said = other.says(now_ns)
                self.injected[fault.kind] = self.injected.get(fault.kind, 0) + len(said)
                heard += said if fault.direction != "out" else []
                for unit in said if fault.direction != "in" else ():
                    self._inner.write(unit)
        return heard

    @property
    def device(self) -> Transport[U]:
        """The transport without faults, which reports the state of its device."""
        return self._inner

    @property
    def hung_up(self) -> bool:
        """Return whether the other end of the line is closed, if the wire can detect it."""
        return bool(getattr(self._inner, "hung_up", False))

    def close(self) -> None:
        """Close the wire; delayed units are lost."""
        for way in (self._in, self._out):
            with way.lock:
                way.late.clear()
                way.held = None
        self._inner.close()

    def _flush(self) -> None:
        with self._out.lock:
            for unit in self._due(self._out):
                self._inner.write(unit)

    def _due(self, way: _Way[U]) -> list[U]:
        with way.lock:
            return way.due(self._clock.now_ns())

    def _active(self, direction: Direction) -> list[LinkFault]:
        elapsed_ns = self._clock.now_ns() - (self._start_ns or 0)
        return [
            f for f in self._faults if f.direction in ("both", direction) and f.active(elapsed_ns)
        ]

    def _check_plugged(self, direction: Direction) -> None:
        if self._unplugs and any(isinstance(f, Unplug) for f in self._active(direction)):
            self.injected["unplug"] = self.injected.get("unplug", 0) + 1
            raise LinkError("the link is unplugged (an injected fault); it reconnects by itself")

    def _pass(self, way: _Way[U], direction: Direction, units: Sequence[U]) -> None:
        """Pass ``units`` through the list of faults, into the queue of leaving units."""
        if not units and way.held is None and not self._draws:
            return  # most reads bring nothing
        faults: list[LinkFault] = [
            f for f in self._active(direction) if not isinstance(f, SecondSender)
        ]
        passed = list(units)
        due_ns = self._clock.now_ns()
        elapsed_ns = due_ns - (self._start_ns or 0)
        for fault in faults:
            if passed:
                count = self.injected.get(fault.kind, 0)
                self.injected[fault.kind] = count + len(passed)
            if isinstance(fault, settings.Late):
                due_ns += fault.late_ns(elapsed_ns, way.rng)
            else:
                passed = [out for unit in passed for out in _altered(fault, unit, way)]
        passed += way.let_go(faults)
        with way.lock:
            if way.late:
                due_ns = max(due_ns, way.late[-1][0])  # in order, always
            way.late.extend((due_ns, unit) for unit in passed)


def _altered(fault: LinkFault, unit: U, way: _Way[U]) -> list[U]:
    if isinstance(fault, Freeze):
        return []
    if isinstance(fault, Flood):
        return [unit] * fault.times
    if not isinstance(fault, BitErrors | Truncate):
        return way.altered(fault, unit)
    data = unit if isinstance(unit, bytes) else unit.data
    if isinstance(fault, BitErrors):
        data = _flipped(data, fault.rate, way.rng)
    elif isinstance(fault, Truncate) and data and way.rng.random() < fault.probability:
        data = data[: int(way.rng.integers(len(data)))]
    if isinstance(unit, bytes):
        return [data] if data else []
    return [replace(unit, data=data)]


def _flipped(data: bytes, rate: float, rng: np.random.Generator) -> bytes:
    flips = np.packbits(rng.random(8 * len(data)) < rate)
    return (np.frombuffer(data, dtype=np.uint8) ^ flips).tobytes()
