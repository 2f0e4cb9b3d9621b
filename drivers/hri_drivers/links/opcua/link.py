"""An OPC UA server as a link: clients read the advice or subscribe to it, and call Acknowledge.

``drivers/OPCUA.md`` defines the variables, ``docs/guides/opcua.md`` describes the PLC's side.
"""

import contextlib
import json
import logging
import select
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import Any, ClassVar, Self

from pydantic import Field, model_validator

from hri_drivers.links.opcua import messages
from hri_drivers.links.plant.image import Block
from hri_drivers.links.plant.link import PlantLink, PlantLinkSettings, try_address
from hri_drivers.wires.transport import TransportBusy
from hri_predict.base.errors import LinkError
from hri_predict.base.quantities.safe_side import Safety

log = logging.getLogger(__name__)

START_S = 90.0
"""Maximum time of the start: asyncua builds the standard's address space, 2 s of processor time."""
HUNG_S = 3.0
"""A server that has reported nothing for this long is started again; it reports every 0.2 s."""
END_S = 2.0


class OpcUaTransport:
    """``Transport[Block]``: sends written blocks to the server, and receives presses.

    Args:
        asked: settings of the server's process, without ``robots``.

    Attributes:
        robots: indices of the robots that have variables.
        port: the open port.
        refused: number of refused write requests and presses.
        advice_timeouts: number of times that an advice that permits motion became *Bad*.
        say: called with one line about a problem that others must correct.
        open_limit_s: maximum time for opening.
    """

    open_limit_s = START_S + 2.0

    def __init__(self, asked: dict[str, Any]) -> None:
        self.robots: Sequence[int] = (0,)
        self.port = int(asked["port"])
        self.say: Callable[[str], None] = lambda line: None
        self._asked = asked
        self._refused = self._refused_before = 0
        self._timeouts = self._timeouts_before = 0
        self._link: socket.socket | None = None
        self._process: subprocess.Popen[bytes] | None = None
        self._heard_s = 0.0

    @property
    def refused(self) -> int:
        """See the class."""
        return self._refused_before + self._refused

    @property
    def advice_timeouts(self) -> int:
        """See the class."""
        return self._timeouts_before + self._timeouts

    def open(self) -> None:
        """Start the server.

        Raises:
            LinkError: it cannot listen; one line with the remedy.
        """
        self.close()
        host, port = self._asked["host"], int(self._asked["port"])
        try_address("OPC UA server", (host, port))
        self._link, far = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        with far:
            settings = json.dumps({**self._asked, "robots": list(self.robots)})
            own = [json.dumps(sys.path), str(far.fileno()), settings]
            try:
                self._process = subprocess.Popen(
                    [sys.executable, "-P", "-c", _BEGIN, *own],
                    pass_fds=[far.fileno()],
                    stdin=subprocess.DEVNULL,
                    stdout=subprocess.DEVNULL,
                )
            except OSError as error:
                self.close()
                raise LinkError(
                    f"OPC UA server: its process cannot be started: {error.strerror}; raise the "
                    "limits of processes and open files (ulimit -u, -n)"
                ) from error
        self._await_ready(f"OPC UA server at {host}:{port}")

    def _await_ready(self, what: str) -> None:
        until_s = time.monotonic() + START_S
        message = b""
        while not message.startswith((messages.READY, messages.FAILED)):
            try:
                message = self._message(until_s - time.monotonic()) or message
            except LinkError as error:
                message = messages.FAILED + str(error).encode()
            if time.monotonic() > until_s and not message:
                message = messages.FAILED + f"it did not start within {START_S:g} s".encode()
        if message.startswith(messages.FAILED):
            self.close()
            raise LinkError(f"{what}: {message[1:].decode()}")
        self.port = messages.number_of(message)
        self._heard_s = time.monotonic()

    def write(self, unit: Block) -> None:
        """Send a block to the server.

        Raises:
            TransportBusy: it has not read the previous blocks.
            LinkError: it has ended, or hangs.
        """
        link = self._opened()
        try:
            link.send(messages.packed_block(unit, time.monotonic_ns()), socket.MSG_DONTWAIT)
        except BlockingIOError as error:
            raise TransportBusy("the OPC UA server does not read") from error
        except OSError as error:
            raise LinkError(f"the OPC UA server ended: {error.strerror}") from error
        if time.monotonic() - self._heard_s > HUNG_S:
            raise LinkError(f"the OPC UA server has hung for {HUNG_S:g} s")

    def read(self, timeout_s: float) -> list[Block]:
        """Return presses.

        Raises:
            LinkError: the server has stopped.
        """
        units: list[Block] = []
        while message := self._message(0.0 if units else timeout_s):
            self._heard_s = time.monotonic()
            kind, rest = message[:1], message[1:]
            if kind == messages.PRESSED:
                units.append(messages.unpacked_block(rest)[0])
            elif kind == messages.COUNTS:
                self._refused = messages.number_of(message)
                self._timeouts = messages.number_of(message, 1)
                break
            elif kind == messages.SAID:
                self.say(rest.decode())
            elif kind == messages.FAILED:
                raise LinkError(f"the OPC UA server ended: {rest.decode()}")
        return units

    def close(self) -> None:
        """Stop the server; never raises, safe to call twice."""
        link, self._link = self._link, None
        process, self._process = self._process, None
        self._refused_before, self._refused = self.refused, 0
        self._timeouts_before, self._timeouts = self.advice_timeouts, 0
        if link is not None:
            with contextlib.suppress(OSError):
                link.shutdown(socket.SHUT_RDWR)
            link.close()
        if process is not None:
            try:
                process.wait(END_S)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()

    def _opened(self) -> socket.socket:
        if self._link is None:
            raise LinkError("the OPC UA server is closed; open it first")
        return self._link

    def _message(self, timeout_s: float) -> bytes | None:
        """Return the server's next message; ``None`` if none arrived in time.

        Raises:
            LinkError: the server has stopped.
        """
        link = self._opened()
        try:
            readable = select.poll()
            readable.register(link, select.POLLIN)
            if not readable.poll(max(0.0, 1e3 * timeout_s)):
                return None
            message = link.recv(messages.MOST, socket.MSG_DONTWAIT)
        except BlockingIOError:
            return None
        except (OSError, ValueError) as error:
            raise LinkError("the OPC UA server's socket is closed") from error
        if not message:
            raise LinkError("the OPC UA server's process ended")
        return message


