"""Alerts by e-mail, through a mail server (SMTP)."""

import email.policy
import json
import re
import smtplib
import socket
from collections.abc import Callable
from datetime import UTC, datetime
from email.message import EmailMessage
from email.utils import format_datetime, make_msgid
from functools import partial
from typing import Annotated, ClassVar, Literal, Self

from pydantic import Field, model_validator

from hri_predict.operation.alerting.alert import AnyAlert, more, one_line, payload
from hri_predict.operation.alerting.sender import (
    Answer,
    HookContext,
    Sender,
    SendError,
    cut_after,
    said,
    tls_context,
)
from hri_predict.operation.alerting.settings import (
    CaFile,
    HookSettings,
    Host,
    SecretFile,
    SecretVariable,
    Text,
    is_loopback,
)

Address = Annotated[
    str, Field(max_length=254, pattern=r"^[A-Za-z0-9.!#$%&'*+/=?^_`{|}~-]+@[A-Za-z0-9.-]+$")
]
"""Follows HTML's rule for e-mail addresses: plain ASCII, no name, no quotes."""
_PORTS = {"starttls": 587, "tls": 465, "none": 25}


class MailHook(HookSettings):
    """``kind: email``."""

    secrets: ClassVar[tuple[str, ...]] = ("password",)

    kind: Literal["email"] = Field(description="e-mail over SMTP")
    host: Host = Field(description="the mail server's name or address")
    port: int | None = Field(None, ge=1, le=65535, description="default: 587, with tls 465")
    security: Literal["starttls", "tls", "none"] = Field(
        "starttls",
        description="encryption; with none no password is sent, except to this machine",
    )
    ca_file: CaFile = None
    sender: Address = Field(description="sender address")
    recipients: list[Address] = Field(
        min_length=1, max_length=20, description="recipient addresses"
    )
    username: Text | None = Field(
        None, description="user name to log in with; the password comes from a file or a variable"
    )
    password_file: SecretFile = None
    password_env: SecretVariable = None
    debounce_s: float = Field(
        10.0,
        ge=0,
        le=3600,
        description="minimum time between two mails about one robot or zone, seconds",
    )
    rate_per_minute: int = Field(
        6,
        ge=1,
        le=6000,
        description="maximum mails per minute; the next mail gives the number of changes left out",
    )
    timeout_s: float = Field(10.0, ge=0.1, le=60, description="give up one attempt after this time")

    @model_validator(mode="after")
    def _fits(self) -> Self:
        password = self.password_file or self.password_env
        if (password is None) != (self.username is None):
            raise ValueError("username and password_file (or password_env) go together")
        if password and self.security == "none" and not is_loopback(self.host):
            raise ValueError(
                "security: none would send the password unencrypted; use starttls or tls"
            )
        return self

    def create_sender(self, place: HookContext) -> Sender:
        """See the base class."""
        return MailSender(self, place)

    @property
    def where(self) -> str:
        """The server."""
        return f"{self.host}:{self.open_port}"

    @property
    def open_port(self) -> int:
        """The port in use."""
        return self.port or _PORTS[self.security]

    @property
    def notes(self) -> list[str]:
        """Notes on what is sent without TLS."""
        if self.security != "none" or is_loopback(self.host):
            return []
        return [
            f"e-mail without TLS to {self.host}: anyone on the network path can read and change "
            "alerts; use security: starttls"
        ]


class _Bounded(smtplib.SMTP):
    """SMTP client that limits the length of answers."""

    def getreply(self) -> tuple[int, bytes]:
        if self.file is None and self.sock is not None:  # new after connecting, and after STARTTLS
            self.file = Answer(self.sock.makefile("rb"))
        return super().getreply()


class _TlsClient(_Bounded, smtplib.SMTP_SSL):
    """SMTP client with TLS from the first byte."""


class MailSender(Sender):
    """Sends each alert over a connection of its own."""

    def __init__(self, settings: MailHook, place: HookContext) -> None:
        self._settings, self._place = settings, place
        self._password = settings.secret("password", place.base_dir)
        self.secrets = () if self._password is None else (self._password,)
        self._tls = tls_context(settings.ca_file, place.base_dir)

    def send(self, alert: AnyAlert, more_changes: int) -> str:
        """Send the alert to the server, which must accept it for every recipient."""
        letter = message(self._settings, self._place.cell, alert, more_changes)
        client = self._client()
        try:
            with cut_after(self._settings.timeout_s, lambda: client.sock):
                client.connect(self._settings.host, self._settings.open_port)
                if self._settings.security == "starttls":
                    client.starttls(context=self._tls)
                if self._settings.username is not None:
                    client.login(self._settings.username, self._password or "")
                refused = client.send_message(letter)
        except smtplib.SMTPResponseException as error:
            permanent = 500 <= error.smtp_code < 600
            raise SendError(_answer(error.smtp_code), permanent=permanent) from error
        except smtplib.SMTPRecipientsRefused as error:
            codes = [code for code, _ in error.recipients.values()]
            raise SendError(
                f"the server refuses all recipients: {_answer(codes[0])}",
                permanent=all(500 <= code < 600 for code in codes),
            ) from error
        except (OSError, smtplib.SMTPException, ValueError) as error:
            raise SendError(said(error)) from error
        finally:
            client.close()
        if refused:  # another attempt would reach the others twice
            names = ", ".join(refused)
            raise SendError(f"the server refuses for {names}", permanent=True)
        return "accepted by the server"

    def _client(self) -> smtplib.SMTP:
        """Return an unconnected client, so that its socket can be shut down from the start."""
        timeout = self._settings.timeout_s
        client: Callable[..., smtplib.SMTP] = _Bounded
        if self._settings.security == "tls":
            client = partial(_TlsClient, context=self._tls)
        made = client(local_hostname=_own_name(), timeout=timeout)
        # whose certificate TLS expects; nothing but the constructor sets it
        made._host = self._settings.host  # type: ignore[attr-defined]
        return made


def message(settings: MailHook, cell: str, alert: AnyAlert, more_changes: int) -> EmailMessage:
    """The e-mail of one alert."""
    letter = EmailMessage(policy=email.policy.SMTP)
    letter["From"] = settings.sender
    letter["To"] = ", ".join(settings.recipients)
    letter["Subject"] = one_line(f"[{cell}] {alert.title()}{more(more_changes)}", 200)
    letter["Date"] = format_datetime(
        datetime.fromisoformat(alert.at) if alert.at else datetime.now(UTC)
    )
    letter["Message-ID"] = make_msgid(domain=_own_name())
    letter["Auto-Submitted"] = "auto-generated"  # RFC 3834: so that nobody's vacation answers
    text = [alert.line() + more(more_changes), f"UTC: {alert.at}"]
    data = json.dumps(payload(alert, cell, more_changes), indent=1)
    letter.set_content("\n".join([*text, "", data, ""]), cte="quoted-printable")
    return letter


def _own_name() -> str:
    """Return this machine's name for the server; the library's default may wait for a name
    server.
    """
    return re.sub(r"[^A-Za-z0-9.-]", "-", socket.gethostname()) or "localhost"


def _answer(code: int) -> str:
    """Describe a server's answer using its code alone: its text might repeat a secret."""
    known = {535: "user name or password is wrong", 530: "it requires a user name and a password"}
    return f"SMTP status {code}" + (f": {known[code]}" if code in known else "")
