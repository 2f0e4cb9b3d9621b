"""A link that reads a robot's state from an OPC UA server; see ``docs/guides/opcua.md``."""

import asyncio
import contextlib
import threading
from collections.abc import Coroutine, Sequence
from datetime import datetime
from importlib.util import find_spec
from pathlib import Path
from typing import Annotated, Any, ClassVar, Self, TypeVar

from pydantic import Field, model_validator

from hri_drivers.links.configured import WITHOUT_DEVICE
from hri_drivers.links.polled.link import PolledLink
from hri_drivers.links.polled.settings import NO_MODE, READS_ONLY, PolledLinkSettings, StateAt
from hri_drivers.links.polled.transport import PolledTransport
from hri_drivers.wires.quiet import quiet
from hri_predict.base.errors import LinkError
from hri_predict.base.quantities.safe_side import Safety, harmless

CONNECT_S = 15.0
END_S = 0.5
MOST_BYTES = 1 << 20
"""Maximum number of bytes in one message from the server."""
T = TypeVar("T")


class OpcUaClientTransport(PolledTransport):
    """``Transport[Sample]`` of variables.

    asyncua runs in a separate thread, and is imported when the connection opens: settings are
    checked without it.

    Args:
        url: URL of the server.
        places: name and NodeId of each variable.
        files: certificate, key and the server's certificate; empty: no security.
        reply_s: a reply that takes longer means a lost connection.
        rate_hz: rate of the readings.
    """

    open_limit_s = CONNECT_S + 4.0

    def __init__(
        self,
        url: str,
        places: Sequence[tuple[str, str]],
        *,
        files: Sequence[Path],
        reply_s: float,
        rate_hz: float,
    ) -> None:
        super().__init__(f"OPC UA server at {url}", rate_hz)
        self._url, self._places, self._files, self._reply_s = url, places, files, reply_s
        self._loop: asyncio.AbstractEventLoop | None = None
        self._thread: threading.Thread | None = None
        self._client: Any = None
        self._nodes: list[Any] = []

    def _connect(self) -> None:
        quiet("asyncua")  # it logs each error that it raises
        loop = self._loop = asyncio.new_event_loop()
        self._thread = threading.Thread(target=loop.run_forever, name="opcua-client", daemon=True)
        self._thread.start()
        try:
            self._run(self._connected(), CONNECT_S)
            _, wrong = self._read()
        except LinkError:
            raise
        except TimeoutError as error:
            raise LinkError(
                f"no answer within {CONNECT_S:g} s; check that 'port' is its OPC UA port"
            ) from error
        except Exception as error:  # asyncua raises many kinds
            raise LinkError(f"cannot connect: {_why(error)}; {WITHOUT_DEVICE}") from error
        if wrong and (_HOLDS in wrong or "BadNodeId" in wrong):  # another status may pass
            raise LinkError(wrong)

    async def _connected(self) -> None:
        from asyncua import Client, ua
        from asyncua.crypto.security_policies import SecurityPolicyBasic256Sha256

        client = self._client = Client(self._url, timeout=CONNECT_S)
        client.max_messagesize = MOST_BYTES
        self._nodes = [client.get_node(ua.NodeId.from_string(at)) for _, at in self._places]
        if self._files:
            for path in self._files:
                if not path.is_file():
                    raise LinkError(f"{path}: no such file; correct the certificates' keys")
            certificate, key, server = self._files
            client.application_uri = _uri_of(certificate) or client.application_uri
            await client.set_security(
                SecurityPolicyBasic256Sha256,
                certificate,
                key,
                server_certificate=str(server),
            )
        await client.connect()

    def _read(self) -> tuple[tuple[float | None, ...], str]:
        if self._client is None:
            raise LinkError("connection lost")
        try:
            found = self._run(self._client.read_attributes(self._nodes), self._reply_s)
        except TimeoutError as error:
            raise LinkError(
                f"no answer within {self._reply_s:g} s; check that it is on, and correct "
                f"'reply_timeout_s'"
            ) from error
        except LinkError:
            raise
        except Exception as error:  # asyncua raises many kinds
            raise LinkError(f"connection lost: {_why(error)}") from error
        why, values = "", []
        for (name, at), each in zip(self._places, found, strict=False):
            value, wrong = _number(each)
            values.append(value)
            why = why or (wrong and f"{name} ('{at}'): {wrong}")
        return tuple(values), why

    def _run(self, work: Coroutine[Any, Any, T], limit_s: float) -> T:
        """Run a coroutine in the other thread.

        Raises:
            TimeoutError: it took longer.
            Exception: what it raises.
        """
        loop = self._loop
        if loop is None:
            work.close()
            raise LinkError("connection lost")
        running = asyncio.run_coroutine_threadsafe(asyncio.wait_for(work, limit_s), loop)
        return running.result(limit_s + 1.0)

    def _disconnect(self) -> None:
        client, self._client = self._client, None
        loop, thread = self._loop, self._thread
        if loop is None or thread is None:
            return
        if client is not None:
            with contextlib.suppress(Exception):
                self._run(client.disconnect(), END_S)
            # a server that hangs answers no farewell, and asyncua then leaves its socket open
            loop.call_soon_threadsafe(client.disconnect_socket)
        self._loop = self._thread = None
        loop.call_soon_threadsafe(_end, loop)
        thread.join(END_S + 1.0)
        if not thread.is_alive():
            loop.close()


def _end(loop: asyncio.AbstractEventLoop) -> None:
    """Cancel what asyncua left running, then stop."""
    for task in asyncio.all_tasks(loop):
        task.cancel()
    loop.call_soon(loop.stop)


