"""CAN frames over any interface that python-can knows: socketcan, slcan, udp_multicast, ..."""

import contextlib
import errno
import logging
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

import can
from can.typechecking import CanFilter

from hri_drivers.can_errors import BUS_OFF, DOWN, BusHealth, why_not_on_bus
from hri_drivers.serial_transport import open_remedy
from hri_drivers.transport import TransportBusy
from hri_predict.errors import LinkError, nearest
from hri_predict.protocol.can_codec import CanFrame

SEND_TIMEOUT_S = 0.05
GARBAGE_LIMIT = 1000  # unreadable frames in a row until the interface is opened afresh
# Of a bus that could not be opened python-can says so on a line of its own; the LinkError says why.
logging.getLogger("can.bus").addFilter(lambda r: "not properly shut down" not in r.getMessage())
_BUSY_ERRNO = (errno.ENOBUFS, errno.EAGAIN)


def check_interface(name: str) -> None:
    """Refuse an interface that python-can does not know.

    Raises:
        LinkError: names the nearest and lists those there are.
    """
    known = sorted(can.VALID_INTERFACES)
    if name not in known:
        raise LinkError(
            f"unknown CAN interface '{name}'{nearest(name, known)}; there are: {', '.join(known)}"
        )


class CanTransport:
    """``Transport[CanFrame]`` over ``can.Bus(..., ignore_config=True)``.

    Args:
        interface, channel: as python-can names them.
        bitrate, data_bitrate: bit/s; not every interface sets them (a socketcan device is set up
            with ``ip link``).
        fd: open for CAN FD; frames with ``fd`` then switch to ``data_bitrate``.
        options: further arguments of python-can's bus class.
        filters: ids that may pass, as python-can's ``can_filters``; set where the interface filters
            by itself, as what does not reach this process costs it nothing.
        listen_only: never send, and where the interface can, do not even acknowledge.

    Attributes:
        health: what the error frames said.
        malformed: units on the wire that were no frame.
        on_error_frame: called in the reading thread after each error frame, with one line if it
            tells of new trouble.
    """

    def __init__(
        self,
        interface: str,
        channel: str,
        bitrate: int = 500_000,
        fd: bool = False,
        data_bitrate: int = 2_000_000,
        options: Mapping[str, Any] | None = None,
        *,
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
            interface, bitrate, fd, data_bitrate, quiet | dict(options or {})
        )
        self._bus: can.BusABC | None = None
        self._garbage = 0

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
            bus = can.Bus(
                interface=self.interface,
                channel=self.channel,
                ignore_config=True,
                **self._arguments,
            )
        except Exception as error:  # drivers of vendors raise anything
            raise LinkError(f"{self._name}: {_remedy(error, self.interface)}") from error
        if self.interface == "slcan" and not _lock(bus):
            _shut(bus)
            raise LinkError(f"{self._name}: in use by another program; close that one first")
        if self._filters and "can_filters" not in self._arguments and _filters_itself(bus):
            bus.set_filters(list(self._filters))
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
                    f"{self._name}: nothing is sent (transmit queue full); check that another node "
                    "acknowledges, the termination, and restart-ms after bus-off"
                ) from error
            raise self._lost(error) from error

    def read(self, timeout_s: float) -> list[CanFrame]:
        """Return the next data frame, if one comes in time."""
        bus = self._opened()
        try:
            message = bus.recv(timeout_s)
        except Exception as error:
            if _is_garbage(error):
                return self._unreadable(bus, error)
            raise self._lost(error) from error
        if message is None:
            return []
        if message.is_error_frame:
            return self._error_frame(message)
        if message.is_remote_frame:  # carries nothing; none of ours
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
        """Close the bus, and the port under it even if the bus cannot say goodbye."""
        bus, self._bus = self._bus, None
        if bus is not None:
            _shut(bus)

    def _opened(self) -> can.BusABC:
        if self._bus is None:
            raise LinkError(f"{self._name} is closed; open it first")
        return self._bus

    def _error_frame(self, message: can.Message) -> list[CanFrame]:
        """Count it; only SocketCAN's tell what happened.

        Raises:
            LinkError: the controller is off the bus; nothing is sent or heard until it restarts.
        """
        trouble = None
        if self.interface == "socketcan":
            trouble = self.health.feed(message.arbitration_id, bytes(message.data))
        else:
            self.health.frames += 1
        if self.on_error_frame is not None:
            self.on_error_frame(None if trouble is None else f"{self._name}: {trouble}")
        if self.health.state == "off":
            self.health.state = "active"  # as it will be when it can be opened again
            raise LinkError(f"{self._name}: {BUS_OFF.format(channel=self.channel)}")
        return []

    def _unreadable(self, bus: can.BusABC, error: Exception) -> list[CanFrame]:
        self.malformed += 1
        self._garbage += 1
        if self._garbage > GARBAGE_LIMIT:
            raise self._lost(error) from error
        if any(isinstance(e, UnicodeDecodeError) for e in _causes(error)):
            # python-can's slcan keeps a line that is no text, and would stumble over it for ever
            with contextlib.suppress(Exception):
                getattr(bus, "flush", lambda: None)()
        return []

    def _lost(self, error: Exception) -> LinkError:
        if self.interface == "socketcan" and _number(error) == errno.ENETDOWN:
            return LinkError(f"{self._name}: {DOWN.format(channel=self.channel)}")
        text = _first_line(error)
        return LinkError(f"{self._name}: lost ({text}); check adapter and cable")


