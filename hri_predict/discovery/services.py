"""Which services there are, and what they say of themselves."""

import ipaddress
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Annotated, Any

from pydantic import AfterValidator, Field, model_validator

from hri_predict.settings import Settings

NODE = "_hri-predict._tcp.local."
SOURCES = ("_hri-source._tcp.local.", "_hri-source._udp.local.")
CONTROLLERS = ("_hri-controller._tcp.local.", "_hri-controller._udp.local.")
KINDS = {NODE: "node"} | dict.fromkeys(SOURCES, "source") | dict.fromkeys(CONTROLLERS, "controller")

MAX_LABEL = 63  # bytes of a service's own name (RFC 1035, 2.3.4)
MAX_NAME = 32
MAX_TXT = 200  # bytes of one key=value, of 255 that there may be (RFC 6763, 6.1)
LOOPBACK = ["127.0.0.1"]


def _address(value: str) -> str:
    try:
        return str(ipaddress.ip_address(value))
    except ValueError:
        raise ValueError("must be an IP address of this machine, as 192.168.1.5") from None


def _printable(value: str) -> str:
    if not value.isprintable() or len(value.encode()) > MAX_LABEL:
        raise ValueError(f"must be printable and no longer than {MAX_LABEL} bytes")
    return value


Interfaces = Annotated[list[Annotated[str, AfterValidator(_address)]], Field(min_length=1)]
"""Addresses of the network interfaces on which to announce or to search."""
ServiceName = Annotated[str, Field(min_length=1, max_length=MAX_LABEL), AfterValidator(_printable)]


class DiscoverySettings(Settings):
    """``discovery:``; without it a node announces nothing and opens no socket for it."""

    name: Annotated[str, AfterValidator(_printable)] | None = Field(
        None, min_length=1, max_length=MAX_NAME, description="default: the configuration's name"
    )
    interfaces: Interfaces = Field(
        LOOPBACK, description="addresses to announce on; default: this machine alone hears it"
    )


class ServiceSettings(Settings):
    """``service:`` of a source: who to connect to, by the name that it announces."""

    name: ServiceName
    interfaces: Interfaces = Field(LOOPBACK, description="where to search for it")
    timeout_s: float = Field(2.0, gt=0, le=30, description="how long to search at each try")

    @model_validator(mode="before")
    @classmethod
    def _name_alone(cls, data: Any) -> Any:
        return {"name": data} if isinstance(data, str) else data


@dataclass(frozen=True, slots=True)
class Service:
    """A service as it announced itself; strings are printable, whatever it sent.

    Attributes:
        kind: ``node``, ``source`` or ``controller``.
        type, name: full type, and the name that tells it from others of its type.
        host, addresses, port: where it says it is; a node has no port (0): it is asked for nothing.
        properties: what else it says.
        liveness: what a look at it gave; a hint. See ``browser.discover``.
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
        """For JSON."""
        return asdict(self)


def instance(name: str, host: str, pid: int) -> str:
    """The name that a node announces: no two nodes share it, whatever they are called."""
    own = f" {pid}"
    return cut(f"{cut(name, MAX_NAME)} {host}", MAX_LABEL - len(own)) + own


def txt(properties: Mapping[str, str]) -> dict[str, bytes]:
    """Properties as they go into a TXT record; what is too long ends in an ellipsis."""
    return {k: cut(v, MAX_TXT - len(k) - 1).encode() for k, v in properties.items()}


def printable(data: bytes | str | None) -> str:
    """Text of what somebody else sent, for a terminal."""
    text = data.decode("utf-8", "replace") if isinstance(data, bytes) else data or ""
    return "".join(c if c.isprintable() else "?" for c in text)


def cut(text: str, most: int) -> str:
    """No more than so many bytes of UTF-8."""
    if len(text.encode()) <= most:
        return text
    return text.encode()[: most - 3].decode("utf-8", "ignore") + "…"
