"""The contract of a link to a robot controller, and what every kind of link shares."""

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Protocol, Self

from pydantic import Field

from hri_predict.protocol.messages import Message
from hri_predict.settings import Settings


class LinkSettings(Settings):
    """What every link has in common (an entry of ``links:`` in the configuration)."""

    name: str = Field(min_length=1)
    kind: str
    robots: list[str] | None = Field(None, description="robots advised on this link; default all")
    delay_s: float = Field(
        0.005, ge=0, le=1, description="one-way delay of the link at worst, its wire being free"
    )
    silence_timeout_s: float = Field(
        0.15, gt=0, le=2, description="after how much silence the controller stops by itself"
    )
    reaction_s: float = Field(
        0.05, ge=0, le=2, description="from a frame's receipt until the controller begins to brake"
    )
    reserved_load: float = Field(
        0.3, ge=0, lt=1, description="fraction of the wire kept free for others"
    )
    zones: bool = Field(True, description="whether Zone and Pose are sent on it")
    simulate: dict[str, Any] | None = Field(
        None, description="a mock controller at the other end; see hri_sim.controller"
    )
    faults: list[dict[str, Any]] = Field([], description="faults to inject; see hri_sim.faults")

    def resolved(self, base_dir: Path) -> Self:
        """The same with its files found from ``base_dir``, where the configuration lies."""
        return self

    @property
    def blocking_s(self) -> float:
        """How long an Advice may find the wire taken by what is not urgent, at worst."""
        return 0.0

    @property
    def notes(self) -> list[str]:
        """What whoever checks the configuration should know of this link, one line each."""
        return []


@dataclass(slots=True)
class LinkCounters:
    """What happened on a link since start; nothing is lost silently."""

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
    unexpected: int = 0  # right, but nothing that a controller sends: our own, or another node's
    overrun: int = 0  # received, but not taken in time; the oldest RobotState goes first
    bus_errors: int = 0  # error frames that the CAN controller reported
    error_passive: int = 0  # times that it became error-passive
    bus_off: int = 0  # times that it left the bus
    write_errors: int = 0
    disconnects: int = 0
    reconnects: int = 0


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
    """

    name: str
    counters: LinkCounters
    connected: bool
    last_error: str | None
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


@dataclass(slots=True)
class LinkLoad:
    """How full a link is: worst-case seconds of wire per second.

    Attributes:
        name: the link's.
        load: fraction of the wire taken by Status, Advice, Schema and what the controller sends.
        spare: fraction left for Zone and Pose after ``reserved_load``.
        details: message name -> fraction.
        rate_hz, bitrate: what it was computed for.
        bitrates: bit rates that this kind of link may have, ascending.
    """

    name: str
    load: float
    spare: float
    details: dict[str, float] = field(default_factory=dict)
    rate_hz: float = 0.0
    bitrate: int = 0
    bitrates: tuple[int, ...] = ()