def listen_only_options(interface: str) -> dict[str, Any]:
    """What makes python-can's bus class of ``interface`` listen without acknowledging.

    Nothing where the interface has no acknowledgement, or where it is a setting of the device
    (socketcan: ``ip link set can0 type can bitrate 500000 listen-only on``).

    Raises:
        LinkError: python-can cannot set it there.
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
    interface: str, bitrate: int, fd: bool, data_bitrate: int, options: dict[str, Any]
) -> dict[str, Any]:
    """Arguments of the bus class; what the user gives in ``options`` goes before all."""
    arguments: dict[str, Any] = {"bitrate": bitrate}
    if interface == "slcan":
        # The port's own read timeout: python-can's 1 ms would wake the reader 1000 times a second.
        arguments["timeout"] = 0.02
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


def _causes(error: BaseException | None) -> Iterator[BaseException]:
    while error is not None:
        yield error
        error = error.__cause__


def _is_busy(error: Exception) -> bool:
    """Whether a failed send means "not now" rather than "never again" (python-can issue 2004)."""
    if isinstance(error, can.CanTimeoutError) or "buffer full" in str(error).lower():
        return True
    return any(
        getattr(e, "error_code", None) in _BUSY_ERRNO
        or (isinstance(e, OSError) and e.errno in _BUSY_ERRNO)
        or type(e).__name__ == "SerialTimeoutException"
        for e in _causes(error)
    )


def _number(error: Exception) -> int | None:
    """The system's number of an error, wherever in its chain it stands."""
    for e in _causes(error):
        number = getattr(e, "error_code", None) or getattr(e, "errno", None)
        if isinstance(number, int):
            return number
    return None


def _filters_itself(bus: can.BusABC) -> bool:
    """Whether the interface (kernel or hardware) sorts frames out before they reach us.

    python-can would do it in this process where it does not, and lose error frames by it.
    """
    return type(bus)._apply_filters is not can.BusABC._apply_filters


def _is_garbage(error: Exception) -> bool:
    """Whether a failed receive was about the content of a frame, not about the device."""
    last = list(_causes(error))[-1]
    return isinstance(last, ValueError | LookupError | TypeError) and not isinstance(last, OSError)


def _forget_backlog(bus: can.BusABC) -> None:
    """Throw away what waited in the port before it was opened: nobody knows how old it is.

    Only slcan keeps such a backlog; kernel and vendor drivers begin when they are opened.
    """
    port = getattr(bus, "serialPortOrig", None)
    if port is not None:
        port.reset_input_buffer()


def _lock(bus: can.BusABC) -> bool:
    """Take an slcan adapter's port for this process alone, where the system can lock it."""
    port: Any = getattr(bus, "serialPortOrig", None)
    try:
        port.exclusive = True
    except OSError:
        return False
    except (
        AttributeError,
        ValueError,
        NotImplementedError,
    ):  # a URL; Windows locks anyway
        pass
    return True


def _shut(bus: can.BusABC) -> None:
    with contextlib.suppress(Exception):
        bus.shutdown()
    # slcan says goodbye before it closes its port; on a dead port that fails and leaves it open.
    port = getattr(bus, "serialPortOrig", None)
    if port is not None:
        with contextlib.suppress(Exception):
            port.close()


def _remedy(error: Exception, interface: str) -> str:
    """What is wrong with an interface that does not open, and what to do."""
    chain = list(_causes(error))
    number = next((e.errno for e in chain if isinstance(e, OSError) and e.errno), None)
    text = _first_line(error)
    if "msgpack" in text:
        return "needs msgpack; install it with: pip install 'hri-predict[udp]'"
    if isinstance(error, can.CanInterfaceNotImplementedError | ImportError):
        return f"its driver is not available ({text}); install it, or choose another interface"
    if interface == "socketcan":
        if number == errno.EAFNOSUPPORT:
            return "this kernel has no CAN; use another interface, such as slcan or udp_multicast"
        if number in (errno.ENODEV, errno.ENXIO):
            return (
                "there is no such device or it is down; bring it up: "
                "ip link set CHANNEL up type can bitrate 500000 restart-ms 100"
            )
    if interface == "slcan" and isinstance(chain[-1], OSError):
        return open_remedy(chain[-1], "channel")
    return f"cannot be opened ({text}); correct 'channel', 'bitrate' or 'options'"


def _first_line(error: Exception) -> str:
    return str(error).splitlines()[0] if str(error) else type(error).__name__
