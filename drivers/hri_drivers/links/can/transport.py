"""CAN frames over any interface that python-can supports: socketcan, slcan, udp_multicast, ..."""

import contextlib
import errno
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import can
from can.typechecking import CanFilter

from hri_drivers.links.can.errors import BUS_OFF, DOWN, BusHealth, why_not_on_bus
from hri_drivers.links.can.opening import causes, open_bus, open_limit_s, remedy
from hri_drivers.wires.serial import MAX_READ, open_remedy, read_some
from hri_drivers.wires.transport import READ_TIMEOUT_S, TransportBusy
from hri_predict.base.errors import LinkError, first_line, nearest
from hri_predict.protocol.can import CanFrame

SEND_TIMEOUT_S = 0.05
GARBAGE_LIMIT = 1000  # unreadable frames in a row before the interface is reopened
_BUSY_ERRNO = (errno.ENOBUFS, errno.EAGAIN)


def check_interface(name: str) -> None:
    """Refuse an interface that python-can does not support.

    Raises:
        LinkError: the message suggests the most similar interface and lists all.
    """
    known = sorted(can.VALID_INTERFACES)
    if name not in known:
        raise LinkError(
            f"unknown CAN interface '{name}'{nearest(name, known)}; known: {', '.join(known)}"
        )


class CanTransport:
    """``Transport[CanFrame]`` over a python-can bus, without python-can's own configuration.

    Args:
        interface, channel: python-can's names.
        bitrate, data_bitrate: bit/s; not every interface sets them (``ip link`` sets those of a
            socketcan device).
        fd: open for CAN FD; frames with ``fd`` then switch to ``data_bitrate``.
        options: further arguments of python-can's bus class.
        filters: ids to pass, as python-can's ``can_filters``; used only if the interface itself
            filters, because then other frames never reach this process.
        listen_only: never send; do not even acknowledge, if the interface can do that.

    Attributes:
        health: state of the bus according to error frames.
        malformed: number of units on the wire that were not frames.
        on_error_frame: called in the reading thread after each error frame, with one line if it
            reports a new problem.
    """

    def __init__(
        self,
        *,
        interface: str,
        channel: str,
        bitrate: int = 500_000,
        fd: bool = False,
        data_bitrate: int = 2_000_000,
        options: Mapping[str, Any] | None = None,
        filters: Sequence[CanFilter] = (),
        listen_only: bool = False,
    ) -> None:
        self.interface = interface
        self.channel = channel
        self.health = BusHealth()
        self.malformed = 0
        self.on_error_frame: Callable[[str | None], None] | None = None
        self._filters = filters
        self._listen_only = listen_only
        self._switch = data_bitrate > bitrate
        quiet = listen_only_options(interface) if listen_only else {}
        self._arguments = _arguments(
            interface=interface,
            bitrate=bitrate,
            fd=fd,
            data_bitrate=data_bitrate,
            options=quiet | dict(options or {}),
        )
        self._bus: can.BusABC | None = None
        self._garbage = 0

    @property
    def open_limit_s(self) -> float:
        """Maximum time of ``open``, in seconds, unless a driver neither returns nor fails."""
        return open_limit_s(self._arguments)

    @property
    def _name(self) -> str:
        return f"CAN interface {self.interface}, channel {self.channel}"

    def open(self) -> None:
        """Open the bus."""
        self.close()
        check_interface(self.interface)
        reason = why_not_on_bus(self.channel) if self.interface == "socketcan" else None
        if reason is not None:
            raise LinkError(f"{self._name}: {reason}")
        try:
            bus = open_bus(self.interface, self.channel, self._arguments)
        except Exception as error:  # vendors' drivers raise anything
            raise LinkError(f"{self._name}: {remedy(error, self.interface)}") from error
        if self.interface == "slcan" and (why := _why_not_locked(bus)):
            _shut(bus)
            raise LinkError(f"{self._name}: {why}")
        if self._filters and "can_filters" not in self._arguments and _filters_itself(bus):
            bus.set_filters(list(self._filters))
        if self.interface == "slcan":
            bus._read = _Lines(bus.serialPortOrig).read  # type: ignore[attr-defined]
        _forget_backlog(bus)
        self._garbage = 0
        self._bus = bus

    def write(self, unit: CanFrame) -> None:
        """Send one frame; waits at most 50 ms for room in the transmit queue."""
        if self._listen_only:
            raise LinkError(f"{self._name}: listens only; remove 'listen_only' to send")
        message = can.Message(
            arbitration_id=unit.arbitration_id,
            is_extended_id=unit.extended,
            data=unit.data,
            is_fd=unit.fd,
            bitrate_switch=unit.fd and self._switch,
        )
        try:
            self._opened().send(message, timeout=SEND_TIMEOUT_S)
        except LinkError:
            raise
        except Exception as error:
            if _is_busy(error):
                raise TransportBusy(
                    f"{self._name}: cannot send (transmit queue full); check that another node "
                    "acknowledges, the termination, and restart-ms after bus-off"
                ) from error
            raise self._lost(error) from error

    def read(self, timeout_s: float) -> list[CanFrame]:
        """Return the next data frame, if one arrives in time."""
        bus = self._opened()
        try:
            message = bus.recv(timeout_s)
        except Exception as error:
            if _is_garbage(error):
                return self._unreadable(error)
            raise self._lost(error) from error
        if message is None:
            return []
        if message.is_error_frame:
            return self._error_frame(message)
        if message.is_remote_frame:  # no data; never ours
            return []
        self._garbage = 0
        return [
            CanFrame(
                message.arbitration_id,
                bytes(message.data),
                fd=message.is_fd,
                extended=message.is_extended_id,
            )
        ]

    def close(self) -> None:
        """Close the bus, and its port even if the bus fails to shut down."""
        bus, self._bus = self._bus, None
        if bus is not None:
            _shut(bus)

    def _opened(self) -> can.BusABC:
        if self._bus is None:
            raise LinkError(f"{self._name} is closed; open it first")
        return self._bus

    def _error_frame(self, message: can.Message) -> list[CanFrame]:
        """Count an error frame; only SocketCAN's frames describe the error.

        Raises:
            LinkError: the controller is off the bus, and sends and receives nothing until restart.
        """
        trouble = None
        if self.interface == "socketcan":
            trouble = self.health.feed(message.arbitration_id, bytes(message.data))
        else:
            self.health.frames += 1
        if self.on_error_frame is not None:
            self.on_error_frame(None if trouble is None else f"{self._name}: {trouble}")
        if self.health.state == "off":
            self.health.state = "active"  # its state once it can be opened again
            raise LinkError(f"{self._name}: {BUS_OFF.format(channel=self.channel)}")
        return []

    def _unreadable(self, error: Exception) -> list[CanFrame]:
        self.malformed += 1
        self._garbage += 1
        if self._garbage > GARBAGE_LIMIT:
            raise self._lost(error) from error
        return []

    def _lost(self, error: Exception) -> LinkError:
        if self.interface == "socketcan" and _number(error) == errno.ENETDOWN:
            return LinkError(f"{self._name}: {DOWN.format(channel=self.channel)}")
        text = first_line(error)
        return LinkError(f"{self._name}: lost ({text}); check adapter and cable")


