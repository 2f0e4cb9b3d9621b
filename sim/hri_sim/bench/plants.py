"""``bench plants``: from an advice to a robot (RTDE) or a PLC (Modbus, OPC UA).

Each link posts an Advice every 40 ms or so, in real time. The other end is a process of its own:
the made-up RTDE controller, a Modbus client that polls every 10 ms, and an OPC UA client that
subscribes. All read the same clock.
"""

import contextlib
import json
import logging
import random
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from importlib.util import find_spec
from multiprocessing.connection import Connection
from typing import Any

import yaml

from hri_drivers.links.rtde.link import RtdeLink, RtdeLinkSettings
from hri_predict.base.clock import MonotonicClock
from hri_predict.base.errors import LinkError
from hri_predict.base.files import data_path
from hri_predict.base.settings import validated
from hri_predict.cli.common import JsonOption, need_extra
from hri_predict.contracts import registry
from hri_predict.contracts.link import Link
from hri_predict.protocol.messages import Advice, Level, Status
from hri_predict.protocol.reasons import Reason
from hri_predict.protocol.registers import ROBOT, offset_of, robot_address, words_of
from hri_predict.protocol.variables import INDEX, robot_variables
from hri_sim.bench.rows import spread
from hri_sim.bench.table import SecondsOption, measure, report
from hri_sim.robot_server.process import ServerProcess
from hri_sim.robot_server.robot import COUNTS
from hri_sim.wires.child import child
from hri_sim.wires.ports import free_tcp_port
from hri_sim.wires.samples import STATUS

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

    Then the time from a controller's write of its state until the node has read it, by Modbus and
    OPC UA. The other end of RTDE is `python -m hri_sim.rtde`; that of Modbus polls every 10 ms,
    that of OPC UA subscribes. This runs in real time, so other programs disturb it.

    Example: hri-predict bench plants --seconds 5
    """
    need_extra("pymodbus", "modbus")
    rows = measure(costs(seconds), 5, "registers")
    title = "From posting an advice to the registers of another process"
    report(rows, as_json, title, _COLUMNS)


PERIOD_S, SPREAD_S = 0.035, 0.01  # every phase between posting and polling occurs
POLL_S = 0.01
SETTLE_S, DRAIN_S = 1.0, 0.5
_LATCH_AT = offset_of(ROBOT, "LATCH_ID")


def costs(seconds: float) -> Iterator[dict[str, Any]]:
    """Yield a row of each link.

    ``latency_ms``: from ``post`` until the other end has the Advice, p50, p99 and max; ``sent``,
    ``heard``: numbers of Advice; ``superseded``: those that a newer one replaced in the link. Of
    the clients: from the controller's write of a state until the link has it; ``sent``: readings,
    ``heard``: those with a new state.
    """
    yield {"link": "rtde, 125 Hz", **_rtde(seconds)}
    yield {"link": "modbus, polled every 10 ms", **_modbus(seconds)}
    if find_spec("asyncua") is not None:
        yield {"link": "opcua, published every 10 ms", **_opcua(seconds)}
    yield {"link": "modbus_client, 50 Hz", **_states("modbus", seconds)}
    if find_spec("asyncua") is not None:
        yield {"link": "opcua_client, 50 Hz", **_states("opcua", seconds)}


def _states(protocol: str, seconds: float) -> dict[str, Any]:
    """Read the made-up robot's server, whose heartbeat is the time of its write in ms."""
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
    return {
        "sent": readings,
        "heard": len(spans_ms),
        "superseded": 0,
        "latency_ms": spread(spans_ms, 2),
    }


def _rtde(seconds: float) -> dict[str, Any]:
    command = [sys.executable, "-m", "hri_sim.rtde", "--port", "0", "--each"]
    controller = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    heard: dict[int, int] = {}

    def listen() -> None:
        assert controller.stdout is not None
        for line in controller.stdout:
            found = json.loads(line)
            heard.setdefault(found["watchdog"], found["at_ns"])

    try:
        assert controller.stdout is not None
        port = json.loads(controller.stdout.readline())["port"]
        threading.Thread(target=listen, daemon=True).start()
        settings = RtdeLinkSettings(name="bench", host="127.0.0.1", port=port, full_speed_m_s=1.0)
        link = RtdeLink(settings, MonotonicClock())
        return _measured(link, seconds, lambda: dict(heard))
    finally:
        controller.kill()
        controller.wait()


def _modbus(seconds: float) -> dict[str, Any]:
    from hri_drivers.links.modbus.link import ModbusLink, ModbusLinkSettings  # needs pymodbus

    settings = ModbusLinkSettings(name="bench", port=free_tcp_port())
    return _served(ModbusLink(settings, MonotonicClock()), settings.port, _poll, seconds)


def _opcua(seconds: float) -> dict[str, Any]:
    from hri_drivers.links.opcua.link import OpcUaLink, OpcUaLinkSettings  # needs asyncua

    settings = OpcUaLinkSettings(name="bench", port=free_tcp_port())
    return _served(OpcUaLink(settings, MonotonicClock()), settings.port, _subscribe, seconds)


def _served(
    link: Link, port: int, client: Callable[[Connection, int], dict[int, int]], seconds: float
) -> dict[str, Any]:
    """Measure a link that is a server, whose ``client`` runs in a process of its own."""
    with contextlib.ExitStack() as stack:
        link.start()
        stack.callback(link.stop)
        plc = stack.enter_context(child(client, port))
        plc.receive()
        return _measured(link, seconds, plc.report)


def _poll(pipe: Connection, port: int) -> dict[int, int]:
    """Poll a robot's registers; return when each latch id was read first."""
    from pymodbus.client import ModbusTcpClient

    heard: dict[int, int] = {}
    with ModbusTcpClient("127.0.0.1", port=port) as client:
        pipe.send("ready")
        due_s = time.monotonic()
        while not pipe.poll():
            words = client.read_input_registers(robot_address(0), count=words_of(ROBOT)).registers
            heard.setdefault(words[_LATCH_AT], time.monotonic_ns())
            due_s = max(due_s + POLL_S, time.monotonic())
            time.sleep(max(0.0, due_s - time.monotonic()))
    return heard


def _subscribe(pipe: Connection, port: int) -> dict[int, int]:
    """Subscribe to a robot's variables; return when each latch id came first."""
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
    """Post for a while; ``report`` says when the other end had each Advice, by its number."""
    link.start()  # does nothing if it is started
    try:
        time.sleep(SETTLE_S)
        posted, pause = {}, random.Random(0)
        for number in range(1, 2 + round(seconds / (PERIOD_S + SPREAD_S / 2))):
            status: Status = STATUS
            link.post(status)
            posted[number] = time.monotonic_ns()
            link.post(_advice(number))
            time.sleep(PERIOD_S + SPREAD_S * pause.random())
        time.sleep(DRAIN_S)
        heard = report()
    finally:
        link.stop()
    spans_ms = [1e-6 * (heard[n] - at) for n, at in posted.items() if n in heard]
    if not spans_ms:
        raise LinkError("the other end heard nothing; run again on a machine with less to do")
    return {
        "sent": len(posted),
        "heard": len(spans_ms),
        "superseded": link.counters.superseded,
        "latency_ms": spread(spans_ms, 2),
    }


def _advice(number: int) -> Advice:
    """An Advice with a number: RTDE counts them, Modbus shows the latch id."""
    return Advice(
        robot=0,
        level=Level.CLEAR,
        reason=Reason.NONE,
        speed_limit_m_s=1.0,
        age_s=0.05,
        latch_id=number % 65_536,
    )
