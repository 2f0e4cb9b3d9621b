"""The RTDE port of the simulated controller, protocol version 2.

Written from the tables of Universal Robots' "Real-Time Data Exchange (RTDE) Guide" alone, without
the link's code, so that each checks the other.
"""

import asyncio
import contextlib
import struct
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from hri_sim.rtde.arm import Arm

CYCLE_S = 0.002
SOFTWARE = (5, 16, 0, 0)
REGISTERS = 48
SLOW_BYTES = 4096  # a client that leaves more than this unread is cut off

OUTPUTS: dict[str, tuple[str, str]] = {
    "timestamp": ("DOUBLE", "d"),
    "actual_q": ("VECTOR6D", "6d"),
    "actual_qd": ("VECTOR6D", "6d"),
    "robot_mode": ("INT32", "i"),
    "safety_mode": ("INT32", "i"),
    "runtime_state": ("UINT32", "I"),
    "speed_scaling": ("DOUBLE", "d"),
    "target_speed_fraction": ("DOUBLE", "d"),
}
INPUTS: dict[str, tuple[str, str]] = {
    "speed_slider_mask": ("UINT32", "I"),
    "speed_slider_fraction": ("DOUBLE", "d"),
    **{f"input_int_register_{n}": ("INT32", "i") for n in range(REGISTERS)},
}


@dataclass(kw_only=True)
class Behaviour:
    """Misbehaviour requested by a test.

    Attributes:
        refuse_version: refuse protocol version 2.
        lacks: names of inputs and outputs that it does not know.
        silent_after_s: seconds after a client's start at which data packages stop.
        garbage_after_s: seconds after a client's start at which bytes that are not RTDE are sent.
        piece: send each packet in pieces of this many bytes; 0: whole.
        frozen: keep the time stamp constant.
    """

    refuse_version: bool = False
    lacks: frozenset[str] = frozenset()
    silent_after_s: float = float("inf")
    garbage_after_s: float = float("inf")
    piece: int = 0
    frozen: bool = False


@dataclass(eq=False)
class _Client:
    writer: asyncio.StreamWriter
    inputs: dict[int, tuple[str, ...]] = field(default_factory=dict)  # recipe -> names
    outputs: tuple[str, ...] = ()
    period_s: float = 0.008
    started_s: float | None = None
    due_s: float = 0.0

    @property
    def owned(self) -> set[str]:
        return {name for names in self.inputs.values() for name in names}