def listen_only_options(interface: str) -> dict[str, Any]:
    """Options that make python-can's bus class of ``interface`` listen without acknowledging.

    Empty if the interface has no acknowledgement, or if it is a setting of the device
    (socketcan: ``ip link set can0 type can bitrate 500000 listen-only on``).

    Raises:
        LinkError: python-can cannot set it for this interface.
    """
    if interface in ("socketcan", "virtual", "udp_multicast"):
        return {}
    if interface in ("slcan", "vector", "nixnet"):
        return {"listen_only": True}
    if interface in ("pcan", "systec"):
        return {"state": can.BusState.PASSIVE}
    if interface == "seeedstudio":
        return {"operation_mode": "silent"}
    raise LinkError(
        f"listen_only: python-can has no such mode for '{interface}'; remove it, or use another "
        "interface, such as socketcan or slcan"
    )


def _arguments(
    *, interface: str, bitrate: int, fd: bool, data_bitrate: int, options: dict[str, Any]
) -> dict[str, Any]:
    """Arguments of the bus class; the user's ``options`` take precedence."""
    arguments: dict[str, Any] = {"bitrate": bitrate}
    if interface == "slcan":
        # The port's own read timeout: python-can's 1 ms would wake the reader 1000 times a second.
        arguments["timeout"] = READ_TIMEOUT_S
        if fd:
            del arguments["bitrate"]
            arguments["timing"] = can.BitTimingFd.from_sample_point(
                f_clock=80_000_000,
                nom_bitrate=bitrate,
                nom_sample_point=80.0,
                data_bitrate=data_bitrate,
                data_sample_point=80.0,
            )
    elif interface == "virtual":
        arguments["protocol"] = can.CanProtocol.CAN_FD if fd else can.CanProtocol.CAN_20
    elif interface == "udp_multicast":
        arguments = {"fd": fd}
    elif fd:
        arguments |= {"fd": True, "data_bitrate": data_bitrate}
    return arguments | options


