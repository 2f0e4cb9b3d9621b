"""A link to a robot controller over a serial line (RS-232, RS-485, USB, a socket)."""

from collections.abc import Sequence
from dataclasses import replace
from itertools import combinations
from typing import ClassVar, Self
from urllib.parse import urlsplit

from pydantic import Field, field_validator, model_validator

from hri_drivers.link_codec import copy_counts
from hri_drivers.link_load import check_load, link_load
from hri_drivers.link_slots import BULK, Budget
from hri_drivers.link_thread import BULK_AHEAD_NS, SupervisedLink
from hri_drivers.serial_transport import Parity, SerialTransport, StopBits
from hri_drivers.transport import Transport
from hri_drivers.usb_ports import UsbDevice
from hri_predict.clock import Clock
from hri_predict.errors import ConfigError, LinkError
from hri_predict.link import LinkCounters, LinkLoad, LinkSettings
from hri_predict.protocol.messages import Message, Pose, Zone
from hri_predict.protocol.serial_codec import SerialReceiver, SerialSender
from hri_predict.protocol.wire import wire_bits

BITS_PER_BYTE = 10  # start bit, eight data bits, stop bit: what ``wire_bits`` counts
_NETWORK_SCHEMES = ("socket", "rfc2217")


class SerialLinkSettings(LinkSettings):
    """An entry of ``links:`` with ``kind: serial``."""

    kind: str = "serial"
    port: str | None = Field(
        None,
        min_length=1,
        description="device path or any URL of pyserial's; not needed with 'usb' or 'simulate'",
    )
    usb: UsbDevice | None = Field(
        None, description="instead of 'port': a USB adapter, found again under whatever name"
    )
    baudrate: int = Field(115_200, ge=1200, le=12_000_000)
    parity: Parity = "none"
    stop_bits: StopBits = 1
    rtscts: bool = Field(False, description="hardware handshake")
    xonxoff: bool = Field(False, description="not possible: the frames contain such bytes")
    rs485: bool = Field(False, description="the driver switches the sender by RTS (Linux)")
    robot_state_rate_hz: float = Field(
        50.0, ge=0, le=1000, description="how often the controller sends RobotState"
    )
    wait_for_device: bool = Field(
        False, description="start although the port is not there yet, and go on trying"
    )

    @field_validator("xonxoff")
    @classmethod
    def _no_xonxoff(cls, value: bool) -> bool:
        if value:
            raise ValueError("frames contain the bytes 11h and 13h; use 'rtscts', or none")
        return value

    @field_validator("port")
    @classmethod
    def _whole_address(cls, value: str | None) -> str | None:
        parts = urlsplit(value or "")
        if parts.scheme in _NETWORK_SCHEMES:
            try:
                complete = bool(parts.hostname and parts.port)
            except ValueError:  # the port is no number, or too large
                complete = False
            if not complete:
                raise ValueError(f"give host and port, such as {parts.scheme}://192.168.0.7:4001")
        return value

    @model_validator(mode="after")
    def _has_port(self) -> Self:
        if self.port is None and self.usb is None and self.simulate is None:
            raise ValueError("give 'port' (a device path or URL), 'usb', or 'simulate'")
        if self.port is not None and self.usb is not None:
            raise ValueError("give either 'port' or 'usb'")
        return self

    @property
    def bits_per_byte(self) -> int:
        """Start bit, data bits, parity bit, stop bits."""
        return 9 + (self.parity != "none") + self.stop_bits

    @property
    def bitrate_8n1(self) -> float:
        """Bit rate of the line without parity and with one stop bit that carries as much, bit/s."""
        return self.baudrate * BITS_PER_BYTE / self.bits_per_byte

    @property
    def blocking_s(self) -> float:
        """What is written ahead of the wire, and the longest frame of a Zone or Pose after it."""
        if not self.zones:
            return 0.0
        frames = (wire_bits(message, "serial").seconds(self.bitrate_8n1) for message in BULK)
        return BULK_AHEAD_NS * 1e-9 + max(frames)


