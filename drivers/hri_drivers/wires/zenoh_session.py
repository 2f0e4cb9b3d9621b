"""A zenoh session from its settings: through a router or peer to peer, by default only on loopback.

Zenoh's own defaults listen on all interfaces and search by multicast. Here both must be configured:
endpoints are explicit, multicast and gossip are off, and ``MAX_MESSAGE`` limits messages. Values
in a zenoh configuration file (``zenoh_config``: TLS, access control) take precedence if they differ
from zenoh's defaults; an explicit default looks the same as a missing value.
"""

import ipaddress
import json
import re
from pathlib import Path
from typing import Annotated, Any, Literal, Self

import zenoh
from pydantic import Field, StringConstraints, model_validator

from hri_predict.base.errors import ConfigError, LinkError
from hri_predict.base.files import read_text
from hri_predict.base.settings import Settings
from hri_predict.protocol.keyed import Name

ROUTER = "tcp/127.0.0.1:7447"
CONNECT_S = 0.5
LEASE_MS = 2000  # a neighbour silent for this long is gone
BLOCK_US = 200_000  # a neighbour that accepts nothing for this long is disconnected
MAX_MESSAGE = 65_536  # bytes; zenoh's own limit is 1 GiB
MAX_WORDS = 120

Mode = Literal["client", "peer", "router"]
Endpoint = Annotated[
    str, StringConstraints(pattern=r"^(tcp|tls|quic|udp|ws|unixsock-stream)/\S+$", max_length=256)
]


class ZenohSettings(Settings):
    """Settings to reach other zenoh nodes; for the link, the source and ``hri-predict fleet``."""

    mode: Mode | None = Field(
        None,
        description="client: connects to one router or peer (default); peer: connects to all "
        "named endpoints; router: forwards other nodes' messages",
    )
    connect: list[Endpoint] | None = Field(
        None, max_length=64, description=f"endpoints to connect to; default {ROUTER}"
    )
    listen: list[Endpoint] | None = Field(
        None, max_length=16, description="endpoints to listen on; default none"
    )
    zenoh_config: str | None = Field(
        None,
        min_length=1,
        description="zenoh configuration file: TLS, access control and all other settings",
    )

    @model_validator(mode="after")
    def _listens_as(self) -> Self:
        if self.listen and self.mode in (None, "client") and self.zenoh_config is None:
            raise ValueError("a client cannot listen; set 'mode: peer' (or router)")
        return self

    def resolved(self, base_dir: Path) -> Self:
        """These settings, with ``zenoh_config`` resolved from the configuration's ``base_dir``.

        Raises:
            ConfigError: the file cannot be read, or zenoh cannot parse it.
        """
        if self.zenoh_config is None:
            return self
        file = str(base_dir / self.zenoh_config)
        _from_file(file)  # show its mistakes before anything starts
        return self.model_copy(update={"zenoh_config": file})


class CellSettings(ZenohSettings):
    """Settings common to the link and the source: the cell in their keys."""

    site: Name = Field("site", description="first part of the key, shared by all cells of a site")
    cell: Name = Field(description="second part of the key; unique for each cell")


def open_session(settings: ZenohSettings) -> zenoh.Session:
    """Open a session.

    Raises:
        ConfigError: the zenoh file cannot be read, or zenoh rejects a setting.
        LinkError: there is no answer at the endpoints; one line that names them and the remedy.
    """
    config = session_config(settings)
    try:
        return zenoh.open(config)
    except zenoh.ZError as error:
        ends = ", ".join([*_endpoints(config, "connect"), *_endpoints(config, "listen")])
        raise LinkError(
            f"zenoh {ends}: {short(error)}; start the router or peer there, or correct 'connect' "
            f"and 'listen'"
        ) from error


def session_config(settings: ZenohSettings) -> zenoh.Config:
    """Zenoh's configuration: the file, then our settings, then safe defaults.

    Raises:
        ConfigError: the file cannot be read, or zenoh rejects a setting.
    """
    config = _from_file(settings.zenoh_config)
    fresh = zenoh.Config()

    def unless_said(key: str, value: Any) -> None:
        if config.get_json(key) == fresh.get_json(key):
            _insert(config, key, value)

    for key, value in (("mode", settings.mode), ("connect/endpoints", settings.connect),
                       ("listen/endpoints", settings.listen)):  # fmt: skip
        if value is not None:
            _insert(config, key, value)
    unless_said("mode", "client")
    unless_said("listen/endpoints", [])
    if not _endpoints(config, "listen"):
        unless_said("connect/endpoints", [ROUTER])
    unless_said("connect/timeout_ms", int(CONNECT_S * 1e3))
    unless_said("connect/exit_on_failure", {"client": True, "peer": False, "router": False})
    unless_said("connect/retry", {"period_init_ms": 100, "period_max_ms": 1000})
    unless_said("scouting/multicast/enabled", False)
    unless_said("scouting/gossip/enabled", False)
    unless_said("scouting/delay", 0)  # a router waits this long for discovery, which is off
    unless_said("transport/link/tx/lease", LEASE_MS)
    congestion = "transport/link/tx/queue/congestion_control/block/wait_before_close"
    unless_said(congestion, BLOCK_US)
    unless_said("transport/link/rx/max_message_size", MAX_MESSAGE)
    unless_said("transport/shared_memory/enabled", False)
    return config


def is_local(endpoint: str) -> bool:
    """Whether the address of an endpoint is on the loopback interface."""
    host = endpoint.partition("/")[2].split("?")[0].split("#")[0].rpartition(":")[0]
    try:
        return ipaddress.ip_address(host.strip("[]")).is_loopback
    except ValueError:
        return host == "localhost"


def expects_neighbour(config: zenoh.Config) -> bool:
    """Whether a neighbour must be connected: ``connect`` names an endpoint."""
    return bool(_endpoints(config, "connect"))


def short(error: BaseException) -> str:
    """Zenoh's message in one short line, without its source location."""
    text = " ".join(str(error).split(" at /")[0].split())
    if text.startswith("Unable to connect"):
        return "no answer"
    said = re.search(r'msg: "(.*?)(, expected one of .*)?"', text)
    text = (said[1] if said else text).strip(" .!")
    return text[:MAX_WORDS] or type(error).__name__


def _from_file(path: str | None) -> zenoh.Config:
    if path is None:
        return zenoh.Config()
    try:
        read_text(Path(path), "zenoh_config")  # zenoh itself would read an endless file forever
        return zenoh.Config.from_file(path)
    except zenoh.ZError as error:
        raise ConfigError(
            f"zenoh_config {path}: {short(error)}; correct the file or the path"
        ) from error


def _insert(config: zenoh.Config, key: str, value: Any) -> None:
    try:
        config.insert_json5(key, json.dumps(value))
    except zenoh.ZError as error:
        raise ConfigError(f"zenoh {key}: {short(error)}; correct it") from error


def _endpoints(config: zenoh.Config, side: str) -> list[str]:
    """Endpoints of one side, in any of zenoh's notations."""
    value = json.loads(config.get_json(f"{side}/endpoints"))
    if isinstance(value, dict):  # by mode
        value = value.get(json.loads(config.get_json("mode")) or "peer") or []
    return [v if isinstance(v, str) else json.dumps(v) for v in value]