class Controller:
    """The controller: an arm, its registers, and its clients.

    Args:
        arm: the arm.
        watched: numbers of the watchdog's and the level's register.
        behaviour: for tests.
        on_input: called with the values of each data package from a client, by name.

    Attributes:
        values: newest value of each input that was written.
    """

    def __init__(
        self,
        arm: Arm,
        watched: tuple[int, int],
        behaviour: Behaviour,
        on_input: Callable[[dict[str, Any]], None] = lambda values: None,
    ) -> None:
        self.values: dict[str, Any] = {}
        self._arm = arm
        self._watchdog, self._level = (f"input_int_register_{n}" for n in watched)
        self._behaviour = behaviour
        self._on_input = on_input
        self._clients: set[_Client] = set()
        self._numbers = 0

    async def serve(self, host: str, port: int, ready: Callable[[int], None]) -> None:
        """Serve until cancelled; call ``ready`` with the port.

        Raises:
            OSError: it cannot listen on the address.
        """
        server = await asyncio.start_server(self._connected, host, port)
        async with server:
            ready(server.sockets[0].getsockname()[1])
            await self._run()

    async def _run(self) -> None:
        before_s = time.monotonic()
        while True:
            await asyncio.sleep(CYCLE_S)
            now_s = time.monotonic()
            self._arm.step(now_s, min(now_s - before_s, 0.1))
            before_s = now_s
            for client in list(self._clients):
                if client.started_s is not None and now_s >= client.due_s:
                    client.due_s = max(client.due_s + client.period_s, now_s)
                    self._send_outputs(client, now_s)

    async def _connected(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        client = _Client(writer)
        self._clients.add(client)
        try:
            while True:
                length, kind = struct.unpack(">HB", await reader.readexactly(3))
                self._take(client, chr(kind), await reader.readexactly(length - 3))
        except (asyncio.IncompleteReadError, ConnectionError, struct.error, ValueError):
            pass  # gone, or not a client
        finally:
            self._clients.discard(client)
            writer.close()

    def _take(self, client: _Client, kind: str, data: bytes) -> None:
        if kind == "V":
            accepted = data == b"\0\2" and not self._behaviour.refuse_version
            self._send(client, kind, bytes((accepted,)))
        elif kind == "v":
            self._send(client, kind, struct.pack(">4I", *SOFTWARE))
        elif kind == "O":
            self._set_outputs(client, data)
        elif kind == "I":
            self._set_inputs(client, data)
        elif kind in "SP":
            client.started_s = client.due_s = time.monotonic()
            if kind == "P":
                client.started_s = None
            self._send(client, kind, b"\1")
        elif kind == "U":
            self._written(client, data)
        else:
            self._say(client, f"unknown packet {kind!r}")

    def _set_outputs(self, client: _Client, data: bytes) -> None:
        (rate_hz,) = struct.unpack_from(">d", data)
        names = data[8:].decode().split(",")
        types = [self._type(OUTPUTS, name) for name in names]
        client.outputs, client.period_s = tuple(names), 1.0 / max(rate_hz, 1.0)
        self._send(client, "O", b"\1" + ",".join(types).encode())

    def _set_inputs(self, client: _Client, data: bytes) -> None:
        names = data.decode().split(",")
        taken = {name for other in self._clients if other is not client for name in other.owned}
        types = ["IN_USE" if name in taken else self._type(INPUTS, name) for name in names]
        number = 0
        if not {"IN_USE", "NOT_FOUND"} & set(types):
            number = self._numbers = self._numbers % 255 + 1
            client.inputs[number] = tuple(names)
        self._send(client, "I", bytes((number,)) + ",".join(types).encode())

    def _type(self, known: dict[str, tuple[str, str]], name: str) -> str:
        there = name in known and name not in self._behaviour.lacks
        return known[name][0] if there else "NOT_FOUND"

    def _written(self, client: _Client, data: bytes) -> None:
        """Accept a data package from a client if it fits its recipe."""
        names = client.inputs.get(data[0]) if data else None
        layout = struct.Struct(">" + "".join(INPUTS[name][1] for name in names or ()))
        if names is None or len(data) != 1 + layout.size:
            self._say(client, "a data package that fits no recipe was ignored")
            return
        values = dict(zip(names, layout.unpack(data[1:]), strict=True))
        self.values |= values
        if values.get("speed_slider_mask", 0) & 1:
            self._arm.move_slider(min(1.0, max(0.0, values["speed_slider_fraction"])))
        watchdog, level = self.values.get(self._watchdog, 0), self.values.get(self._level, 0)
        self._arm.hear(watchdog, level, time.monotonic())
        self._on_input(values)

    def _send_outputs(self, client: _Client, now_s: float) -> None:
        assert client.started_s is not None
        since_s = now_s - client.started_s
        if since_s >= self._behaviour.garbage_after_s:
            client.writer.write(b"GET / HTTP/1.1\r\n\r\n")
            return
        if since_s >= self._behaviour.silent_after_s:
            return
        arm = self._arm
        values: dict[str, tuple[float, ...]] = {
            "timestamp": (1.0 if self._behaviour.frozen else now_s,),
            "actual_q": tuple(arm.positions),
            "actual_qd": tuple(arm.velocities),
            "robot_mode": (7,),
            "safety_mode": (arm.safety_mode,),
            "runtime_state": (arm.runtime_state,),
            "speed_scaling": (arm.slider,),
            "target_speed_fraction": (arm.slider,),
        }
        data = b"".join(struct.pack(">" + OUTPUTS[n][1], *values[n]) for n in client.outputs)
        self._send(client, "U", b"\1" + data)

    def _say(self, client: _Client, text: str) -> None:
        """Send a warning as a text message."""
        message, source = text.encode(), b"hri_sim"
        lengths = bytes((len(message),)), bytes((len(source),))
        self._send(client, "M", lengths[0] + message + lengths[1] + source + b"\2")

    def _send(self, client: _Client, kind: str, data: bytes) -> None:
        packet = struct.pack(">HB", 3 + len(data), ord(kind)) + data
        transport = client.writer.transport
        if transport.get_write_buffer_size() > SLOW_BYTES:
            transport.abort()
            return
        piece = self._behaviour.piece or len(packet)
        with contextlib.suppress(ConnectionError):
            for at in range(0, len(packet), piece):
                client.writer.write(packet[at : at + piece])
