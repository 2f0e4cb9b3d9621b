"""``bench plants``: delay of an advice to a robot (RTDE) or a PLC (Modbus, OPC UA).

Each link posts an Advice about every 40 ms, in real time. The other end is a separate process: the
simulated RTDE controller, a Modbus client that polls every 10 ms, and an OPC UA client that
subscribes. All processes read the same clock.
"""

import contextlib
import json
import logging
import random
import subprocess
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from importlib.util import find_spec
from multiprocessing.connection import Connection
from typing import Any

import yaml

from hri_drivers.links.rtde.link import RtdeLink, RtdeLinkSettings
from hri_predict.base.clock import MonotonicClock
from hri_predict.base.errors import LinkError
from hri_predict.base.files import data_path
from hri_predict.base.machine.orphans import command_of
from hri_predict.base.settings import validated
from hri_predict.cli.common import JsonOption, need_extra
from hri_predict.contracts import registry
from hri_predict.contracts.link import Link
from hri_predict.protocol.registers import (
    NODE,
    ROBOT,
    Register,
    offset_of,
    robot_address,
    words_of,
)
from hri_predict.protocol.variables import INDEX, robot_variables
from hri_sim.bench.rows import Row, Scope, rows_of, spread
from hri_sim.bench.table import SecondsOption, measure, report
from hri_sim.robot_server.process import ServerProcess
from hri_sim.robot_server.robot import COUNTS
from hri_sim.wires.child import child
from hri_sim.wires.ports import free_tcp_port
from hri_sim.wires.samples import ADVICE, STATUS

_COLUMNS = {
    "link": "{link}",
    "received": "{heard} of {sent}",
    "superseded": "{superseded}",
    "p50 ms": "{latency_ms[p50]:.2f}",
    "p99 ms": "{latency_ms[p99]:.2f}",
    "max ms": "{latency_ms[max]:.2f}",
}


def plants(
    seconds: SecondsOption = 20.0,
    as_json: JsonOption = False,
) -> None:
    """Measure RTDE, Modbus and OPC UA: time from posting an advice until another process has it.

    Then, for Modbus and OPC UA, the time from a controller's write of its state until the node has
    read it. The other end of RTDE is `python -m hri_sim.rtde`; that of Modbus polls every 10 ms,
    that of OPC UA subscribes. This runs in real time, so other programs disturb it.

    Example: hri-predict bench plants --seconds 5
    """
    need_extra("pymodbus", "modbus")
    rows = measure(costs(seconds), 5, "registers")
    title = "From posting an advice to the registers of another process"
    report(rows, as_json, title, _COLUMNS)


def rows(scope: Scope) -> Iterator[Row]:
    """Yield the latency of each link, in ms."""
    need_extra("pymodbus", "modbus")
    return rows_of(costs(scope.seconds), "link")


PERIOD_S, SPREAD_S = 0.035, 0.01  # every phase between posting and polling occurs
POLL_S = 0.01
MAX_AGE_S = 0.4  # no cell states the delays; every advice here is fresh
SETTLE_S, DRAIN_S = 1.0, 0.5


def costs(seconds: float) -> Iterator[dict[str, Any]]:
    """Yield a row of each link.

    ``latency_ms``: time from ``post`` until the other end has the Advice: p50, p99 and max;
    ``sent``, ``heard``: numbers of Advice; ``superseded``: number that a newer one replaced in the
    link. For the clients, the time from the controller's write of a state until the link has it;
    ``sent``: readings, ``heard``: those with a new state.
    """
    yield {"link": "rtde, 125 Hz", **_rtde(seconds)}
    yield {"link": "modbus, polled every 10 ms", **_modbus(seconds)}
    if find_spec("asyncua") is not None:
        yield {"link": "opcua, published every 10 ms", **_opcua(seconds)}
    yield {"link": "modbus_client, 50 Hz", **_states("modbus", seconds)}
    if find_spec("asyncua") is not None:
        yield {"link": "opcua_client, 50 Hz", **_states("opcua", seconds)}


def _states(protocol: str, seconds: float) -> dict[str, Any]:
    """Read the simulated robot's server; its heartbeat is the time of writing in ms."""
    config = yaml.safe_load(data_path(f"robot_{protocol}.yaml").read_text())["links"][0]
    server = ServerProcess(protocol)
    spans_ms: list[float] = []
    readings, before = 0, None
    try:
        config["port"] = server.port
        kind = registry.load("links", config["kind"])
        wire: Any = kind.make_transport(validated(kind.settings_model, config, "the link"))
        wire.open()
        end_s = time.monotonic() + SETTLE_S + seconds
        while (now_s := time.monotonic()) < end_s:
            for sample in wire.read(0.1):
                if now_s < end_s - seconds:
                    continue
                readings += 1
                if sample.values[0] != before:
                    before = sample.values[0]
                    spans_ms.append((time.monotonic_ns() * 1e-6 - before) % COUNTS)
        wire.close()
    finally:
        server.kill()
    return _line(readings, spans_ms, 0)


class RtdeController:
    """The simulated robot controller in a separate process.

    Attributes:
        port: port to connect to.
        heard: (ns, watchdog count) of each received advice.
    """

    def __init__(self) -> None:
        command = command_of("hri_sim.rtde", "--port", "0", "--each")
        self._process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
        assert self._process.stdout is not None
        self._lines = self._process.stdout
        self.port: int = json.loads(self._lines.readline())["port"]
        self.heard: list[tuple[int, int]] = []
        threading.Thread(target=self._listen, daemon=True).start()

    def _listen(self) -> None:
        for line in self._lines:
            found = json.loads(line)
            self.heard.append((found["at_ns"], found["watchdog"]))

    def close(self) -> None:
        """End it."""
        self._process.kill()
        self._process.wait()