def _number(found: Any) -> tuple[float | None, str]:
    """Return the numeric value of a DataValue, or ``None`` and the reason; a datetime is converted
    to seconds of UTC.
    """
    status = getattr(found, "StatusCode", None)
    if status is None or not status.is_good():
        return None, f"its status is {getattr(status, 'name', 'missing')}; {_REMEDY}"
    value = found.Value.Value if found.Value is not None else None
    if isinstance(value, datetime):
        return value.timestamp(), ""
    if isinstance(value, bool | int | float):
        return float(value), ""
    return None, f"{_HOLDS} {type(value).__name__}, not one number; {_REMEDY}"


_HOLDS = "it holds"
_REMEDY = "correct the node in 'nodes', or the server"


def _uri_of(certificate: Path) -> str:
    """The application URI in a certificate, which servers compare; "" if it has none."""
    from asyncua.crypto import uacrypto
    from cryptography import x509

    try:
        data = certificate.read_bytes()
        is_pem = b"-----BEGIN" in data
        found = x509.load_pem_x509_certificate(data) if is_pem else uacrypto.x509_from_der(data)
        names = found.extensions.get_extension_for_class(x509.SubjectAlternativeName).value
        return str(next(iter(names.get_values_for_type(x509.UniformResourceIdentifier)), ""))
    except (OSError, ValueError, x509.ExtensionNotFound) as error:
        raise LinkError(f"{certificate}: not a certificate for OPC UA: {_why(error)}") from error


def _why(error: Exception) -> str:
    text = (getattr(error, "strerror", None) or str(error) or type(error).__name__).splitlines()[0]
    return f"{text}; switch the server on, or correct 'host', 'port' and the certificates"


UNPROTECTED = (
    "OPC UA carries no CRC or counter for this node: not protected end to end; anyone who can "
    "write the server's variables can forge the robot's position (docs/guides/opcua.md)"
)
OPEN = "no security policy: the server is not authenticated; give the three certificate keys"
NodeAt = Annotated[
    str,
    Field(
        max_length=256,
        pattern=r"^(ns=\d{1,5};)?(i=\d{1,10}|s=[^\x00-\x1f]+|g=[0-9A-Fa-f-]{36}|b=[A-Za-z0-9+/=]+)$",
    ),
]
"""A NodeId as text (OPC UA part 6, 5.3.1.10), such as ``ns=2;s=Robot.Joint1.Position``."""


class NodeState(StateAt[NodeAt]):
    """``nodes:`` of an ``opcua_client`` link; each address is a NodeId as text."""


class OpcUaClientSettings(PolledLinkSettings):
    """An entry of ``links:`` with ``kind: opcua_client``."""

    kind: str = "opcua_client"
    port: int = Field(4840, ge=1, le=65_535, description="its TCP port")
    path: str = Field(
        "",
        pattern=r"^(/[A-Za-z0-9._~/-]{0,200})?$",
        description="path of its address, such as /server",
    )
    nodes: NodeState = Field(description="nodes of the robot's state")
    certificate: Path | None = Field(
        None, description="this client's certificate; Basic256Sha256, signed and encrypted"
    )
    private_key: Path | None = Field(None, description="this client's RSA key, as PEM")
    server_certificate: Path | None = Field(None, description="certificate of the server")

    safety: ClassVar[Safety] = harmless("port")

    @model_validator(mode="after")
    def _whole(self) -> Self:
        given = [self.certificate, self.private_key, self.server_certificate]
        if any(given) and not all(given):
            raise ValueError(
                "certificate, private_key and server_certificate go together; give all or none"
            )
        return self

    def resolved(self, base_dir: Path) -> Self:
        """These settings with file paths resolved from ``base_dir``."""
        keys = ("certificate", "private_key", "server_certificate")
        found = {key: path and base_dir / path for key in keys for path in [getattr(self, key)]}
        return self.model_copy(update=found)

    @property
    def notes(self) -> list[str]:
        """See ``LinkSettings``."""
        known = self.nodes.automatic or self.nodes.mode is not None
        secured = self.certificate is not None
        return [
            READS_ONLY,
            UNPROTECTED,
            *([] if secured else [OPEN]),
            *([] if known else [NO_MODE]),
        ]


class OpcUaClientLink(PolledLink[OpcUaClientSettings]):
    """``contracts.link.Link`` that reads variables; arguments as for ``ConfiguredLink``."""

    settings_model: ClassVar[type[OpcUaClientSettings]] = OpcUaClientSettings
    unprotected: ClassVar[str] = UNPROTECTED

    @staticmethod
    def _demand(settings: OpcUaClientSettings) -> None:
        if find_spec("asyncua") is None:
            raise LinkError(
                f"link '{settings.name}' needs a package that is not installed: asyncua; "
                "install it with: pip install 'hri-predict[opcua]'"
            )

    @staticmethod
    def make_transport(settings: OpcUaClientSettings) -> OpcUaClientTransport:
        """The connection, not yet open."""
        files = (settings.certificate, settings.private_key, settings.server_certificate)
        host = f"[{settings.host}]" if ":" in settings.host else settings.host
        return OpcUaClientTransport(
            f"opc.tcp://{host}:{settings.port}{settings.path}",
            settings.nodes.places,
            files=[path for path in files if path is not None],
            reply_s=settings.reply_timeout_s,
            rate_hz=settings.robot_state_rate_hz,
        )

    @staticmethod
    def _state(settings: OpcUaClientSettings) -> StateAt[Any]:
        return settings.nodes
