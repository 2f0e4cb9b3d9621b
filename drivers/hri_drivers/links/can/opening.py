"""Opens a bus of python-can in bounded time, and reports why a bus does not open.

For some interfaces python-can uses calls that can wait forever, for example if a socketcand server
accepts a connection and sends nothing, or if a host drops all packets.
"""

import contextlib
import errno
import socket
import threading
from collections.abc import Iterator, Mapping
from typing import Any

import can
import can.interface

from hri_drivers.links.can.packages import missing_driver
from hri_drivers.wires.serial import open_remedy
from hri_drivers.wires.tcp import keep_alive, limit_delay
from hri_predict.base.errors import first_line

OPEN_S = 8.0
"""Maximum time for opening an interface: the slowest one here, slcan, waits two seconds."""

REACH_S = 4.0
"""Maximum time for a server to accept a connection: three attempts of TCP."""


def open_limit_s(options: Mapping[str, Any]) -> float:
    """Maximum time in seconds for opening an interface with these options."""
    asked = options.get("sleep_after_open", 0.0)  # slcan: until the adapter has booted
    return OPEN_S + (float(asked) if isinstance(asked, int | float) else 0.0)


def open_bus(interface: str, channel: str, arguments: Mapping[str, Any]) -> can.BusABC:
    """Open a bus; after a timeout its sockets and ports are closed.

    Raises:
        TimeoutError: it took longer than ``open_limit_s``.
        Exception: vendors' drivers raise anything.
    """
    cls = can.interface._get_class_for_interface(interface)
    bus = cls.__new__(cls)  # as can.Bus does, but in two steps: what it waits for can be closed
    late = threading.Event()

    def give_up() -> None:
        late.set()
        _cut(bus)

    limit_s = open_limit_s(arguments)
    _demand_server(arguments)
    timer = threading.Timer(limit_s, give_up)
    timer.daemon = True
    timer.start()
    try:
        bus.__init__(channel, **arguments)  # type: ignore[misc]  # made before, to be cut
    except Exception as error:
        if late.is_set():
            raise TimeoutError(f"no answer within {limit_s:g} s") from error
        raise
    finally:
        timer.cancel()
    if late.is_set():
        with contextlib.suppress(Exception):
            bus.shutdown()
        raise TimeoutError(f"no answer within {limit_s:g} s")
    assert isinstance(bus, can.BusABC)
    for connection in _connections(bus):
        limit_delay(connection)
        keep_alive(connection)
    return bus


def _demand_server(arguments: Mapping[str, Any]) -> None:
    """Try to reach a server first: python-can would retry for ten seconds without a pause.

    Raises:
        OSError: it cannot be reached.
    """
    host, port = arguments.get("host"), arguments.get("port")
    if isinstance(host, str) and isinstance(port, int):
        socket.create_connection((host, port), REACH_S).close()


def _connections(bus: can.BusABC) -> list[socket.socket]:
    """TCP connections of a bus: socketcand's own, and that of slcan over ``socket://``."""
    port = getattr(bus, "serialPortOrig", None)
    held = [*vars(bus).values(), getattr(port, "_socket", None)]
    return [
        each
        for each in held
        if isinstance(each, socket.socket)
        and each.type == socket.SOCK_STREAM
        and each.family in (socket.AF_INET, socket.AF_INET6)
    ]


def _cut(bus: object) -> None:
    """Close every socket and port of a bus, so that a call that waits on one of them returns."""
    for held in list(vars(bus).values()):
        with contextlib.suppress(Exception):
            if isinstance(held, socket.socket):
                held.shutdown(socket.SHUT_RDWR)  # wakes a thread that waits; close alone does not
        with contextlib.suppress(Exception):
            close = getattr(held, "close", None)
            if callable(close):
                close()


def causes(error: BaseException | None) -> Iterator[BaseException]:
    """An error and its causes, back to the first."""
    while error is not None:
        yield error
        error = error.__cause__


def remedy(error: Exception, interface: str) -> str:
    """The reason why an interface does not open, and the remedy."""
    chain = list(causes(error))
    number = next((e.errno for e in chain if isinstance(e, OSError) and e.errno), None)
    text = first_line(error)
    if number == errno.ECONNREFUSED:
        return "connection refused; start the server there, or correct 'host' and 'port'"
    if isinstance(error, TimeoutError):
        return (
            f"does not open ({text}): it accepts connections but sends nothing, or cannot be "
            f"reached; restart the server or adapter, or correct 'channel' or 'options'"
        )
    if (missing := missing_driver(interface, chain)) is not None:
        return missing
    if interface == "socketcan":
        if number == errno.EAFNOSUPPORT:
            return "this kernel has no CAN; use another interface, such as slcan or udp_multicast"
        if number in (errno.ENODEV, errno.ENXIO):
            return (
                "no such device, or it is down; bring it up: "
                "ip link set CHANNEL up type can bitrate 500000 restart-ms 100"
            )
    if interface == "slcan" and isinstance(chain[-1], OSError):
        return open_remedy(chain[-1], "channel")
    return f"cannot be opened ({text}); correct 'channel', 'bitrate' or 'options'"
