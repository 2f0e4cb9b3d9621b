"""The contract of a link to a robot controller, and code shared by all kinds of links.

A kind of link is a class: ``LinkClass`` is the interface required of the class, ``Link`` that of an
object. ``Simulatable``, ``ChecksTogether`` and ``ObservesFleet`` are optional abilities of a class.
``hri-predict conformance link:NAME`` checks the contract on any kind.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from math import inf
from pathlib import Path
from typing import Any, ClassVar, Protocol, Self, TypeVar, runtime_checkable

from pydantic import Field

from hri_predict.base.clock import Clock
from hri_predict.base.errors import LinkError
from hri_predict.base.quantities.safe_side import LessSafe, Safety, harmless
from hri_predict.base.settings import Name, Settings
from hri_predict.contracts.repetition import MAX_REPEAT_HZ, default_interval_s
from hri_predict.protocol.keyed import Keyed
from hri_predict.protocol.messages import Advice, Message, Status
from hri_predict.protocol.reception import ReceiveCounters
from hri_predict.protocol.wire import StateShape

MIN_SILENCE_S = 0.01
"""Minimum silence timeout: a controller receives messages at most every 10 ms."""
MIN_DELAY_S = 0.0001
"""Minimum delay of a link: an 8-byte frame takes 0.11 ms at 1 Mbit/s, and drivers take longer."""
MIN_REACTION_S = 0.001
"""Minimum reaction time of a controller: the fastest have cycles of 1 ms."""
MIN_STATUS_HZ = 10.0
"""Maximum interval between Status messages, even with a longer cycle."""


class LinkSettings(Settings):
    """Settings common to all links (an entry of ``links:`` in the configuration)."""

    name: Name = Field(description="its own name, for messages and alerts")
    kind: str = Field(description="kind of wire")
    robots: list[str] | None = Field(None, description="robots advised on this link; default all")
    delay_s: float = Field(
        0.005,
        ge=MIN_DELAY_S,
        le=1,
        description="worst-case one-way delay of the link while its wire is free",
    )
    silence_timeout_s: float = Field(
        0.06,
        ge=MIN_SILENCE_S,
        le=2,
        description="silence after which the controller stops the robot",
    )
    repeat_hz: float | None = Field(
        None,
        ge=0,
        le=MAX_REPEAT_HZ,
        description="rate at which Status and Advice are repeated until the next cycle; 0: never;"
        " default: tolerates two consecutive losses (67 at 60 ms)",
    )
    reaction_s: float = Field(
        0.02,
        ge=MIN_REACTION_S,
        le=2,
        description="time from a frame's receipt until the controller begins to brake",
    )
    reserved_load: float = Field(
        0.3, ge=0, lt=1, description="fraction of the bandwidth kept free for other traffic"
    )
    zones: bool = Field(True, description="whether Zone and Pose are sent on it")
    simulate: dict[str, Any] | None = Field(
        None, description="a mock controller at the other end; see hri_sim.controllers.controller"
    )
    faults: list[dict[str, Any]] = Field(
        [], description="faults to inject; see hri_sim.faults.injector"
    )

    safety: ClassVar[Safety] = harmless("reserved_load", "zones", "repeat_hz") | {
        "delay_s": LessSafe(
            below="each advice is assumed to arrive {more:.2g} s sooner; if not, a person comes "
            "closer by 1.6 m/s times that"
        ),
        "silence_timeout_s": LessSafe(
            below="the controller is assumed to stop {more:.2g} s sooner after the node falls "
            "silent; if it does not, a person comes closer by 1.6 m/s times that"
        ),
        "reaction_s": LessSafe(
            below="the controller is assumed to brake {more:.2g} s sooner; if it does not, a "
            "person comes closer by 1.6 m/s times that"
        ),
    }

    advises: ClassVar[bool] = True
    """Whether robots receive advice on it; ``False`` for links that only read."""

    def resolved(self, base_dir: Path) -> Self:
        """Return the settings with paths resolved against the configuration's folder."""
        return self

    @property
    def repeat_s(self) -> float:
        """Interval of repeated Status and Advice; infinite: only once a cycle."""
        if self.repeat_hz is not None:
            return 1.0 / self.repeat_hz if self.repeat_hz else inf
        return default_interval_s(self.silence_timeout_s)

    @property
    def blocking_s(self) -> float:
        """Maximum time for which less urgent messages may delay an Advice."""
        return 0.0

    @property
    def notes(self) -> list[str]:
        """Notes for the user who checks the configuration, one line each."""
        return []


