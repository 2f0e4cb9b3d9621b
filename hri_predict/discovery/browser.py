"""Searching: all services for a while, or one by its name."""

import contextlib
import os
import socket
import threading
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from typing import Any

from zeroconf import (
    BadTypeInNameException,
    ServiceBrowser,
    ServiceInfo,
    ServiceStateChange,
    Zeroconf,
)

from hri_predict.discovery.services import KINDS, LOOPBACK, Service, ServiceSettings, printable
from hri_predict.errors import DiscoveryError, nearest

ANSWER_S = 1.0  # a service that is there answers in a tenth of it
CONNECT_S = 0.5
MAX_SERVICES = 256
SIDE_BY_SIDE = 16

ANSWERS, VANISHED = "answers", "vanished"
NO_PROCESS, PORT_CLOSED = "no process", "port closed"


def discover(seconds: float, interfaces: Sequence[str] = LOOPBACK) -> list[Service]:
    """Search for so many seconds, then look at each that was found.

    ``liveness`` of each is then

    - ``answers``: who announced it has answered afresh, and where that can be tried cheaply, its
      process is there (a node on this machine) or its port takes a connection (``_tcp``);
    - ``no process``, ``port closed``: that was tried, and it is not so;
    - ``vanished``: it was found, and then withdrew or answers no more.

    None of this says that data come: only data do.

    Raises:
        DiscoveryError: this machine has no such interface.
    """
    with _zeroconf(interfaces) as zeroconf:
        seen: dict[str, tuple[str, bool]] = {}
        browser = ServiceBrowser(zeroconf, list(KINDS), handlers=[_keeper(seen)])
        threading.Event().wait(seconds)
        browser.cancel()
        known = [(t, name, here, _read(zeroconf, t, name)) for name, (t, here) in seen.items()]
    with _zeroconf(interfaces) as fresh, ThreadPoolExecutor(SIDE_BY_SIDE) as pool:
        services = list(pool.map(lambda found: _look(fresh, *found), known))
    return sorted(services, key=lambda s: (list(KINDS.values()).index(s.kind), s.name))


def resolve(
    service_type: str, name: str, timeout_s: float, interfaces: Sequence[str] = LOOPBACK
) -> tuple[str, int]:
    """Address and port of the service that announces itself as ``name``.

    Args:
        service_type: such as ``_hri-source._tcp.local.``.
        name: the service's own name, without its type.
        timeout_s: how long to wait for an answer.
        interfaces: addresses of the interfaces to search on.

    Raises:
        DiscoveryError: nobody of that name answered in time; names those that did.
    """
    with _zeroconf(interfaces) as zeroconf:
        seen: dict[str, tuple[str, bool]] = {}
        browser = ServiceBrowser(zeroconf, service_type, handlers=[_keeper(seen)])
        info = ServiceInfo(service_type, f"{name}.{service_type}")
        found = info.request(zeroconf, timeout_s * 1e3)
        browser.cancel()
        addresses = info.parsed_scoped_addresses() if found else []
        if addresses and info.port:
            return addresses[0], info.port
    there = sorted(printable(full.removesuffix(f".{service_type}")) for full in seen)
    others = f"there are: {', '.join(there)}" if there else "there is none at all"
    raise DiscoveryError(
        f"no {service_type.removesuffix('.local.')} named '{name}' answered within {timeout_s:g} s"
        f"{nearest(name, there)}; {others}; start it, or correct 'service'"
    )


def find(service_type: str, settings: ServiceSettings) -> tuple[str, int]:
    """``resolve`` by a source's settings."""
    return resolve(service_type, settings.name, settings.timeout_s, settings.interfaces)


@contextlib.contextmanager
def _zeroconf(interfaces: Sequence[str]) -> Iterator[Zeroconf]:
    try:
        zeroconf = Zeroconf(interfaces=list(interfaces))
    except OSError as error:
        where = ", ".join(interfaces)
        raise DiscoveryError(
            f"cannot search on {where}: {error.strerror or error}; name addresses of this machine"
        ) from error
    try:
        yield zeroconf
    finally:
        zeroconf.close()


def _keeper(seen: dict[str, tuple[str, bool]]) -> Any:
    """Keeps each full name with its type and whether it is still there."""

    def note(
        zeroconf: Zeroconf, service_type: str, name: str, state_change: ServiceStateChange
    ) -> None:
        if name in seen or len(seen) < MAX_SERVICES:
            seen[name] = (service_type, state_change is not ServiceStateChange.Removed)

    return note


def _read(zeroconf: Zeroconf, service_type: str, name: str, wait: bool = False) -> Service | None:
    """What a service says; without ``wait`` only what was heard already."""
    try:
        info = ServiceInfo(service_type, name)
    except BadTypeInNameException:  # whoever sent that cannot be asked
        return None
    heard = info.request(zeroconf, ANSWER_S * 1e3) if wait else info.load_from_cache(zeroconf)
    if not heard:
        return None
    return Service(
        KINDS[service_type],
        service_type,
        printable(name.removesuffix(f".{service_type}")),
        printable(info.server),
        tuple(info.parsed_scoped_addresses()),
        info.port or 0,
        {printable(k): printable(v) for k, v in info.properties.items()},
        VANISHED,
    )


def _look(
    zeroconf: Zeroconf, service_type: str, name: str, here: bool, known: Service | None
) -> Service:
    """Ask a service afresh, with a memory that holds nothing, and try what is cheap."""
    service = _read(zeroconf, service_type, name, wait=True) if here else None
    if service is not None:
        return replace(service, liveness=_tried(service))
    if known is not None:
        return known
    bare = printable(name.removesuffix(f".{service_type}"))
    return Service(KINDS[service_type], service_type, bare, "", (), 0, {}, VANISHED)


def _tried(service: Service) -> str:
    if service.kind == "node":
        here = service.properties.get("host") == socket.gethostname()
        return NO_PROCESS if here and not _runs(service.properties.get("pid", "")) else ANSWERS
    if "._tcp" not in service.type or not service.addresses:
        return ANSWERS  # a datagram's receiver tells nobody that it hears
    try:
        socket.create_connection((service.addresses[0], service.port), CONNECT_S).close()
    except OSError:
        return PORT_CLOSED
    return ANSWERS


def _runs(pid: str) -> bool:
    """Whether a process of this machine has that number."""
    try:
        os.kill(int(pid), 0)
    except PermissionError:
        return True  # another user's
    except (OSError, ValueError, OverflowError):
        return False
    return True
