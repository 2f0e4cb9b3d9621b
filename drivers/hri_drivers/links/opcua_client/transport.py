"""The connection to an OPC UA server, through asyncua in a separate thread.

asyncua is imported when the connection opens: settings are checked without it.
"""

import asyncio
import contextlib
import threading
from collections.abc import Coroutine, Sequence
from datetime import datetime
from pathlib import Path
from typing import Any, TypeVar

from hri_drivers.links.polled.transport import PolledTransport
from hri_drivers.wires.quiet import quiet
from hri_predict.base.errors import LinkError

CONNECT_S = 15.0
END_S = 0.5
MOST_BYTES = 1 << 20
"""Maximum number of bytes in one message from the server."""
T = TypeVar("T")


class OpcUaClientTransport(PolledTransport):
    """``Transport[Sample]`` of variables.

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
            raise LinkError(f"cannot connect: {_why(error)}") from error
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