@dataclass(slots=True, kw_only=True)
class LinkCounters:
    """Counts of events on a link since start; nothing is lost silently."""

    messages_sent: int = 0
    bytes_sent: int = 0
    messages_received: int = 0
    bytes_received: int = 0
    superseded: int = 0  # newer one took a slot before the older was written
    decimated: int = 0  # Zone or Pose without room on the wire; what such a link does not send
    crc_errors: int = 0
    counter_errors: int = 0  # repeated, lost or out of order
    malformed: int = 0  # right CRC, wrong length, id or values
    incomplete: int = 0  # a multi-frame message whose parts do not belong together
    ignored: int = 0  # frames of other senders, which are not ours to judge
    unexpected: int = 0  # with ids that only a node sends, on a link that only listens
    echoes: int = 0  # our own frames that came back, as on udp_multicast and RS-485; harmless
    foreign: int = 0  # with ids that only this node sends, but from somebody else
    overrun: int = 0  # received, but not taken in time; the oldest RobotState goes first
    bus_errors: int = 0  # error frames that the CAN controller reported
    error_passive: int = 0  # times that it became error-passive
    bus_off: int = 0  # times that it left the bus
    advice_timeouts: int = 0  # times that the link itself stopped a robot: advice late or too old
    write_errors: int = 0
    disconnects: int = 0
    reconnects: int = 0


U = TypeVar("U")
"""A unit of the wire: the data written or read in one operation."""


class Transport(Protocol[U]):
    """A wire that carries units: ``bytes`` on serial, ``CanFrame`` on CAN.

    One thread may write while another reads; ``open`` and ``close`` are never called from two
    places at the same time. After ``close``, ``open`` may be called again.
    """

    def open(self) -> None:
        """Open the device.

        Raises:
            LinkError: one line that names the port or interface and the remedy.
        """

    def write(self, unit: U) -> None:
        """Write one unit, in bounded time.

        Raises:
            LinkError: the device is lost; as a ``TransportBusy``: the wire takes no data now.
        """

    def read(self, timeout_s: float) -> list[U]:
        """Return received data, waiting at most ``timeout_s``; empty if nothing arrived.

        Raises:
            LinkError: the device is lost.
        """

    def close(self) -> None:
        """Close the device; never raises, safe to call twice."""


R = TypeVar("R", contravariant=True)


class Receiver(Protocol[R]):
    """Decodes the units of one wire; no input makes it raise.

    Units that are ``bytes`` are a stream, which may be cut anywhere.
    """

    @property
    def counters(self) -> ReceiveCounters:
        """Counts of received units, and of refused ones by cause."""

    def feed(self, unit: R, /) -> list[Message]:
        """Return the messages completed by this unit, oldest first."""


@dataclass(frozen=True, slots=True)
class Received:
    """A message from a controller, with its time of receipt (node's clock)."""

    message: Message
    received_ns: int


class Link(Protocol):
    """A connection to a controller.

    ``post`` and ``take`` never block. In real time ``start`` runs a supervised thread that owns the
    device; on the virtual clock the thread is not started and ``service`` is called instead.

    Attributes:
        name: as configured.
        counters: see ``LinkCounters``.
        connected: whether the device is open now.
        on_sent: if set, called with (name, bytes, time) after each unit written.
        last_error: one line about the newest error, ``None`` if there was none.
        foreign_ns: time at which a second sender was last detected, by two complete frames of
            ``counters.foreign`` within half a second; ``None``: never. An echo does not count.
    """

    name: str
    counters: LinkCounters
    connected: bool
    last_error: str | None
    foreign_ns: int | None
    on_sent: Callable[[str, bytes, int], None] | None

    def start(self) -> None:
        """Open the device and start; a device absent at start raises ``LinkError``."""

    def post(self, message: Message) -> None:
        """Put a message into its newest-wins slot."""

    def take(self) -> list[Received]:
        """Return the messages received since the last call, oldest first."""

    def service(self, now_ns: int) -> None:
        """Write posted messages and read received ones, immediately in this thread."""

    def stop(self) -> None:
        """Write posted messages, then close. Safe to call twice."""


@dataclass(slots=True, kw_only=True)
class LinkLoad:
    """Load of a link: worst-case seconds of wire per second.

    Attributes:
        name: name of the link.
        load: fraction of the wire taken by Status, Advice, Schema and the controller's messages.
        spare: fraction left for Zone and Pose after ``reserved_load``.
        details: message name -> fraction.
        rate_hz, bitrate: rates for which it was computed.
        bitrates: bit rates that this kind of link may have, ascending.
    """

    name: str
    load: float
    spare: float
    details: dict[str, float] = field(default_factory=dict)
    rate_hz: float = 0.0
    bitrate: int = 0
    bitrates: tuple[int, ...] = ()


