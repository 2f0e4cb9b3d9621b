"""A connection to the controller's RTDE port: the setup, then data packages both ways."""

import contextlib
import logging
import select
import socket
import struct
import time

from hri_drivers.links.configured import WITHOUT_DEVICE
from hri_drivers.links.rtde.packets import (
    VERSION,
    Kind,
    Packet,
    Recipe,
    Splitter,
    asks_inputs,
    asks_outputs,
    framed,
    number_of,
    recipe_number,
    text_of,
    versions_of,
)
from hri_drivers.wires.tcp import limit_delay
from hri_predict.base.errors import LinkError

log = logging.getLogger(__name__)

REPLY_S = 2.0
"""Maximum time for a controller's answer to each step of the setup."""
SILENT_S = 0.5
"""Without a data package for this long the connection counts as lost."""
WRITE_S = 0.1
"""A write that takes longer was cut within a packet: the connection counts as lost."""
CHUNK = 65_536


class RtdeTransport:
    """``Transport[Packet]``: one connection, set up at each opening.

    Args:
        address: host and port of the controller.
        outputs, inputs: the recipes.
        rate_hz: rate at which the controller sends its outputs.

    Attributes:
        malformed: number of packets that no controller sends, or that break the stream.
        controller: version of the controller's software; empty before the first connection.
    """

    def __init__(
        self, address: tuple[str, int], outputs: Recipe, inputs: Recipe, rate_hz: float
    ) -> None:
        self.malformed = 0
        self.controller = ""
        self.open_limit_s = 6 * REPLY_S
        self._address = address
        self._outputs, self._inputs = outputs, inputs
        self._rate_hz = rate_hz
        self._socket: socket.socket | None = None
        self._splitter = Splitter()
        self._waiting: list[tuple[int, bytes]] = []  # packets that came with a reply
        self._output_number = self._input_number = 0
        self._heard_s = 0.0

    @property
    def _named(self) -> str:
        return f"RTDE at {self._address[0]}:{self._address[1]}"

    def open(self) -> None:
        """Connect and set up both recipes.

        Raises:
            LinkError: one line that names the address, what failed and the remedy.
        """
        self.close()
        try:
            self._socket = socket.create_connection(self._address, timeout=REPLY_S)
            limit_delay(self._socket)
            self._set_up()
            self._socket.settimeout(WRITE_S)
        except LinkError as error:
            self.close()
            raise LinkError(f"{self._named}: {error}") from error
        except (OSError, UnicodeError) as error:  # the latter: no host can have this name
            self.close()
            why = getattr(error, "strerror", "not a host's name") or "no answer"
            raise LinkError(
                f"{self._named}: cannot connect: {why}; switch the controller on, or correct "
                f"'host' and 'port'; {WITHOUT_DEVICE}"
            ) from error
        self._heard_s = time.monotonic()

    def write(self, unit: Packet) -> None:
        """Send one packet; a data package gets the number of the input recipe.

        Raises:
            LinkError: the connection is lost.
        """
        data = unit.data
        if unit.kind == Kind.DATA:
            data = bytes((self._input_number,)) + data
        try:
            self._opened().sendall(framed(unit.kind, data))
        except OSError as error:
            self.close()  # the packet may be cut: more bytes would be taken for the rest of it
            raise LinkError(f"{self._named}: connection lost ({_why(error)})") from error

    def read(self, timeout_s: float) -> list[Packet]:
        """Return the packets that have arrived; data packages without their recipe's number.

        Raises:
            LinkError: the connection is lost, silent, or out of step.
        """
        found, self._waiting = self._waiting, []
        try:
            found += self._received(0.0 if found else timeout_s)
        except OSError as error:
            raise LinkError(f"{self._named}: connection lost ({_why(error)})") from error
        except LinkError as error:
            raise LinkError(f"{self._named}: {error}") from error
        units = [unit for kind, data in found if (unit := self._unit(kind, data)) is not None]
        now_s = time.monotonic()
        if any(unit.kind == Kind.DATA for unit in units):
            self._heard_s = now_s
        elif now_s - self._heard_s > SILENT_S:
            raise LinkError(f"{self._named}: no data for {SILENT_S:g} s; connecting again")
        return units

    def close(self) -> None:
        """Close; never raises, safe to call twice."""
        opened, self._socket = self._socket, None
        if opened is not None:
            with contextlib.suppress(OSError):
                opened.shutdown(socket.SHUT_RDWR)  # wakes the reader
            opened.close()
        self._splitter = Splitter()
        self._waiting = []

    def _unit(self, kind: int, data: bytes) -> Packet | None:
        if kind != Kind.DATA:
            return Packet(kind, data)
        if number_of(data) != self._output_number or not data:
            self.malformed += 1
            return None
        return Packet(kind, data[1:])

    def _opened(self) -> socket.socket:
        if self._socket is None:
            raise LinkError(f"{self._named} is closed; open it first")
        return self._socket

    def _received(self, timeout_s: float) -> list[tuple[int, bytes]]:
        """Wait for bytes; return the packets that they complete."""
        opened = self._opened()
        try:
            ready, _, _ = select.select([opened], [], [], timeout_s)
        except ValueError as error:  # closed by the other thread
            raise LinkError("closed") from error
        if not ready:
            return []
        data = opened.recv(CHUNK)
        if not data:
            raise LinkError(
                "the controller closed the connection; is another program controlling it?"
            )
        try:
            return list(self._splitter.feed(data))
        except LinkError:
            self.malformed += 1
            raise

    def _set_up(self) -> None:
        """Agree on the version, ask for both recipes, and start."""
        if number_of(self._asked(Kind.VERSION, struct.pack(">H", VERSION))) != 1:
            raise LinkError(
                f"the controller refuses RTDE protocol version {VERSION}; update its software"
            )
        self.controller = ".".join(map(str, versions_of(self._asked(Kind.CONTROLLER))))
        outputs = self._asked(Kind.OUTPUTS, asks_outputs(self._outputs, self._rate_hz))
        self._output_number = recipe_number(self._outputs, outputs, "output")
        inputs = self._asked(Kind.INPUTS, asks_inputs(self._inputs))
        self._input_number = recipe_number(self._inputs, inputs, "input")
        if number_of(self._asked(Kind.START)) != 1:
            raise LinkError("the controller does not start sending; restart its RTDE interface")
        log.info("%s: controller software %s", self._named, self.controller or "unknown")

    def _asked(self, kind: Kind, data: bytes = b"") -> bytes:
        """Send a request, and return the data of its reply."""
        self._opened().sendall(framed(kind, data))
        until_s = time.monotonic() + REPLY_S
        said = ""
        while (left_s := until_s - time.monotonic()) > 0:
            found = self._received(left_s)
            for i, (came, reply) in enumerate(found):
                if came == kind:
                    self._waiting += found[i + 1 :]
                    return reply
                if came == Kind.TEXT:
                    said = text_of(reply)
        why = f" ({said})" if said else ""
        raise LinkError(
            f"no answer to request '{chr(kind)}' within {REPLY_S:g} s{why}; check that 'port' is "
            "the controller's RTDE port, 30004"
        )


def _why(error: OSError) -> str:
    return error.strerror or type(error).__name__
