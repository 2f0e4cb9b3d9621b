"""Service types and their properties."""

import ipaddress
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Annotated, Any, ClassVar

from pydantic import AfterValidator, Field

from hri_predict.base.quantities.safe_side import Safety, harmless
from hri_predict.base.settings import Abbreviated, Settings

NODE = "_hri-predict._tcp.local."
SOURCES = ("_hri-source._tcp.local.", "_hri-source._udp.local.")
CONTROLLERS = ("_hri-controller._tcp.local.", "_hri-controller._udp.local.")
KINDS = {NODE: "node"} | dict.fromkeys(SOURCES, "source") | dict.fromkeys(CONTROLLERS, "controller")

MAX_LABEL = 63  # bytes of a service's own name (RFC 1035, 2.3.4)
MAX_NAME = 32
MAX_TXT = 200  # bytes of one key=value; RFC 6763, 6.1 allows 255
LOOPBACK = ["127.0.0.1"]


def _address(value: str) -> str:
    try:
        return str(ipaddress.ip_address(value))
    except ValueError:
        raise ValueError("must be an IP address of this machine, such as 192.168.1.5") from None


def _printable(value: str) -> str:
    if not value.isprintable() or len(value.encode()) > MAX_LABEL:
        raise ValueError(f"must be printable and no longer than {MAX_LABEL} bytes")
    return value


Interfaces = Annotated[list[Annotated[str, AfterValidator(_address)]], Field(min_length=1)]
"""Addresses of the network interfaces on which to announce or to search."""
ServiceName = Annotated[str, Field(min_length=1, max_length=MAX_LABEL), AfterValidator(_printable)]


class DiscoverySettings(Settings):
    """``discovery:``; without it a node announces nothing and opens no socket for discovery."""

    name: Annotated[str, AfterValidator(_printable)] | None = Field(
        None, min_length=1, max_length=MAX_NAME, description="default: the configuration's name"
    )
    interfaces: Interfaces = Field(
        LOOPBACK, description="addresses to announce on; default: only on this machine"
    )


class ServiceSettings(Abbreviated):
    """The ``service:`` entry of a source: announced name of the service to connect to."""

    name: ServiceName = Field(description="announced name of the service")
    interfaces: Interfaces = Field(LOOPBACK, description="address of the interface to search on")
    timeout_s: float = Field(2.0, ge=0.1, le=30, description="duration of each search")

    safety: ClassVar[Safety] = harmless("timeout_s")


@dataclass(frozen=True, slots=True, kw_only=True)
class Service:
    """A service as announced; all strings are made printable.

    Attributes:
        kind: ``node``, ``source`` or ``controller``.
        type, name: full type, and the name, unique within its type.
        host, addresses, port: where it is reachable; 0 as the port of a node, which has none.
        properties: its other announced properties.
        liveness: the result of the check, a hint. See ``browser.discover``.
    """

    kind: str
    type: str
    name: str
    host: str
    addresses: tuple[str, ...]
    port: int
    properties: Mapping[str, str]
    liveness: str

    def as_dict(self) -> dict[str, Any]:
        """Return data that can be written as JSON."""
        return asdict(self)


def instance(name: str, host: str, pid: int, number: int = 1) -> str:
    """Return the name that a node announces; it is unique even if two nodes have one ``name``.

    ``number`` distinguishes nodes with the same host name and process id, as in two containers.
    """
    own = f" {pid}" if number == 1 else f" {pid}-{number}"
    return cut(f"{cut(name, MAX_NAME)} {host}", MAX_LABEL - len(own)) + own


def txt(properties: Mapping[str, str]) -> dict[str, bytes]:
    """Return properties encoded for a TXT record; a value that is too long ends in "…"."""
    return {k: cut(v, MAX_TXT - len(k) - 1).encode() for k, v in properties.items()}


def printable(data: bytes | str | None) -> str:
    """Return text from another device, made printable for a terminal."""
    text = data.decode("utf-8", "replace") if isinstance(data, bytes) else data or ""
    return "".join(c if c.isprintable() else "?" for c in text)


def cut(text: str, most: int) -> str:
    """Cut a text to at most ``most`` bytes of UTF-8."""
    if len(text.encode()) <= most:
        return text
    return text.encode()[: most - 3].decode("utf-8", "ignore") + "…"