_BEGIN = (
    "import json, sys; sys.path[:] = json.loads(sys.argv[1]); "
    "from hri_drivers.links.opcua.server import main; main(int(sys.argv[2]), sys.argv[3])"
)
"""The server's process uses the node's import paths."""


UNPROTECTED = (
    "OPC UA carries no CRC or counter from this node: not protected end to end; a client must stop "
    "when a status is not Good, and when HEARTBEAT or ADVICE_COUNTER stops changing "
    "(drivers/OPCUA.md)"
)
OPEN = "no security policy: anyone who can reach the port can read values and call the methods"


class OpcUaLinkSettings(PlantLinkSettings):
    """An entry of ``links:`` with ``kind: opcua``."""

    kind: str = "opcua"
    port: int = Field(4840, ge=0, le=65_535, description="TCP port")
    robot_state_rate_hz: float = Field(
        0.0, ge=0, le=0, description="0: OPC UA carries no RobotState"
    )
    certificate: Path | None = Field(
        None, description="the server's certificate; only Basic256Sha256, signed and encrypted"
    )
    private_key: Path | None = Field(None, description="the server's RSA key, as PEM")
    trusted: list[Path] = Field([], max_length=64, description="certificates of the clients")

    protocol: ClassVar[str] = "OPC UA without certificates"
    safety: ClassVar[Safety] = {}

    @property
    def knows_clients(self) -> bool:
        """Whether clients must authenticate themselves."""
        return self.certificate is not None

    @model_validator(mode="after")
    def _whole(self) -> Self:
        given = [self.certificate is not None, self.private_key is not None, bool(self.trusted)]
        if any(given) and not all(given):
            raise ValueError("certificate, private_key and trusted go together; give all or none")
        return self

    def resolved(self, base_dir: Path) -> Self:
        """These settings with file paths resolved from ``base_dir``."""
        found = {
            key: value and base_dir / value
            for key, value in (("certificate", self.certificate), ("private_key", self.private_key))
        }
        trusted = [base_dir / path for path in self.trusted]
        return self.model_copy(update={**found, "trusted": trusted})

    @property
    def notes(self) -> list[str]:
        """See ``LinkSettings``."""
        return [UNPROTECTED] if self.knows_clients else [UNPROTECTED, OPEN]


class OpcUaLink(PlantLink[OpcUaLinkSettings]):
    """``contracts.link.Link`` whose other end reads; arguments as for ``ConfiguredLink``."""

    settings_model: ClassVar[type[OpcUaLinkSettings]] = OpcUaLinkSettings
    unprotected: ClassVar[str] = UNPROTECTED
    reads_hz: ClassVar[float] = 50.0
    word_bytes: ClassVar[int] = 40  # a notification has handle, value, status and both timestamps

    @staticmethod
    def _demand(settings: OpcUaLinkSettings) -> None:
        if find_spec("asyncua") is None:
            raise LinkError(
                f"link '{settings.name}' needs a package that is not installed: asyncua; "
                "install it with: pip install 'hri-predict[opcua]'"
            )

    @staticmethod
    def make_transport(settings: OpcUaLinkSettings) -> OpcUaTransport:
        """The server, not yet open."""
        return OpcUaTransport(
            {
                "name": settings.name,
                "host": settings.host,
                "port": settings.port,
                "silence_s": settings.silence_timeout_s,
                "max_age_s": settings.age_limit_s,
                "certificate": str(settings.certificate or ""),
                "private_key": str(settings.private_key or ""),
                "trusted": [str(path) for path in settings.trusted],
            }
        )

    def _prepare(self, settings: OpcUaLinkSettings, robots: Sequence[int]) -> None:
        super()._prepare(settings, robots)
        device = getattr(self._transport, "device", self._transport)  # beneath injected faults
        if isinstance(device, OpcUaTransport):
            device.robots = tuple(robots)
            device.say = self._say
