"""Alerts over syslog, in the format of RFC 5424.

Each alert is a UDP datagram (RFC 5426), a message with an octet count over TCP or TLS (RFC 6587,
RFC 5425), or a message to the machine's own socket. Syslog does not acknowledge messages:
*delivered* means that the alert left the machine.
"""

import os
import socket
import ssl
from datetime import UTC, datetime
from typing import Literal, Self

from pydantic import Field, model_validator

from hri_predict.operation.alerting.alert import (
    Alert,
    AnyAlert,
    ZoneAlert,
    ascii_word,
    more,
    one_line,
)
from hri_predict.operation.alerting.sender import (
    HookContext,
    Sender,
    SendError,
    cut_after,
    said,
    tls_context,
)
from hri_predict.operation.alerting.settings import CaFile, HookSettings, Host, is_loopback

_PORTS = {"udp": 514, "tcp": 601, "tls": 6514}
_FACILITIES = {"user": 1, "daemon": 3, **{f"local{i}": 16 + i for i in range(8)}}
_SEVERITIES = {"fault": 2, "unknown": 3, "stop": 4, "slow": 5, "warn": 5, "clear": 6}
"""Critical, error, warning, notice, informational (RFC 5424, table 2)."""
MAX_OCTETS = 2048
"""Size that a receiver should accept (RFC 5424, section 6.1)."""

Facility = Literal[
    "user", "daemon", "local0", "local1", "local2", "local3", "local4", "local5", "local6", "local7"
]


class SyslogHook(HookSettings):
    """``kind: syslog``."""

    kind: Literal["syslog"] = Field(description="syslog lines, RFC 5424")
    protocol: Literal["udp", "tcp", "tls", "unix"] = Field(
        "udp", description="transport of the lines; udp and unix do not acknowledge"
    )
    host: Host | None = Field(
        None, description="the collector's name or address; not used with unix"
    )
    port: int | None = Field(None, ge=1, le=65535, description="default: 514, tcp 601, tls 6514")
    path: str | None = Field(None, min_length=1, description="with unix: the socket, as /dev/log")
    facility: Facility = Field("local0", description="syslog facility of all lines")
    ca_file: CaFile = None
    rate_per_minute: int = Field(
        60,
        ge=1,
        le=6000,
        description="maximum lines per minute; the next line gives the number of changes left out",
    )

    @model_validator(mode="after")
    def _fits(self) -> Self:
        unix = self.protocol == "unix"
        if unix and (self.path is None or self.host is not None or self.port is not None):
            raise ValueError("protocol: unix needs 'path', and neither host nor port")
        if not unix and (self.host is None or self.path is not None):
            raise ValueError(f"protocol: {self.protocol} needs 'host', and no 'path'")
        if self.ca_file is not None and self.protocol != "tls":
            raise ValueError("ca_file has no effect without protocol: tls; remove it")
        return self

    def create_sender(self, place: HookContext) -> Sender:
        """See the base class."""
        return SyslogSender(self, place)

    @property
    def where(self) -> str:
        """The receiver."""
        return self.path or f"{self.host}:{self.open_port}"

    @property
    def open_port(self) -> int:
        """The port in use."""
        return self.port or _PORTS.get(self.protocol, 0)

    @property
    def notes(self) -> list[str]:
        """Notes on what is sent without TLS."""
        if self.protocol in ("unix", "tls") or is_loopback(self.host or ""):
            return []
        return [
            f"syslog without TLS to {self.host}: anyone on the network path can read and change "
            "alerts; use protocol: tls if the receiver supports it"
        ]


class SyslogSender(Sender):
    """Sends each alert over a socket of its own."""

    def __init__(self, settings: SyslogHook, place: HookContext) -> None:
        self._settings, self._place = settings, place
        tls = settings.protocol == "tls"
        self._tls = tls_context(settings.ca_file, place.base_dir) if tls else None

    def send(self, alert: AnyAlert, more_changes: int) -> str:
        """Send the alert to the network or the socket."""
        data = message(self._settings, self._place.cell, alert, more_changes)
        try:
            if self._settings.protocol == "unix":
                self._to_unix(data)
            elif self._settings.protocol == "udp":
                self._to_udp(data)
            else:
                self._to_stream(b"%d " % len(data) + data)
        except OSError as error:
            raise SendError(said(error)) from error
        return "sent; syslog does not acknowledge messages"

    def _to_unix(self, data: bytes) -> None:
        with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as out:
            out.settimeout(self._settings.timeout_s)
            out.sendto(data, self._settings.path or "")

    def _to_udp(self, data: bytes) -> None:
        host, port = self._settings.host, self._settings.open_port
        family, _, _, _, address = socket.getaddrinfo(host, port, type=socket.SOCK_DGRAM)[0]
        with socket.socket(family, socket.SOCK_DGRAM) as out:
            out.settimeout(self._settings.timeout_s)
            out.sendto(data, address)

    def _to_stream(self, data: bytes) -> None:
        timeout = self._settings.timeout_s
        address = (self._settings.host or "", self._settings.open_port)
        plain = socket.create_connection(address, timeout)
        if self._tls is None:
            with plain, cut_after(timeout, lambda: plain):
                plain.sendall(data)
                plain.shutdown(socket.SHUT_WR)
            return
        with (
            self._tls.wrap_socket(
                plain, server_hostname=address[0], do_handshake_on_connect=False
            ) as out,
            cut_after(timeout, lambda: out),
        ):
            out.do_handshake()
            out.sendall(data)
            _say_bye(out)


def _say_bye(out: ssl.SSLSocket) -> None:
    """Send TLS's close notification; otherwise the receiver assumes a truncated connection."""
    try:
        out.unwrap()
    except OSError:
        return


def message(settings: SyslogHook, cell: str, alert: AnyAlert, more_changes: int) -> bytes:
    """One message of RFC 5424, at most ``MAX_OCTETS`` long; ``MSGID`` is the level, or ``ZONE``."""
    kind, severity = "TEST", 6
    if isinstance(alert, Alert):
        kind, severity = ascii_word(alert.level.upper(), 32), _SEVERITIES.get(alert.level, 4)
    elif isinstance(alert, ZoneAlert):
        kind, severity = "ZONE", 5
    stamp = alert.at or datetime.now(UTC).isoformat(timespec="milliseconds")
    header = " ".join(
        (
            f"<{8 * _FACILITIES[settings.facility] + severity}>1",
            stamp.replace("+00:00", "Z"),
            ascii_word(socket.gethostname(), 255),
            "hri-predict",
            str(os.getpid()),
            kind,
            "-",  # no structured data: its names need a number of one's own from IANA
        )
    )
    text = one_line(f"{cell}: {alert.line()}{more(more_changes)}")
    whole = header.encode("ascii") + b" \xef\xbb\xbf" + text.encode()
    return whole[:MAX_OCTETS].decode(errors="ignore").encode()
