"""Bytes over any port that pyserial knows: a device path, ``socket://``, ``rfc2217://``, ..."""

import contextlib
import errno
import time
from collections.abc import Sequence
from typing import Any

import serial
from serial.tools import list_ports

from hri_drivers.transport import TransportBusy
from hri_predict.errors import LinkError

WRITE_TIMEOUT_S = 0.05
CLOSE_DRAIN_S = 0.1
# An output buffer that holds more than this has become a queue: what is in it is old already.
MAX_BACKLOG_S = 0.05


class SerialTransport:
    """``Transport[bytes]`` over pyserial's ``serial_for_url``; 8 data bits, no parity, 1 stop bit.

    Args:
        port: device path or URL.
        baudrate: bit/s.
        delimiter: written before the next unit when a write was cut short, so that the receiver
            loses only the one that was cut.
        rtscts: hardware handshake.
    """

    def __init__(
        self, port: str, baudrate: int, delimiter: bytes = b"\0", rtscts: bool = False
    ) -> None:
        self.port = port
        self.baudrate = baudrate
        self._delimiter = delimiter
        self._rtscts = rtscts
        self._serial: Any = None  # each URL handler of pyserial is a class of its own
        self._cut_short = False
        self._backlog_limit = max(256, int(baudrate / 10 * MAX_BACKLOG_S))

    def open(self) -> None:
        """Open the port, for this process alone where the system can lock it."""
        self.close()
        try:
            device = serial.serial_for_url(
                self.port,
                do_not_open=True,
                baudrate=self.baudrate,
                timeout=0,
                write_timeout=WRITE_TIMEOUT_S,
                rtscts=self._rtscts,
            )
            if "://" not in self.port:
                with contextlib.suppress(ValueError, NotImplementedError):
                    device.exclusive = True
            device.open()
        except (OSError, ValueError) as error:
            raise LinkError(f"serial port {self.port}: {open_remedy(error)}") from error
        self._cut_short = False
        self._serial = device

    def write(self, unit: bytes) -> None:
        """Write ``unit``; waits at most 50 ms for room in the output buffer."""
        device = self._opened()
        try:
            if self._waiting(device) > self._backlog_limit:
                raise TransportBusy(
                    f"serial port {self.port}: the output buffer does not empty; "
                    "check the handshake and the baud rate"
                )
            if self._cut_short:
                unit = self._delimiter + unit
            self._cut_short = True
            device.write(unit)
            self._cut_short = False
        except serial.SerialTimeoutException as error:
            raise TransportBusy(
                f"serial port {self.port}: a write took longer than {WRITE_TIMEOUT_S * 1e3:.0f} ms;"
                " check that the other end reads"
            ) from error
        except (OSError, TypeError) as error:  # TypeError: pyserial, port closed meanwhile
            raise self._lost(error) from error

    def read(self, timeout_s: float) -> list[bytes]:
        """Return the bytes that have come, as one chunk."""
        device = self._opened()
        try:
            if device.timeout != timeout_s:
                device.timeout = timeout_s
            data = bytes(device.read(1))
            if data and (more := device.in_waiting):
                data += device.read(more)
        except (OSError, TypeError) as error:
            raise self._lost(error) from error
        return [data] if data else []

    def close(self) -> None:
        """Let what was written leave (at most 100 ms), then close."""
        device, self._serial = self._serial, None
        if device is None:
            return
        with contextlib.suppress(Exception):
            deadline = time.monotonic() + CLOSE_DRAIN_S
            while self._waiting(device) and time.monotonic() < deadline:
                time.sleep(0.002)
        with contextlib.suppress(Exception):
            device.close()

    def _opened(self) -> Any:
        if self._serial is None:
            raise LinkError(f"serial port {self.port} is closed; open it first")
        return self._serial

    def _lost(self, error: Exception) -> LinkError:
        return LinkError(f"serial port {self.port}: lost ({error}); check cable and power")

    @staticmethod
    def _waiting(device: Any) -> int:
        try:
            return int(device.out_waiting)
        except (AttributeError, NotImplementedError):  # not every URL handler has it
            return 0


def open_remedy(error: BaseException, key: str = "port") -> str:
    """What is wrong with a port that does not open, and what to do; ``key`` is its name in YAML."""
    number = getattr(error, "errno", None)
    if number in (errno.ENOENT, errno.ENODEV, errno.ENXIO) or "FileNotFound" in str(error):
        return f"not there; plug it in or correct '{key}' ({_present()})"
    if number in (errno.EACCES, errno.EPERM) or "PermissionError" in str(error):
        return "permission denied; add your user to the port's group (often 'dialout')"
    if number in (errno.EAGAIN, errno.EBUSY):
        return "in use by another program; close that one first"
    if number == errno.ECONNREFUSED or "refused" in str(error).lower():
        return f"connection refused; start the server there or correct '{key}'"
    if isinstance(error, ValueError):
        return f"not a port or setting that pyserial knows ({error}); correct it"
    return f"cannot be opened ({_first_line(error)}); correct '{key}' or check the device"


def _present() -> str:
    names: Sequence[str] = [p.device for p in list_ports.comports()]
    return f"ports here: {', '.join(sorted(names))}" if names else "no serial ports found here"


def _first_line(error: BaseException) -> str:
    return str(error).splitlines()[0] if str(error) else type(error).__name__
