"""Bytes over any pyserial port: a device path, ``socket://``, ``rfc2217://``, ..."""

import contextlib
import errno
import os
import select
import stat
import sys
import time
from collections.abc import Sequence
from typing import Any, Literal

import serial
from serial.rs485 import RS485Settings
from serial.tools import list_ports

from hri_drivers.wires.tcp import keep_alive, limit_delay
from hri_drivers.wires.transport import READ_TIMEOUT_S, TransportBusy
from hri_drivers.wires.usb_ports import Comports, UsbDevice, find_port
from hri_predict.base.errors import LinkError, first_line

Parity = Literal["none", "even", "odd", "mark", "space"]
StopBits = Literal[1, 2]

WRITE_TIMEOUT_S = 0.05
CLOSE_DRAIN_S = 0.1
# An output buffer that holds more than this is a queue of outdated bytes.
MAX_BACKLOG_S = 0.05
# A TCP peer may delay its acknowledgement by 200 ms (RFC 1122, 4.2.3.2, allows 500); until then the
# bytes count as waiting.
MAX_UNACKNOWLEDGED_S = 0.25
MAX_READ = 4096
MEMORY_MAJOR = 1
"""Linux's major device number of /dev/null, /dev/zero and similar devices."""

_PARITIES: dict[Parity, str] = {
    "none": serial.PARITY_NONE,
    "even": serial.PARITY_EVEN,
    "odd": serial.PARITY_ODD,
    "mark": serial.PARITY_MARK,
    "space": serial.PARITY_SPACE,
}


class SerialTransport:
    """``Transport[bytes]`` over pyserial's ``serial_for_url``; 8 data bits.

    After each opening, the first write starts with a delimiter. It ends any partial frame or noise
    in the receiver, so that the first frame arrives.

    Args:
        port: device path or URL; or a USB adapter, searched for at each opening.
        baudrate: bit/s.
        delimiter: also written after a write was cut short, so that the receiver loses only that
            unit.
        rtscts: hardware handshake.
        parity, stop_bits: the same on both sides.
        rs485: let the driver enable the transmitter by RTS while it sends (Linux).
        comports: lists the present ports.
    """

    def __init__(
        self,
        port: str | UsbDevice,
        baudrate: int,
        delimiter: bytes = b"\0",
        *,
        rtscts: bool = False,
        parity: Parity = "none",
        stop_bits: StopBits = 1,
        rs485: bool = False,
        comports: Comports = list_ports.comports,
    ) -> None:
        self.port = port
        self.baudrate = baudrate
        self._name = f"serial port {port}" if isinstance(port, str) else f"USB device {port}"
        self._delimiter = delimiter
        self._options: dict[str, Any] = {
            "rtscts": rtscts,
            "parity": _PARITIES[parity],
            "stopbits": stop_bits,
        }
        self._rs485 = rs485
        self._comports = comports
        self._serial: Any = None  # each URL handler of pyserial has its own class
        self._cut_short = self._networked = False
        self._backlog_limit = self._bytes_in(MAX_BACKLOG_S)

    def open(self) -> None:
        """Open the port, and lock it for this process if the system can do that."""
        self.close()
        path = self.port
        if not isinstance(path, str):
            path = find_port(path, self._comports())
            self._name = f"USB device {self.port} ({path})"
        device = None
        try:
            device = self._device(path)
            device.open()
            _set_up_network(device)
        except Exception as error:  # termios.error and NotImplementedError are among them
            if device is not None:
                with contextlib.suppress(Exception):
                    device.close()
            raise LinkError(f"{self._name}: {open_remedy(error)}") from error
        self._cut_short = True
        self._networked = getattr(device, "_socket", None) is not None
        limit_s = MAX_UNACKNOWLEDGED_S if self._networked else MAX_BACKLOG_S
        self._backlog_limit = self._bytes_in(limit_s)
        self._serial = device

    def _device(self, path: str) -> Any:
        """The port, configured but not open."""
        device = serial.serial_for_url(
            path,
            do_not_open=True,
            baudrate=self.baudrate,
            timeout=READ_TIMEOUT_S,  # an rfc2217 server negotiates anew for any other value
            # rfc2217 has none; there only the backlog limit keeps a write from waiting
            write_timeout=None if path.lower().startswith("rfc2217://") else WRITE_TIMEOUT_S,
            **self._options,
        )
        if self._rs485:
            device.rs485_mode = RS485Settings()
        with contextlib.suppress(ValueError, NotImplementedError):
            device.exclusive = True
        return device

    def write(self, unit: bytes) -> None:
        """Write ``unit``; waits at most 50 ms for room in the output buffer."""
        device = self._opened()
        try:
            if _waiting(device) > self._backlog_limit:
                raise TransportBusy(
                    f"{self._name}: the output buffer does not drain; "
                    "check that the other end reads, the handshake and the baud rate"
                )
            if self._cut_short:
                unit = self._delimiter + unit
            self._cut_short = True
            _write_all(device, unit)
            self._cut_short = False
        except serial.SerialTimeoutException as error:
            raise TransportBusy(
                f"{self._name}: a write took longer than {WRITE_TIMEOUT_S * 1e3:.0f} ms;"
                " check that the other end reads"
            ) from error
        except (OSError, TypeError, ValueError) as error:  # the last two: closed in the meantime
            raise self._lost(error) from error

    def read(self, timeout_s: float) -> list[bytes]:
        """Return the bytes that have arrived, as one chunk."""
        device = self._opened()
        try:
            if device.timeout != timeout_s:
                device.timeout = timeout_s
            data = read_some(device)
        except (OSError, TypeError, ValueError) as error:
            raise self._lost(error) from error
        return [data] if data else []

    def close(self) -> None:
        """Wait until written bytes have left (at most 100 ms), then close."""
        device, self._serial = self._serial, None
        if device is None:
            return
        with contextlib.suppress(Exception):
            deadline = time.monotonic() + CLOSE_DRAIN_S
            while _waiting(device) and time.monotonic() < deadline:
                time.sleep(0.002)
            if _waiting(device):  # else close() would wait for them, 30 s on Linux
                device.reset_output_buffer()
        with contextlib.suppress(Exception):
            device.close()

    def _bytes_in(self, seconds: float) -> int:
        return max(256, int(self.baudrate / 10 * seconds))

    def _opened(self) -> Any:
        if self._serial is None:
            raise LinkError(f"{self._name} is closed; open it first")
        return self._serial

    def _lost(self, error: Exception) -> LinkError:
        check = (
            "network, power, and that the other end reads" if self._networked else "cable and power"
        )
        return LinkError(f"{self._name}: lost ({first_line(error)}); check {check}")


