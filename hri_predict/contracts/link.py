"""The contract of a link to a robot controller, and what every kind of link shares.

A kind of link is a class: ``LinkClass`` says what the node asks of the class, ``Link`` what it asks
of an object. ``Simulatable``, ``ChecksTogether`` and ``ObservesFleet`` are abilities that a class
may have or lack. ``hri-predict conformance link:NAME`` checks the contract on any kind.
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
"""No controller stops after less silence: it hears from the node at most every 10 ms."""
MIN_DELAY_S = 0.0001
"""No wire is faster: an 8-byte frame takes 0.11 ms at 1 Mbit/s, and drivers take longer."""
MIN_REACTION_S = 0.001
"""No controller begins to brake sooner: the fastest have cycles of 1 ms."""
MIN_STATUS_HZ = 10.0
"""Maximum interval between Status messages, even where the node's cycle is longer."""


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
        description="silence after which the controller stops by itself",
    )
    repeat_hz: float | None = Field(
        None,
        ge=0,
        le=MAX_REPEAT_HZ,
        description="rate at which Status and Advice are repeated until the next cycle; 0: never;"
        " default: the rate at which two lost in a row are not yet silence (67 at 60 ms)",
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
            below="the robot is expected to hear each advice {more:.2g} s sooner; if it does not, a"
            " person comes 1.6 m/s times that nearer"
        ),
        "silence_timeout_s": LessSafe(
            below="the controller is expected to stop {more:.2g} s sooner after the node fell "
            "silent; if it does not, a person comes 1.6 m/s times that nearer"
        ),
        "reaction_s": LessSafe(
            below="the controller is expected to brake {more:.2g} s sooner; if it does not, a "
            "person comes 1.6 m/s times that nearer"
        ),
    }

    advises: ClassVar[bool] = True
    """Whether robots hear their advice on it; ``False`` of links that only read."""

    def resolved(self, base_dir: Path) -> Self:
        """The same with its files found from ``base_dir``, where the configuration lies."""
        return self

    @property
    def repeat_s(self) -> float:
        """Interval after which Status and Advice are sent again; infinite: only once a cycle."""
        if self.repeat_hz is not None:
            return 1.0 / self.repeat_hz if self.repeat_hz else inf
        return default_interval_s(self.silence_timeout_s)

    @property
    def blocking_s(self) -> float:
        """Maximum time for which less urgent messages may keep an Advice off the wire."""
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
    unexpected: int = 0  # with ids that only a node sends: our own frames that came back
    foreign: int = 0  # with ids that only this node sends, but from somebody else
    overrun: int = 0  # received, but not taken in time; the oldest RobotState goes first
    bus_errors: int = 0  # error frames that the CAN controller reported
    error_passive: int = 0  # times that it became error-passive
    bus_off: int = 0  # times that it left the bus
    write_errors: int = 0
    disconnects: int = 0
    reconnects: int = 0


U = TypeVar("U")
"""A unit of the wire: what goes onto it, and comes off it, at once."""


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
            LinkError: the device is lost; as a ``hri_drivers.wires.transport.TransportBusy``, the
                wire takes nothing now, try again later.
        """

    def read(self, timeout_s: float) -> list[U]:
        """Return what has come, waiting at most ``timeout_s``; empty if nothing came.

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
        """Messages that this unit completes, oldest first."""


@dataclass(frozen=True, slots=True)
class Received:
    """A message that came from a controller, with its time of receipt (node's clock)."""

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
        on_sent: called with (name, bytes, time) after each unit written, where set.
        last_error: one line about the newest trouble, ``None`` if there was none.
        foreign_ns: when a second sender was last proved: two whole frames, within half a second,
            with ids which only this node sends, and that this node did not send
            (``counters.foreign``); ``None`` if there was none. An echo is not one.
    """

    name: str
    counters: LinkCounters
    connected: bool
    last_error: str | None
    foreign_ns: int | None
    on_sent: Callable[[str, bytes, int], None] | None

    def start(self) -> None:
        """Open the device and begin; a device that is absent at start is a ``LinkError``."""

    def post(self, message: Message) -> None:
        """Put a message into its newest-wins slot."""

    def take(self) -> list[Received]:
        """Return what was received since the last call, oldest first."""

    def service(self, now_ns: int) -> None:
        """Write what is posted and read what has come, now and in this thread."""

    def stop(self) -> None:
        """Write what is posted, then close. Safe to call twice."""


@dataclass(slots=True, kw_only=True)
class LinkLoad:
    """Load of a link: worst-case seconds of wire per second.

    Attributes:
        name: the link's.
        load: fraction of the wire taken by Status, Advice, Schema and what the controller sends.
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
    the registry knows neither: settings that its ``settings_model`` made, and units that its
    transport gave, are for the same class alone.
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
        """Make a link; nothing is opened yet.

        Args:
            settings: validated by ``settings_model``, and ``resolved``.
            clock: the node's.
            transport: the wire, if not the configured device (a pipe, a fault injector).
            rate_hz: the node's cycle, from which the room for Zone and Pose follows.
            robots: indices of the robots that are advised on this link.
            shapes: shape of each of them; if left out, six joints on a base that stands.

        Raises:
            LinkError: the settings name no device, and no transport is given.
        """

    def make_transport(self, settings: S, /) -> Transport[U]:
        """The configured device, not yet open.

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
        """Return the maximum load of the wire; the node refuses what does not fit.

        Raises:
            LinkError: this kind of wire cannot carry the RobotState of one of these robots.
        """


AnyLinkClass = LinkClass[LinkSettings, object]
"""A kind of link by its name alone, as the registry gives it."""


@runtime_checkable
class Simulatable(Protocol):
    """A kind of link at whose other end a mock controller can be (``simulate:``).

    Attributes:
        port_field: the field of its settings that names the device; the simulated cell opens a
            pseudo-terminal, or a bus of its own, and puts its name there.
    """

    port_field: str


@runtime_checkable
class ChecksTogether(Protocol):
    """A kind of link of which several can disturb each other."""

    def check_together(self, links: Sequence[Any], /) -> None:
        """Refuse settings, all of this kind, whose links would disturb each other.

        Raises:
            ConfigError: names both, and what to change.
        """


@runtime_checkable
class ObservesFleet(Protocol):
    """A kind of link on which one program can hear the links of all cells."""

    def observer(self, settings: Any, site: str | None, /) -> Transport[Keyed]:
        """Return an observer of Status, Advice and Schema of all cells of one or all sites."""


def check_load(load: LinkLoad, slower: Callable[[float], str] | None = None) -> None:
    """Refuse a link that cannot carry what must always fit.

    ``slower`` names the remedy for the rate of Status and Advice that would fit.

    Raises:
        LinkError: one line with the load and what would fit.
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
