"""USB serial adapters identified by their ids, not by the port name, which changes.

An unplugged adapter often returns under another name (/dev/ttyUSB1 for /dev/ttyUSB0). Its vendor id
and product id do not change, nor does its serial number, if any. Without a serial number, only the
USB socket distinguishes two adapters of the same type.
"""

from collections.abc import Callable, Sequence
from typing import Annotated, Any, Protocol

from pydantic import BeforeValidator, Field

from hri_predict.base.errors import LinkError
from hri_predict.base.settings import Settings


def _from_hex(value: Any) -> Any:
    """The number in '0403', the notation of lsusb."""
    if not isinstance(value, str):
        return value
    try:
        return int(value, 16)
    except ValueError:
        raise ValueError("write it as 0x0403, or as in lsusb, in quotes: '0403'") from None


UsbId = Annotated[int, BeforeValidator(_from_hex), Field(ge=0, le=0xFFFF)]


class UsbDevice(Settings):
    """``usb:`` of a serial link: searched for at each opening. ``vid`` and ``pid`` as in lsusb."""

    vid: UsbId = Field(description="vendor id, four hexadecimal digits in quotes")
    pid: UsbId = Field(description="product id, likewise")
    serial_number: str | None = Field(
        None,
        min_length=1,
        description="the adapter's serial number; needed to distinguish identical adapters",
    )
    location: str | None = Field(
        None,
        min_length=1,
        description="USB socket, such as 1-4.2; for adapters without serial number",
    )

    def __str__(self) -> str:
        return _described(self.vid, self.pid, self.serial_number, self.location)


class PortInfo(Protocol):
    """The part of ``serial.tools.list_ports_common.ListPortInfo`` that we use."""

    device: str
    vid: int | None
    pid: int | None
    serial_number: str | None
    location: str | None


Comports = Callable[[], Sequence[PortInfo]]


def find_port(wanted: UsbDevice, ports: Sequence[PortInfo]) -> str:
    """Return the current port name of the device.

    Raises:
        LinkError: no device or several devices match; one line that lists the present ones.
    """
    found = {port.device: port for port in ports if _is(wanted, port)}  # some list a port twice
    if len(found) == 1:
        return next(iter(found))
    if not found:
        there = [port for port in ports if port.vid is not None]
        raise LinkError(
            f"USB device {wanted}: not found; plug it in or correct 'usb' ({_listed(there)})"
        )
    raise LinkError(
        f"USB device {wanted}: {len(found)} devices match; add 'serial_number' or 'location' "
        f"({_listed(list(found.values()))})"
    )


def _is(wanted: UsbDevice, port: PortInfo) -> bool:
    return (
        (port.vid, port.pid) == (wanted.vid, wanted.pid)
        and wanted.serial_number in (None, port.serial_number)
        and wanted.location in (None, port.location)
    )


def _listed(ports: Sequence[PortInfo]) -> str:
    if not ports:
        return "no USB serial ports found here"
    lines = [
        f"{p.device} is {_described(p.vid or 0, p.pid or 0, p.serial_number, p.location)}"
        for p in sorted(ports, key=lambda port: port.device)
    ]
    return f"here: {', '.join(lines)}"


def _described(vid: int, pid: int, serial_number: str | None, location: str | None) -> str:
    number = f" serial_number '{serial_number}'" if serial_number else ""
    socket = f" location '{location}'" if location else ""
    return f"{vid:04x}:{pid:04x}{number}{socket}"