def read_some(device: Any, timeout_s: float | None = None) -> bytes:
    """Wait for bytes and return those that have arrived, at most ``MAX_READ``.

    It waits for the port's timeout at most, or for ``timeout_s`` where the system can.

    pyserial's own read returns immediately only if a single byte is requested, and the rest needs
    another call. It is used only where it does more than read (``spy://``, rfc2217, Windows).

    Raises:
        OSError, TypeError, ValueError: the port was lost or closed.
    """
    if type(device).read is serial.Serial.read and (fd := getattr(device, "fd", None)) is not None:
        if not select.select([fd], [], [], device.timeout if timeout_s is None else timeout_s)[0]:
            return b""
        if data := os.read(fd, MAX_READ):
            return data
        raise serial.SerialException("the port reports bytes but returns none: it was unplugged")
    data = bytes(device.read(1))
    while data and len(data) < MAX_READ and (more := _has_come(device)):
        data += device.read(min(more, MAX_READ))
    return data


def _write_all(device: Any, unit: bytes) -> None:
    """Write ``unit``, waiting at most 50 ms for room.

    pyserial's own write busy-waits for room, and after the last byte waits for room that it does
    not need. It is used only where it does more than write (``spy://``, ...).

    Raises:
        serial.SerialTimeoutException: not all bytes were accepted in time.
    """
    descriptor = _descriptor(device)
    if descriptor is None:
        device.write(unit)
        return
    deadline = time.monotonic() + WRITE_TIMEOUT_S
    while True:
        with contextlib.suppress(BlockingIOError):
            unit = unit[os.write(descriptor, unit) :]
        if not unit:
            return
        left_s = max(0.0, deadline - time.monotonic())
        if not select.select([], [descriptor], [], left_s)[1]:
            raise serial.SerialTimeoutException("no room")


