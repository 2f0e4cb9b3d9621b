"""A link to a robot controller over a serial line (RS-232, RS-485, USB, a socket)."""

from collections.abc import Sequence
from itertools import combinations
from typing import ClassVar, Self
from urllib.parse import urlsplit

from pydantic import Field, field_validator, model_validator

from hri_drivers.links.framed import BITS_PER_BYTE, FramedLink, FramedLinkSettings
from hri_drivers.wires.serial import Parity, SerialTransport, StopBits, demand_serial_device
from hri_drivers.wires.usb_ports import UsbDevice
from hri_predict.base.errors import ConfigError, LinkError
from hri_predict.base.quantities.safe_side import Safety, harmless

_NETWORK_SCHEMES = ("socket", "rfc2217")


class SerialLinkSettings(FramedLinkSettings):
    """An entry of ``links:`` with ``kind: serial``."""

    kind: str = "serial"
    port: str | None = Field(
        None,
        min_length=1,
        description="device path or pyserial URL; not needed with 'usb' or 'simulate'",
    )
    usb: UsbDevice | None = Field(
        None,
        description="instead of 'port': a USB adapter, identified independently of its port name",
    )
    baudrate: int = Field(
        115_200,
        ge=1200,
        le=12_000_000,
        description="bit rate of the line, same as the controller's; 115200 carries the advice, "
        "and 921600 zones and poses, too",
    )
    parity: Parity = Field("none", description="parity bit, same as the controller's")
    stop_bits: StopBits = Field(1, description="stop bits, same as the controller's")
    rtscts: bool = Field(False, description="hardware handshake")
    xonxoff: bool = Field(False, description="not possible: frames contain the XON and XOFF bytes")
    rs485: bool = Field(False, description="the driver switches the transmitter with RTS (Linux)")

    safety: ClassVar[Safety] = harmless("baudrate", "stop_bits", "rtscts", "xonxoff", "rs485")

    @field_validator("xonxoff")
    @classmethod
    def _no_xonxoff(cls, value: bool) -> bool:
        if value:
            raise ValueError("frames contain the bytes 11h and 13h; use 'rtscts', or no handshake")
        return value

    @field_validator("port")
    @classmethod
    def _whole_address(cls, value: str | None) -> str | None:
        parts = urlsplit(value or "")
        if parts.scheme in _NETWORK_SCHEMES:
            try:
                complete = bool(parts.hostname and parts.port)
            except ValueError:  # the port is not a number, or too large
                complete = False
            if not complete:
                raise ValueError(f"give host and port, such as {parts.scheme}://192.168.0.7:4001")
        return None if value is None else demand_serial_device(value)

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
        """Bit rate of an equally fast line without parity and with one stop bit, bit/s."""
        return self.baudrate * BITS_PER_BYTE / self.bits_per_byte


class SerialLink(FramedLink[SerialLinkSettings]):
    """``contracts.link.Link`` over a serial line; arguments as for ``ConfiguredLink``."""

    settings_model: ClassVar[type[SerialLinkSettings]] = SerialLinkSettings
    port_field: ClassVar[str] = "port"  # see ``Simulatable``

    @staticmethod
    def make_transport(settings: SerialLinkSettings) -> SerialTransport:
        """The configured port, not yet open.

        Raises:
            LinkError: no port is configured.
        """
        port = settings.port or settings.usb
        if port is None:
            raise LinkError(
                f"link '{settings.name}': 'port' is missing; the mock controller provides one"
            )
        return SerialTransport(
            port,
            settings.baudrate,
            rtscts=settings.rtscts,
            parity=settings.parity,
            stop_bits=settings.stop_bits,
            rs485=settings.rs485,
        )

    @staticmethod
    def _bitrate(settings: SerialLinkSettings) -> int:
        return settings.baudrate

    @staticmethod
    def check_together(links: Sequence[SerialLinkSettings]) -> None:
        """Refuse two links on one port.

        Raises:
            ConfigError: the message names both and the necessary change.
        """
        for a, b in combinations([link for link in links if link.simulate is None], 2):
            if (a.port, a.usb) == (b.port, b.usb):
                raise ConfigError(
                    f"links '{a.name}' and '{b.name}' both use {a.port or 'one USB adapter'}, "
                    f"which serves one link; put their robots on one link, or correct 'port'"
                )
