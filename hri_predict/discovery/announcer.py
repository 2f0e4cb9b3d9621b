"""A node announces itself, off the way: registering takes more than a second and a half."""

import ipaddress
import logging
import os
import socket
import threading
from collections.abc import Mapping
from typing import TYPE_CHECKING

from hri_predict.discovery.services import NODE, DiscoverySettings, instance, txt
from hri_predict.protocol.codec import SCHEMA_HASH, SCHEMA_VERSION

if TYPE_CHECKING:
    from hri_predict.config import Config

log = logging.getLogger(__name__)

TTL_S = 10  # a node that lost power is remembered so long; RFC 6762, 10, has longer ones in mind
RETRY_S = 10.0
STOP_S = 3.0  # a registration under way takes 1.7 s, withdrawing it 0.3 s


def node_properties(config: "Config") -> dict[str, str]:
    """What a node says of itself: names and kinds, no addresses of links and nothing secret."""
    settings = config.node.discovery
    name = settings.name if settings is not None else None
    return {
        "txtvers": "1",
        "node": name or config.path.stem,
        "source": config.source.kind,
        "predictor": config.predictor.name,
        "rate": f"{config.node.rate_hz:g}",
        "version": str(SCHEMA_VERSION),
        "schema": f"{SCHEMA_HASH:#010x}",
        "host": socket.gethostname(),
        "pid": str(os.getpid()),
        "links": ",".join(f"{link.name}:{link.kind}" for link in config.opened_links),
    }


class Announcer:
    """Announces one service from ``start`` until ``stop``; whatever fails is tried again.

    Args:
        settings: where to announce.
        properties: what the service says of itself; see ``node_properties``.

    Attributes:
        announced: set while the service is registered.
        last_error: one line about the newest trouble.
    """

    def __init__(self, settings: DiscoverySettings, properties: Mapping[str, str]) -> None:
        self.announced = threading.Event()
        self.last_error: str | None = None
        self._settings = settings
        self._properties = properties
        self._stopping = threading.Event()
        self._thread = threading.Thread(target=self._run, name="announcer", daemon=True)

    def start(self) -> None:
        """Begin; returns at once."""
        self._thread.start()

    def stop(self) -> None:
        """Withdraw the service; waits at most three seconds. Safe to call twice."""
        self._stopping.set()
        if self._thread.is_alive():
            self._thread.join(STOP_S)

    def _run(self) -> None:
        while not self._stopping.is_set():
            try:
                self._announce()
            except Exception as error:  # no network yet, or none any more: a hint less
                self._note(error)
                self._stopping.wait(RETRY_S)

    def _announce(self) -> None:
        from zeroconf import ServiceInfo, Zeroconf  # takes a while to load

        interfaces, said = self._settings.interfaces, self._properties
        name = instance(said["node"], said["host"], int(said["pid"]))
        info = ServiceInfo(
            NODE,
            f"{name}.{NODE}",
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
        text = str(error).splitlines()[0] if str(error) else type(error).__name__
        if text != self.last_error:
            where = ", ".join(self._settings.interfaces)
            log.warning("not announced on %s (%s); check discovery.interfaces", where, text)
        self.last_error = text


def _host_label(host: str) -> str:
    """A host's name as one label of DNS."""
    label = "".join(c if c.isascii() and c.isalnum() else "-" for c in host.split(".")[0])
    return label.strip("-")[:40] or "host"