def _is_busy(error: Exception) -> bool:
    """Whether a failed send means "retry later", not "device lost" (python-can issue 2004)."""
    if isinstance(error, can.CanTimeoutError) or "buffer full" in str(error).lower():
        return True
    return any(
        getattr(e, "error_code", None) in _BUSY_ERRNO
        or (isinstance(e, OSError) and e.errno in _BUSY_ERRNO)
        or type(e).__name__ == "SerialTimeoutException"
        for e in causes(error)
    )


def _number(error: Exception) -> int | None:
    """The system's error number, anywhere in the chain of causes."""
    for e in causes(error):
        number = getattr(e, "error_code", None) or getattr(e, "errno", None)
        if isinstance(number, int):
            return number
    return None


def _filters_itself(bus: can.BusABC) -> bool:
    """Whether the interface (kernel or hardware) filters frames before they reach us.

    If not, python-can would filter in this process, and would lose error frames.
    """
    return type(bus)._apply_filters is not can.BusABC._apply_filters


def _is_garbage(error: Exception) -> bool:
    """Whether a failed receive was caused by the content of a frame, not by the device."""
    last = list(causes(error))[-1]
    return isinstance(last, ValueError | LookupError | TypeError) and not isinstance(last, OSError)


class _Lines:
    """Reads the lines of an slcan adapter as they arrive; replaces python-can's ``_read``.

    python-can reads byte by byte with three system calls each, and ends a line at CR alone. It
    would find no frame from an adapter that ends its lines with CR and LF.
    """

    def __init__(self, port: Any) -> None:
        self._port = port
        self._come = b""

    def read(self, timeout: float | None) -> str | None:
        """Return the next line with its end; ``None`` if no whole line arrives within ``timeout``.

        Raises:
            ValueError: it is not text, or no line end arrived.
            can.CanOperationError: the port is lost.
        """
        while True:
            line, end, rest = self._come.partition(b"\r")
            if b"\a" in line:  # the adapter refused what was sent
                line, end, rest = self._come.partition(b"\a")
            if end:
                self._come = rest
                if line := line.lstrip(b"\n"):
                    return (line + end).decode()
                continue
            if len(self._come) > MAX_READ:
                self._come = b""
                raise ValueError("no line ends")
            with can.exceptions.error_check("Could not read from serial device"):
                waits = timeout != 0 or self._port.in_waiting
                come = read_some(self._port, timeout) if waits else b""
            if not come:
                return None
            self._come += come


def _forget_backlog(bus: can.BusABC) -> None:
    """Discard bytes that the port buffered before it was opened: their age is unknown.

    Only slcan keeps such a backlog; kernel and vendor drivers start when opened.
    """
    port = getattr(bus, "serialPortOrig", None)
    if port is not None:
        port.reset_input_buffer()


def _why_not_locked(bus: can.BusABC) -> str:
    """Lock an slcan adapter's port; return why it failed, "" if the system has no locks.

    The lock is for this process, and on the file itself: pyserial's ``exclusive`` would configure
    the port again, and any error in that would look like another program's lock.
    """
    descriptor = getattr(getattr(bus, "serialPortOrig", None), "fd", None)
    if not isinstance(descriptor, int):  # a URL; Windows locks anyway
        return ""
    import fcntl

    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError as error:
        return open_remedy(error, "channel")
    return ""


def _shut(bus: can.BusABC) -> None:
    with contextlib.suppress(Exception):
        bus.shutdown()
    # slcan sends a last command before it closes its port; on a dead port this fails and the port
    # stays open.
    port = getattr(bus, "serialPortOrig", None)
    if port is not None:
        with contextlib.suppress(Exception):
            port.close()