S = TypeVar("S", bound=LinkSettings)


class LinkClass(Protocol[S, U]):
    """Interface that the node requires of a kind of link: a class whose objects are ``Link``.

    ``SerialLink`` is a ``LinkClass[SerialLinkSettings, bytes]``. Code that obtains the class from
    the registry knows neither type: settings from its ``settings_model`` and units from its
    transport must be used only with the same class.
    """

    @property
    def settings_model(self) -> type[S]:
        """The model that validates an entry of ``links:`` of this kind."""

    def __call__(
        self,
        settings: S,
        clock: Clock,
        transport: Transport[U] | None = None,
        /,
        *,
        rate_hz: float = 25.0,
        robots: Sequence[int] = (0,),
        shapes: Sequence[StateShape] = (),
    ) -> Link:
        """Create a link without opening anything.

        Args:
            settings: validated by ``settings_model``, and ``resolved``.
            clock: the node's.
            transport: the wire, if not the configured device (a pipe, a fault injector).
            rate_hz: the node's cycle, from which the room for Zone and Pose follows.
            robots: indices of the robots advised on this link.
            shapes: shape of each of them; by default six joints on a fixed base.

        Raises:
            LinkError: the settings name no device, and no transport is given.
        """

    def make_transport(self, settings: S, /) -> Transport[U]:
        """Return the configured device, not yet open.

        Raises:
            LinkError: the settings name no device.
        """

    def receiver(self, settings: S, /) -> Receiver[U]:
        """Return a decoder of this link's units, for programs that only listen."""

    def load(
        self,
        settings: S,
        rate_hz: float,
        robots: Sequence[int] = (0,),
        shapes: Sequence[StateShape] = (),
        /,
    ) -> LinkLoad:
        """Return the maximum load of the wire; the node refuses a link that exceeds it.

        Raises:
            LinkError: this kind of wire cannot carry the RobotState of one of these robots.
        """


AnyLinkClass = LinkClass[LinkSettings, object]
"""Any kind of link, as returned by the registry."""


@runtime_checkable
class Simulatable(Protocol):
    """A kind of link that supports a mock controller at its other end (``simulate:``).

    Attributes:
        port_field: the settings field that names the device; the simulated cell opens a
            pseudo-terminal or its own bus, and sets the field to its name.
    """

    port_field: str


@runtime_checkable
class ChecksTogether(Protocol):
    """A kind of link in which several links can disturb each other."""

    def check_together(self, links: Sequence[Any], /) -> None:
        """Refuse settings, all of this kind, if their links would disturb each other.

        Raises:
            ConfigError: names both links and the remedy.
        """


@runtime_checkable
class ObservesFleet(Protocol):
    """A kind of link on which one program can receive from the links of all cells."""

    def observer(self, settings: Any, site: str | None, /) -> Transport[Keyed]:
        """Return an observer of Status, Advice and Schema of all cells of one or all sites."""


def check_load(load: LinkLoad, slower: Callable[[float], str] | None = None) -> None:
    """Refuse a link that cannot carry the required messages.

    ``slower`` returns the remedy for a fitting rate of Status and Advice.

    Raises:
        LinkError: one line with the load and the remedies.
    """
    if load.spare >= 0:
        return
    reserved = 1.0 - load.load - load.spare
    remedies = _remedies(load, 1.0 - reserved, slower)
    raise LinkError(
        f"link '{load.name}': {load.load:.0%} load and {reserved:.0%} reserved_load do not fit; "
        f"{' or '.join(remedies)}"
    )


def _remedies(load: LinkLoad, room: float, slower: Callable[[float], str] | None) -> Sequence[str]:
    remedies = []
    per_cycle = sum(load.details.get(message.__name__, 0.0) for message in (Status, Advice))
    rate_hz = load.rate_hz * (room - (load.load - per_cycle)) / per_cycle if per_cycle else 0.0
    if rate_hz >= MIN_STATUS_HZ:
        default = f"lower rate_hz from {load.rate_hz:g} to {int(rate_hz)}"
        remedies.append(default if slower is None else slower(rate_hz))
    needed = load.bitrate * load.load / room
    faster = next((b for b in load.bitrates if b >= needed and b > load.bitrate), None)
    if faster is not None:
        remedies.append(f"raise the bit rate from {load.bitrate} to {faster}")
    if load.load <= 1.0:
        remedies.append(f"lower reserved_load to {int((1.0 - load.load) * 100) / 100:g}")
    return remedies or ["use a faster kind of link, or fewer robots on this one"]
