"""Search for all services for some time, or for one service by name.

Each query is sent from two ports. Answers to a private port come directly to this program (RFC
6762, 6.7). Unicast answers to port 5353 may reach another program that shares the port, so queries
from there request multicast answers (5.4). Those are delayed if the same record was multicast
within the last second (6), but they pass a firewall that admits only port 5353.
"""

import contextlib
import os
import socket
import threading
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from typing import Any, NamedTuple

from zeroconf import BadTypeInNameException, DNSQuestionType, ServiceBrowser, ServiceInfo, Zeroconf

from hri_predict.base.errors import DiscoveryError, OsErrorAs, nearest
from hri_predict.protocol.discovery.services import (
    KINDS,
    LOOPBACK,
    Service,
    ServiceSettings,
    printable,
)

OWN_PORT_S = 0.5  # an answer comes at once; the question is repeated after 0.3 s
# zeroconf repeats a multicast question after at most 1.5 s. An answer takes at most 1.4 s: one
# second until the same record may be multicast again, plus the time to gather answers in a packet.
ANSWER_S = OWN_PORT_S + 1.5 + 1.4
CONNECT_S = 0.5
MAX_SERVICES = 256
SIDE_BY_SIDE = 64

ANSWERS, VANISHED = "answers", "vanished"
NO_PROCESS, PORT_CLOSED = "no process", "port closed"


def discover(seconds: float, interfaces: Sequence[str] = LOOPBACK) -> list[Service]:
    """Search for ``seconds``, then check the services found, up to 64 in parallel.

    A check takes a few hundredths of a second if the service answers, otherwise ``ANSWER_S``.

    The check sets ``liveness``:

    - ``answers``: the service answered again and passed the cheap test, if there is one: the
      process exists (a node on this machine), or the port accepts a connection (``_tcp``).
    - ``no process``, ``port closed``: the service answered, but this test failed.
    - ``vanished``: the service was found, but was then withdrawn or stopped answering.

    None of these results proves that data will arrive.

    Raises:
        DiscoveryError: this machine has no such interface.
    """
    with _ports(interfaces) as ports:
        with _browsing(ports, list(KINDS)) as seen:
            threading.Event().wait(seconds)
        known = [(t, name, _heard(ports, t, name)) for name, t in seen.items()]
    with _ports(interfaces) as fresh, ThreadPoolExecutor(SIDE_BY_SIDE) as pool:
        services = list(pool.map(lambda found: _look(fresh, *found), known))
    return sorted(services, key=lambda s: (list(KINDS.values()).index(s.kind), s.name))


def resolve(
    service_type: str, name: str, timeout_s: float, interfaces: Sequence[str] = LOOPBACK
) -> tuple[str, int]:
    """Return the address and port of the service announced as ``name``.

    Args:
        service_type: such as ``_hri-source._tcp.local.``.
        name: name of the service, without its type.
        timeout_s: maximum time to wait for an answer.
        interfaces: addresses of the interfaces to search on.

    Raises:
        DiscoveryError: no service of that name answered in time; the error lists those that did.
    """
    with _ports(interfaces) as ports, _browsing(ports, [service_type]) as seen:
        info = ServiceInfo(service_type, f"{name}.{service_type}")
        found = _ask(ports, info, timeout_s)
        addresses = info.parsed_scoped_addresses() if found else []
        if addresses and info.port:
            return addresses[0], info.port
    there = sorted(printable(full.removesuffix(f".{service_type}")) for full in seen)
    others = f"found: {', '.join(there)}" if there else "found none"
    raise DiscoveryError(
        f"no {service_type.removesuffix('.local.')} named '{name}' answered within {timeout_s:g} s"
        f"{nearest(name, there)}; {others}; start it, or correct 'service'"
    )


def find(service_type: str, settings: ServiceSettings) -> tuple[str, int]:
    """Resolve the service in the settings of a source."""
    return resolve(service_type, settings.name, settings.timeout_s, settings.interfaces)


