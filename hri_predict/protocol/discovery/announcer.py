"""Announces a node from a separate thread, because registration takes more than two seconds."""

import ipaddress
import logging
import os
import socket
import threading
from collections.abc import Mapping, Sequence

from hri_predict.base.errors import failure, first_line
from hri_predict.protocol.codec import SCHEMA_HASH, SCHEMA_VERSION
from hri_predict.protocol.discovery.services import NODE, DiscoverySettings, instance, txt

log = logging.getLogger(__name__)

TTL_S = 10  # how long a node without power stays known; RFC 6762, 10 suggests longer times
RETRY_S = 10.0
TAKEN_S = 0.5  # a node with this name answers at once; the question is repeated after 0.3 s
MOST_CLONES = 16  # most nodes with one host name and process number; a bound on the search
STOP_S = 3.0  # a registration in progress takes 2.2 s, its withdrawal 0.3 s


def node_properties(
    *, node: str, source: str, predictor: str, rate_hz: float, links: Mapping[str, str]
) -> dict[str, str]:
    """Return a node's announced properties: names and kinds, without link addresses or secrets.

    Args:
        node: its name.
        source: kind of its source.
        predictor: name of its predictor.
        rate_hz: ticks per second.
        links: kind of each link, by name.
    """
    return {
        "txtvers": "1",
        "node": node,
        "source": source,
        "predictor": predictor,
        "rate": f"{rate_hz:g}",
        "version": str(SCHEMA_VERSION),
        "schema": f"{SCHEMA_HASH:#010x}",
        "host": socket.gethostname(),
        "pid": str(os.getpid()),
        "links": ",".join(f"{name}:{kind}" for name, kind in links.items()),
    }


class Announcer:
    """Announces one service from ``start`` until ``stop``; retries after a failure.

    Args:
        settings: interfaces to announce on.
        properties: the service's properties; see ``node_properties``.

    Attributes:
        announced: set while the service is registered.
        last_error: one line about the last failure.
    """

    def __init__(self, settings: DiscoverySettings, properties: Mapping[str, str]) -> None:
        self.announced = threading.Event()
        self.last_error: str | None = None
        self._settings = settings
        self._properties = properties
        self._stopping = threading.Event()
        self._thread = threading.Thread(target=self._run, name="announcer", daemon=True)

    def start(self) -> None:
        """Start announcing without waiting for the registration."""
        self._thread.start()

    def stop(self) -> None:
        """Withdraw the service, waiting at most three seconds. Safe to call twice."""
        self._stopping.set()
        if self._thread.is_alive():
            self._thread.join(STOP_S)

    def _run(self) -> None:
        while not self._stopping.is_set():
            try:
                self._announce()
            except BaseException as error:  # no network, for example; the node runs on without
                self._note(failure(error))
                self._stopping.wait(RETRY_S)

    def _announce(self) -> None:
        from zeroconf import ServiceInfo, Zeroconf  # takes a while to load

        interfaces, said = self._settings.interfaces, self._properties
        info = ServiceInfo(
            NODE,
            _free_name(said, interfaces),
            addresses=[ipaddress.ip_address(address).packed for address in interfaces],
            port=0,
            properties=dict(txt(said)),
            server=f"{_host_label(said['host'])}-{said['pid']}.local.",
            host_ttl=TTL_S,
            other_ttl=TTL_S,
        )
        zeroconf = Zeroconf(interfaces=list(interfaces))
        try:
            zeroconf.register_service(info, allow_name_change=True)
            self.announced.set()
            self._stopping.wait()
        finally:
            self.announced.clear()
            zeroconf.close()  # withdraws it

    def _note(self, error: Exception) -> None:
        text = first_line(error)
        if text != self.last_error:
            where = ", ".join(self._settings.interfaces)
            log.warning("not announced on %s (%s); check discovery.interfaces", where, text)
        self.last_error = text


def _free_name(said: Mapping[str, str], interfaces: Sequence[str]) -> str:
    """Return a full name that no service uses yet, or the last name tried.

    ``register_service`` checks this as well, but requests a unicast answer to port 5353, which may
    reach another program that shares the port. A private port receives every answer (RFC 6762,
    6.7).
    """
    from zeroconf import ServiceInfo, Zeroconf

    with Zeroconf(interfaces=list(interfaces), unicast=True) as own:
        for number in range(1, MOST_CLONES + 1):
            name = f"{instance(said['node'], said['host'], int(said['pid']), number)}.{NODE}"
            if not ServiceInfo(NODE, name).request(own, TAKEN_S * 1e3):
                break
    return name


def _host_label(host: str) -> str:
    """Return a host's name as one DNS label."""
    label = "".join(c if c.isascii() and c.isalnum() else "-" for c in host.split(".")[0])
    return label.strip("-")[:40] or "host"
