"""Alerts over MQTT: the broker retains the newest per robot and zone, and reports a lost node.

Topics, below ``topic`` (``hri-predict/CELL`` by default):

- ``robots/NAME``, ``zones/NAME``: the newest alert as JSON, retained;
- ``status``: ``online`` or ``offline``, retained; after a loss the broker itself sends ``offline``.
"""

import contextlib
import json
import secrets
import socket
import ssl
import threading
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, ClassVar, Literal, Self

from pydantic import Field, model_validator

from hri_predict.base.errors import ConfigError
from hri_predict.operation.alerting.alert import Alert, AnyAlert, ZoneAlert, payload, topic_level
from hri_predict.operation.alerting.sender import (
    ANSWER_BYTES,
    HookContext,
    Sender,
    SendError,
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

if TYPE_CHECKING:
    from paho.mqtt.client import Client

KEEPALIVE_S = 15
"""Keep-alive interval; the broker sends ``offline`` after 1.5 times this without a packet (MQTT
3.1.1, 3.1.2.10).
"""
_CONNACK = b"\x20\x02"
_REFUSALS = {
    1: "Unacceptable protocol version; use a broker that speaks MQTT 3.1.1",
    2: "Identifier rejected; set 'client_id' to one that the broker accepts",
    3: "Server unavailable; try again later",
    4: "Bad user name or password; correct 'username' or the password",
    5: "Not authorized; correct 'username', the password or the broker's access list",
}
"""Return codes of CONNACK (MQTT 3.1.1, table 3.1), each with a remedy."""


class MqttHook(HookSettings):
    """``kind: mqtt``. No ``levels``: the state that the broker keeps must be true."""

    secrets: ClassVar[tuple[str, ...]] = ("password",)

    kind: Literal["mqtt"] = Field(description="messages to an MQTT broker")
    host: Host = Field(description="the broker's name or address")
    port: int | None = Field(None, ge=1, le=65535, description="default: 8883 with TLS, else 1883")
    tls: bool = Field(True, description="encrypt, and check the broker's certificate")
    ca_file: CaFile = None
    topic: str | None = Field(
        None,
        min_length=1,
        max_length=200,
        pattern=r"^[^#+$\x00-\x1f\x7f][^#+\x00-\x1f\x7f]*$",
        description="prefix of all topics; default: hri-predict/CELL",
    )
    username: Text | None = Field(
        None, description="user name to log in with; the password comes from a file or a variable"
    )
    password_file: SecretFile = None
    password_env: SecretVariable = None
    client_id: str | None = Field(
        None,
        min_length=1,
        max_length=200,
        pattern=r"^[^\x00-\x1f\x7f]+$",
        description="client id, unique at the broker; default: the cell's name and a random suffix",
    )

    @model_validator(mode="after")
    def _fits(self) -> Self:
        if self.levels is not None:
            raise ValueError(
                "levels: not allowed with kind mqtt: the broker would retain an outdated level; "
                "remove it, and let subscribers filter"
            )
        if (self.password_file or self.password_env) and self.username is None:
            raise ValueError("a password needs 'username'")
        return self

    def create_sender(self, place: HookContext) -> Sender:
        """See the base class."""
        return MqttSender(self, place)

    @property
    def where(self) -> str:
        """The broker."""
        return f"{self.host}:{self.open_port}"

    @property
    def open_port(self) -> int:
        """The port in use."""
        return self.port or (8883 if self.tls else 1883)

    @property
    def notes(self) -> list[str]:
        """Notes on what is sent without TLS."""
        if self.tls or is_loopback(self.host):
            return []
        password = ", and the password" if self.username else ""
        return [
            f"MQTT without TLS to {self.host}: anyone on the network path can read and change "
            "alerts"
            f"{password}; use tls: true"
        ]


class MqttSender(Sender):
    """Keeps a connection open and publishes with QoS 1.

    Each connection uses a new client: a client that reconnected by itself would first resend
    unacknowledged messages, and the broker could retain an old level instead of a newer one.
    """

    tend_s = 5.0

    def __init__(self, settings: MqttHook, place: HookContext) -> None:
        _paho()
        self._settings, self._place = settings, place
        self._password = settings.secret("password", place.base_dir)
        self.secrets = () if self._password is None else (self._password,)
        self._tls = tls_context(settings.ca_file, place.base_dir) if settings.tls else None
        self._base = settings.topic or f"hri-predict/{topic_level(place.cell)}"
        self._client_id = settings.client_id or client_id(place.cell)
        self._kept: dict[str, str] = {}  # topic -> newest alert
        self._client: Client | None = None
        self._budget: _Budget

    def send(self, alert: AnyAlert, more_changes: int) -> str:
        """Publish the alert; the broker must acknowledge it."""
        data = json.dumps(payload(alert, self._place.cell, more_changes))
        topic = self._topic(alert)
        if topic is None:  # a trial
            self._connect()
            self._publish(f"{self._base}/test", data, retain=False)
            return "acknowledged by the broker"
        self._kept[topic] = data
        if not self._connect():  # else all that is kept was just published
            self._publish(topic, data)
        return "acknowledged by the broker"

    def tend(self) -> None:
        """Reconnect after a loss, so that the broker shows ``online`` and retains the current
        state.
        """
        if self._client is not None:
            self._budget.left = ANSWER_BYTES
        if self._kept:
            self._connect()

    def close(self) -> None:
        """Publish ``offline`` and disconnect."""
        if self._client is not None and self._client.is_connected() and self._place.live:
            self._publish(f"{self._base}/status", "offline")
        if self._client is not None:
            self._client.disconnect()  # in order, so that the broker adds nothing
        self._drop()

    def _topic(self, alert: AnyAlert) -> str | None:
        if isinstance(alert, Alert):
            return f"{self._base}/robots/{topic_level(alert.robot)}"
        if isinstance(alert, ZoneAlert):
            return f"{self._base}/zones/{topic_level(alert.zone)}"
        return None

    def _connect(self) -> bool:
        """Connect if there is no connection, and publish the retained messages; return whether it
        connected.
        """
        if self._client is not None and self._client.is_connected():
            return False
        self._drop()
        self._client = client = self._new_client()
        answered = threading.Event()

        def answer(*given: Any) -> None:  # by the library's thread, after CONNACK or the end
            answered.set()

        client.on_connect = client.on_disconnect = answer
        try:
            client.connect(self._settings.host, self._settings.open_port, KEEPALIVE_S)
        except (OSError, ValueError) as error:
            self._drop()
            hint = ""
            if self._settings.tls and isinstance(error, ssl.SSLError | ConnectionResetError):
                hint = "; a broker without TLS needs 'tls: false' and its port (mostly 1883)"
            raise SendError(f"cannot connect: {said(error)}{hint}") from error
        client.loop_start()
        in_time = answered.wait(self._settings.timeout_s)
        code = self._budget.connack
        if not in_time or code != 0:
            heard = self._budget.heard_another
            self._drop()
            raise SendError(_refusal(code, in_time, heard))
        if self._place.live:
            for topic, data in self._kept.items():
                self._publish(topic, data)
            self._publish(f"{self._base}/status", "online")
        return True

    def _new_client(self) -> "Client":
        mqtt = _paho()
        client = mqtt.Client(
            mqtt.CallbackAPIVersion.VERSION2,
            client_id=self._client_id,  # brokers may refuse an empty one (MQTT 3.1.1, 3.1.3.1)
            reconnect_on_failure=False,
        )
        client.connect_timeout = self._settings.timeout_s
        self._budget = _Budget(client._sock_recv)
        client._sock_recv = self._budget.read  # the library has no limit of its own
        if self._place.live:
            client.will_set(f"{self._base}/status", "offline", qos=1, retain=True)
        if self._settings.username is not None:
            client.username_pw_set(self._settings.username, self._password)
        if self._tls is not None:
            client.tls_set_context(self._tls)
        return client

    def _publish(self, topic: str, data: str, *, retain: bool = True) -> None:
        assert self._client is not None
        info = self._client.publish(topic, data, qos=1, retain=retain)
        try:
            info.wait_for_publish(self._settings.timeout_s)
            done = info.is_published()
        except (RuntimeError, ValueError):  # the connection was lost meanwhile
            done = False
        if not done:
            self._drop()
            if self._budget.left < 0:
                raise SendError("the broker sends packets that were not requested")
            raise SendError("the broker does not acknowledge")

    def _drop(self) -> None:
        """Drop the connection without DISCONNECT, so that the broker sends ``offline`` for us."""
        client, self._client = self._client, None
        if client is None:
            return
        connection = client.socket()
        if isinstance(connection, socket.socket):
            with contextlib.suppress(OSError):  # TLS's own shutdown would wait for the other side
                socket.socket.shutdown(connection, socket.SHUT_RDWR)
        client.loop_stop()


class _Budget:
    """Limits the data that a broker may send within ``tend_s``; the client has no subscriptions.

    Reading uses the interpreter that also runs the loop, and a packet may have 256 MB.
    """

    def __init__(self, read: Callable[[int], bytes]) -> None:
        self._read = read
        self._first = b""
        self.left = ANSWER_BYTES

    @property
    def connack(self) -> int | None:
        """Return code of the broker's CONNACK; ``None`` if it has sent none.

        The library does not pass on every code.
        """
        whole = len(self._first) == 4 and self._first.startswith(_CONNACK)
        return self._first[3] if whole else None

    @property
    def heard_another(self) -> bool:
        """Whether the first packet was not a CONNACK."""
        return not _CONNACK.startswith(self._first[:2])

    def read(self, size: int) -> bytes:
        """Read from the connection, or close it if the limit is exceeded."""
        data = self._read(min(size, ANSWER_BYTES))  # as much as is asked for is allocated
        self.left -= len(data)
        self._first += data[: 4 - len(self._first)]
        if self.left < 0:
            raise ConnectionAbortedError
        return data


def client_id(cell: str) -> str:
    """Return a client id that every broker accepts: at most 23 letters and digits (MQTT 3.1.1,
    3.1.3.1).

    Two clients with the same id disconnect each other, so part of the id is random.
    """
    name = "".join(c for c in cell if c.isascii() and c.isalnum())[:12]
    return f"hri{name}{secrets.token_hex(4)}"


def _refusal(code: int | None, in_time: bool, heard: bool) -> str:
    """Describe why there is no connection."""
    if code:
        return f"the broker refuses: {_REFUSALS.get(code, 'an unknown reason')} (CONNACK {code})"
    if heard:
        return "the server is not an MQTT broker; correct 'port' and 'tls'"
    if in_time:
        return "the broker closes the connection without an answer; correct 'port' and 'tls'"
    return "the broker does not answer"


def _paho() -> Any:
    """The client library.

    Raises:
        ConfigError: it is not installed.
    """
    try:
        from paho.mqtt import client
    except ImportError as error:
        raise ConfigError(
            "kind mqtt needs a package that is not installed: paho-mqtt; "
            "install it with: pip install 'hri-predict[mqtt]'"
        ) from error
    return client