class SerialCodec:
    """Messages as protected packets on a serial line; ``bitrate_8n1`` as in its settings."""

    def __init__(self, bitrate_8n1: float) -> None:
        self._sender = SerialSender()
        self._receiver = SerialReceiver()
        self._bitrate_8n1 = bitrate_8n1

    def carries(self, message: Message) -> bool:
        """Everything."""
        return True

    def encode(self, message: Message) -> list[bytes]:
        """Packets of the message, each with its delimiter."""
        return [packet + b"\0" for packet in self._sender.encode(message).split(b"\0")[:-1]]

    def decode(self, unit: bytes) -> list[Message]:
        """Messages that these bytes complete."""
        return self._receiver.feed(unit)

    def reset(self) -> None:
        """Forget what was under way."""
        self._receiver.reset()

    def count(self, counters: LinkCounters) -> None:
        """Copy the receiver's counts."""
        copy_counts(self._receiver.counters, counters)

    def worst_s(self, message: Message) -> float:
        """Seconds of wire of such a message."""
        bits = wire_bits(type(message), "serial", items=item_count(message))
        return bits.seconds(self._bitrate_8n1)

    def unit_s(self, unit: bytes) -> float:
        """Seconds of wire of these bytes."""
        return BITS_PER_BYTE * len(unit) / self._bitrate_8n1

    def raw(self, unit: bytes) -> bytes:
        """The bytes."""
        return unit

    def size(self, unit: bytes) -> int:
        """How many."""
        return len(unit)


def item_count(message: Message) -> int | None:
    """Capsules of a Zone, joints of a Pose, else ``None``."""
    if isinstance(message, Zone):
        return len(message.capsules)
    return len(message.joints) if isinstance(message, Pose) else None


class SerialLink(SupervisedLink[bytes]):
    """``hri_predict.link.Link`` over a serial line.

    Args:
        settings: the link's.
        clock: the node's.
        transport: the wire, if not the configured port (a pipe, a fault injector).
        rate_hz: the node's cycle, from which the room for Zone and Pose follows.
        robots: indices of the robots that are advised on this link.

    Raises:
        LinkError: neither a port nor a transport is given.
    """

    settings_model: ClassVar[type[SerialLinkSettings]] = SerialLinkSettings
    port_field: ClassVar[str] = "port"  # of the settings: what a simulated other end fills in

    def __init__(
        self,
        settings: SerialLinkSettings,
        clock: Clock,
        transport: Transport[bytes] | None = None,
        *,
        rate_hz: float = 25.0,
        robots: Sequence[int] = (0,),
    ) -> None:
        load = self.load(settings, rate_hz, robots)
        super().__init__(
            settings,
            clock,
            transport if transport is not None else self.make_transport(settings),
            SerialCodec(settings.bitrate_8n1),
            Budget(max(0.0, load.spare)),
            settings.wait_for_device,
        )

    @staticmethod
    def make_transport(settings: SerialLinkSettings) -> SerialTransport:
        """The configured port, not yet open.

        Raises:
            LinkError: no port is configured.
        """
        port = settings.port or settings.usb
        if port is None:
            raise LinkError(f"link '{settings.name}': no 'port'; the mock controller gives it one")
        return SerialTransport(
            port,
            settings.baudrate,
            rtscts=settings.rtscts,
            parity=settings.parity,
            stop_bits=settings.stop_bits,
            rs485=settings.rs485,
        )

    @staticmethod
    def load(
        settings: SerialLinkSettings, rate_hz: float, robots: Sequence[int] = (0,)
    ) -> LinkLoad:
        """How full the link will be; see ``check_load``."""
        load = link_load(
            settings.name,
            "serial",
            settings.bitrate_8n1,
            None,
            False,
            rate_hz,
            len(robots),
            settings.robot_state_rate_hz,
            settings.reserved_load,
        )
        return replace(load, bitrate=settings.baudrate)  # what a remedy would name

    @classmethod
    def check_load(
        cls, settings: SerialLinkSettings, rate_hz: float, robots: Sequence[int] = (0,)
    ) -> None:
        """Refuse a link that cannot carry what must always fit.

        Raises:
            LinkError: one line with the load and what would fit.
        """
        check_load(cls.load(settings, rate_hz, robots))

    @staticmethod
    def check_together(links: Sequence[SerialLinkSettings]) -> None:
        """Refuse two links on one port.

        Raises:
            ConfigError: names both, and what to change.
        """
        for a, b in combinations([link for link in links if link.simulate is None], 2):
            if (a.port, a.usb) == (b.port, b.usb):
                raise ConfigError(
                    f"links '{a.name}' and '{b.name}' are both on {a.port or 'one USB adapter'}, "
                    "which serves one; put their robots on one link, or correct 'port'"
                )

    @staticmethod
    def receiver(settings: SerialLinkSettings) -> SerialReceiver:
        """What decodes this link's units, for whoever only listens."""
        return SerialReceiver()