def _descriptor(device: Any) -> int | None:
    """The file descriptor for ``os.write``, if the port sends bytes unchanged; else ``None``."""
    if _is_plain_socket(device) and os.name == "posix":
        return int(device.fileno())
    if type(device).write is serial.Serial.write:
        return getattr(device, "fd", None)
    return None


def _is_plain_socket(device: Any) -> bool:
    return type(device).__module__ == "serial.urlhandler.protocol_socket"


def _waiting(device: Any) -> int:
    """Number of written bytes that are not yet sent, as far as known."""
    if (sock := getattr(device, "_socket", None)) is not None:
        return _queued(sock, "TIOCOUTQ")
    try:
        return int(device.out_waiting)
    except (AttributeError, NotImplementedError):  # not every URL handler has it
        return 0


def _has_come(device: Any) -> int:
    """Number of bytes readable now; pyserial's ``socket://`` reports 1 for any number."""
    waiting = int(device.in_waiting)
    if waiting and _is_plain_socket(device):
        return max(waiting, _queued(device._socket, "FIONREAD"))
    return waiting


def _queued(sock: Any, request: str) -> int:
    """Bytes in a socket's queue: TIOCOUTQ unacknowledged output, FIONREAD waiting input."""
    try:
        import fcntl
        import termios

        return int.from_bytes(fcntl.ioctl(sock, getattr(termios, request), bytes(4)), "little")
    except (ImportError, OSError, ValueError):  # not on this system, or closed
        return 0


def _set_up_network(device: Any) -> None:
    """A port over TCP carries nothing old, and its loss is noticed also if nothing is written."""
    if (connection := getattr(device, "_socket", None)) is not None:
        limit_delay(connection)
        keep_alive(connection)


def demand_serial_device(port: str) -> str:
    """Return a port that may be a serial device; nothing is opened, and it may be absent.

    Raises:
        ValueError: something else is at this path.
    """
    try:
        found = os.stat(port)
    except (OSError, ValueError):  # a URL, or not plugged in
        return port
    if os.sep not in port:  # of Windows, or simulated
        return port
    is_memory = os.name == "posix" and os.major(found.st_rdev) == MEMORY_MAJOR
    if not stat.S_ISCHR(found.st_mode) or (sys.platform == "linux" and is_memory):
        raise ValueError(f"{port} is not a serial device; give one, such as /dev/ttyUSB0")
    return port


def open_remedy(error: BaseException, key: str = "port") -> str:
    """The reason why a port does not open, and the remedy; ``key`` is its name in YAML."""
    number, text = getattr(error, "errno", None), first_line(error)
    if number in (errno.ENOENT, errno.ENODEV, errno.ENXIO) or "FileNotFound" in str(error):
        return f"not found; plug it in or correct '{key}' ({_present()})"
    if "no ports found matching" in text:  # hwgrep://
        return f"no matching port found; plug it in or correct '{key}' ({_present()})"
    if number in (errno.EACCES, errno.EPERM) or "PermissionError" in str(error):
        return "permission denied; add your user to the port's group (often 'dialout')"
    if number in (errno.EAGAIN, errno.EBUSY):
        return "in use by another program; close that program first"
    if number == errno.ECONNREFUSED or "refused" in text.lower():
        return f"connection refused; start the server there or correct '{key}'"
    if "does not seem to support RFC2217" in text:
        return f"no RFC 2217 server answers there; check the server or correct '{key}'"
    if "RS485" in text:
        return "its driver has no RS-485 mode; remove 'rs485' (many adapters switch by themselves)"
    if "Inappropriate ioctl" in text:
        return f"not a serial device; correct '{key}'"
    if type(error).__module__ == "termios":
        return f"the port refuses the settings ({error.args[-1]}); correct 'parity' or 'stop_bits'"
    if isinstance(error, ValueError):
        return f"pyserial does not support this port or setting ({text}); correct it"
    return f"cannot be opened ({text}); correct '{key}' or check the device"


def _present() -> str:
    names: Sequence[str] = [p.device for p in list_ports.comports()]
    return f"ports here: {', '.join(sorted(names))}" if names else "no serial ports found here"