def _rtde(seconds: float) -> dict[str, Any]:
    with contextlib.closing(RtdeController()) as robot:
        port = robot.port
        settings = RtdeLinkSettings(
            name="bench", host="127.0.0.1", port=port, full_speed_m_s=1.0, max_age_s=MAX_AGE_S
        )
        link = RtdeLink(settings, MonotonicClock())
        # the last of a dictionary's equal keys stays, and the first time counts
        return _measured(link, seconds, lambda: {n: at for at, n in reversed(robot.heard)})


def _modbus(seconds: float) -> dict[str, Any]:
    from hri_drivers.links.modbus.link import ModbusLink, ModbusLinkSettings  # needs pymodbus

    settings = ModbusLinkSettings(name="bench", port=free_tcp_port(), max_age_s=MAX_AGE_S)
    return _served(ModbusLink(settings, MonotonicClock()), settings.port, _poll, seconds)


def _opcua(seconds: float) -> dict[str, Any]:
    from hri_drivers.links.opcua.link import OpcUaLink, OpcUaLinkSettings  # needs asyncua

    settings = OpcUaLinkSettings(name="bench", port=free_tcp_port(), max_age_s=MAX_AGE_S)
    return _served(OpcUaLink(settings, MonotonicClock()), settings.port, _subscribe, seconds)


def _served(
    link: Link, port: int, client: Callable[[Connection, int], dict[int, int]], seconds: float
) -> dict[str, Any]:
    """Measure a link that is a server; ``client`` runs in a separate process."""
    with contextlib.ExitStack() as stack:
        link.start()
        stack.callback(link.stop)
        plc = stack.enter_context(child(client, port))
        plc.receive()
        return _measured(link, seconds, plc.report)


def _poll(pipe: Connection, port: int) -> dict[int, int]:
    """Poll a robot's registers; return the time at which each latch id was first read."""
    return {latch_id: at_ns for at_ns, latch_id in poll(pipe, port, (ROBOT, "LATCH_ID"))}


def poll(
    pipe: Connection, port: int, *fields: tuple[tuple[Register, ...], str]
) -> list[tuple[int, ...]]:
    """Poll registers every ``POLL_S``, as a PLC does; for ``child``.

    Args:
        pipe: receives a message when polling starts; a message in it stops polling.
        port: port of the link.
        fields: block (the node's, or its first robot's) and name of each register.

    Returns:
        Time (ns) at which each value of the first register was first read, and all values.
    """
    from pymodbus.client import ModbusTcpClient

    places = [
        (0 if block == NODE else robot_address(0), words_of(block), offset_of(block, name))
        for block, name in fields
    ]
    heard: dict[int, tuple[int, ...]] = {}
    with ModbusTcpClient("127.0.0.1", port=port) as client:
        pipe.send("ready")
        due_s = time.monotonic()
        while not pipe.poll():
            values = [
                client.read_input_registers(address, count=count).registers[at]
                for address, count, at in places
            ]
            heard.setdefault(values[0], (time.monotonic_ns(), *values))
            due_s = max(due_s + POLL_S, time.monotonic())
            time.sleep(max(0.0, due_s - time.monotonic()))
    return list(heard.values())


def _subscribe(pipe: Connection, port: int) -> dict[int, int]:
    """Subscribe to a robot's variables; return the time at which each latch id first arrived."""
    import asyncio

    from asyncua import Client, ua

    logging.getLogger("asyncua").setLevel(logging.ERROR)  # it names each value that a server lowers
    heard: dict[int, int] = {}

    class Handler:
        def datachange_notification(self, node: Any, value: Any, data: Any) -> None:
            if node.nodeid.Identifier == "Robots.0.LATCH_ID" and value is not None:
                heard.setdefault(value, time.monotonic_ns())

    async def run() -> None:
        async with Client(f"opc.tcp://127.0.0.1:{port}/") as client:
            nodes = [client.get_node(ua.NodeId(v.node_id, INDEX)) for v in robot_variables(0)]
            taken = await client.create_subscription(1e3 * POLL_S, Handler())
            await taken.subscribe_data_change(nodes)
            pipe.send("ready")
            while not pipe.poll():
                await asyncio.sleep(POLL_S)

    asyncio.run(run())
    return heard


def _measured(link: Link, seconds: float, report: Callable[[], dict[int, int]]) -> dict[str, Any]:
    """Post for a while; ``report`` returns when the other end had each Advice, by number."""
    link.start()  # does nothing if it is started
    try:
        time.sleep(SETTLE_S)
        posted, pause = {}, random.Random(0)
        for number in range(1, 2 + round(seconds / (PERIOD_S + SPREAD_S / 2))):
            link.post(STATUS)
            posted[number] = time.monotonic_ns()
            # RTDE counts them, Modbus shows the latch id
            link.post(replace(ADVICE, latch_id=number % 65_536, age_s=0.05))
            time.sleep(PERIOD_S + SPREAD_S * pause.random())
        time.sleep(DRAIN_S)
        heard = report()
    finally:
        link.stop()
    spans_ms = [1e-6 * (heard[n] - at) for n, at in posted.items() if n in heard]
    if not spans_ms:
        raise LinkError("the other end received nothing; run again on a less busy machine")
    return _line(len(posted), spans_ms, link.counters.superseded)


def _line(sent: int, spans_ms: list[float], superseded: int) -> dict[str, Any]:
    latency_ms = spread(spans_ms, 2)
    figures = {"heard": len(spans_ms), "superseded": superseded, "latency_ms": latency_ms}
    return {"sent": sent, **figures}