class _Ports(NamedTuple):
    """The two ports that send questions."""

    own: Zeroconf
    shared: Zeroconf


@contextlib.contextmanager
def _ports(interfaces: Sequence[str]) -> Iterator[_Ports]:
    with contextlib.ExitStack() as opened:
        where = ", ".join(interfaces)
        remedy = "name addresses of this machine"
        with OsErrorAs(DiscoveryError, f"cannot search on {where}", remedy):
            own = opened.enter_context(Zeroconf(interfaces=list(interfaces), unicast=True))
            shared = opened.enter_context(Zeroconf(interfaces=list(interfaces)))
        yield _Ports(own, shared)


@contextlib.contextmanager
def _browsing(ports: _Ports, types: list[str]) -> Iterator[dict[str, str]]:
    """Yield a dict that collects the services heard during the block: full name -> type."""
    seen: dict[str, str] = {}

    def note(service_type: str, name: str, **_: Any) -> None:
        if name in seen or len(seen) < MAX_SERVICES:
            seen[name] = service_type

    multicast = DNSQuestionType.QM
    browsers = [
        ServiceBrowser(ports.own, types, handlers=[note]),
        ServiceBrowser(ports.shared, types, handlers=[note], question_type=multicast),
    ]
    try:
        yield seen
    finally:
        for browser in browsers:
            browser.cancel()


def _ask(ports: _Ports, info: ServiceInfo, seconds: float) -> bool:
    """Return whether the service answers within ``seconds``; fill ``info``."""
    first = min(OWN_PORT_S, seconds / 2)
    return info.request(ports.own, first * 1e3) or info.request(
        ports.shared, (seconds - first) * 1e3, question_type=DNSQuestionType.QM
    )


def _heard(ports: _Ports, service_type: str, name: str) -> Service | None:
    """Return a service from its earlier answers, or ``None``."""
    info = _info(service_type, name)
    if info is None or not any(info.load_from_cache(zeroconf) for zeroconf in ports):
        return None
    return _service(service_type, name, info)


def _info(service_type: str, name: str) -> ServiceInfo | None:
    try:
        return ServiceInfo(service_type, name)
    except BadTypeInNameException:  # a service with such a name cannot be asked
        return None


def _service(service_type: str, name: str, info: ServiceInfo | None = None) -> Service:
    """Return a service as announced, not yet checked."""
    bare = printable(name.removesuffix(f".{service_type}"))
    if info is None:
        return Service(
            kind=KINDS[service_type],
            type=service_type,
            name=bare,
            host="",
            addresses=(),
            port=0,
            properties={},
            liveness=VANISHED,
        )
    return Service(
        kind=KINDS[service_type],
        type=service_type,
        name=bare,
        host=printable(info.server),
        addresses=tuple(info.parsed_scoped_addresses()),
        port=info.port or 0,
        properties={printable(k): printable(v) for k, v in info.properties.items()},
        liveness=VANISHED,
    )


def _look(ports: _Ports, service_type: str, name: str, known: Service | None) -> Service:
    """Query a service again with an empty cache, and run the cheap liveness test."""
    info = _info(service_type, name)
    if info is not None and _ask(ports, info, ANSWER_S):
        service = _service(service_type, name, info)
        return replace(service, liveness=_tried(service))
    return known or _service(service_type, name)


def _tried(service: Service) -> str:
    if service.kind == "node":
        here = service.properties.get("host") == socket.gethostname()
        return NO_PROCESS if here and not _runs(service.properties.get("pid", "")) else ANSWERS
    if "._tcp" not in service.type or not service.addresses:
        return ANSWERS  # a datagram receiver cannot be tested
    try:
        socket.create_connection((service.addresses[0], service.port), CONNECT_S).close()
    except OSError:
        return PORT_CLOSED
    return ANSWERS


def _runs(pid: str) -> bool:
    """Return whether a process with this id runs on this machine."""
    try:
        os.kill(int(pid), 0)
    except PermissionError:
        return True  # another user's
    except (OSError, ValueError, OverflowError):
        return False
    return True
