"""``bench ports``: one node with ROS 2, a robot by RTDE, a PLC by Modbus and a CAN bus at once.

Each far end is a separate process: a ROS 2 node that publishes people, the simulated RTDE
controller, a Modbus client that polls, a CAN receiver, and a bare loop that shows the machine's own
jitter. Then the same cell runs with only the CAN bus and with people simulated within the node.
"""

import contextlib
import itertools
import time
from collections.abc import Iterator, Sequence
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Annotated, Any

import typer

from hri_predict.base.settings import validated
from hri_predict.cli.common import JsonOption, need_extra
from hri_predict.protocol.registers import NODE, NOT_AVAILABLE, ROBOT
from hri_sim.bench import cell
from hri_sim.bench.heard import deviations, heard
from hri_sim.bench.plants import RtdeController, poll
from hri_sim.bench.rows import Row, Scope, rows_of, spread
from hri_sim.bench.table import demand, measure, report
from hri_sim.people.procedural import ProceduralSettings, ProceduralSource
from hri_sim.wires.child import child
from hri_sim.wires.ports import free_tcp_port

WIRE = "CAN FD udp_multicast"
RATE_HZ, RTDE_HZ = 25.0, 125.0
PEOPLE_HZ = 30.0
POSE = {"xyz": [0.0, 0.0, 0.0], "quaternion_xyzw": [0.0, 0.0, 0.0, 1.0]}
_COLUMNS = {
    "receiver": "{receiver}",
    "heard": "{heard}",
    "lost": "{lost}",
    "interval less period, p50 ms": "{deviation_ms[p50]}",
    "p99": "{deviation_ms[p99]}",
    "max": "{deviation_ms[max]}",
    "age of its capture, p50 ms": "{age_ms[p50]}",
    "p99 ": "{age_ms[p99]}",
    "max ": "{age_ms[max]}",
}
_DASHES = dict.fromkeys(("p50", "p99", "max"), "–")


def ports(
    minutes: Annotated[float, typer.Option(help="Minutes to run each of the two cells.")] = 10.0,
    predictor: Annotated[str, typer.Option(help="Predictor of both cells.")] = "sinn",
    as_json: JsonOption = False,
) -> None:
    """Run one node with ROS 2, RTDE, Modbus and CAN at the same time, then with CAN alone.

    Each far end is a separate process on this machine. This runs in real time, so other programs
    disturb it.

    Example: hri-predict bench ports --minutes 0.5
    """
    seconds = 60.0 * demand("--minutes", minutes, 0.05, 1440.0)
    rows = measure(costs(seconds, predictor), 7, "ports")
    if not as_json:
        rows = [{key: _DASHES if v is None else v for key, v in row.items()} for row in rows]
    report(rows, as_json, "Messages of one node at each receiver", _COLUMNS)


def costs(seconds: float, predictor: str) -> Iterator[dict[str, Any]]:
    """Yield a row of each receiver: all ports at once, then CAN alone.

    ``heard``: number of Advice, or of states of the registers; ``lost``: number of skipped cycles,
    heartbeats or watchdog counts; ``deviation_ms``: deviation of the intervals from the period;
    ``age_ms``: age stated in the advice; both ``None`` if a port has none.
    """
    need_extra("pymodbus", "modbus")
    need_extra("rclpy", "ros2")
    modbus = free_tcp_port()
    with contextlib.closing(RtdeController()) as robot, _people() as source:

        def all_ports(settings: dict[str, Any]) -> None:
            settings["source"] = source
            settings["robots"][0]["motion"] = {"kind": "state", "stale_s": 0.1, "delay_s": 0.01}
            settings["links"] += [
                {
                    "name": "ur", "kind": "rtde", "host": "127.0.0.1", "port": robot.port,
                    "delay_s": 0.01, "silence_timeout_s": 0.06, "reaction_s": 0.05,
                },
                {
                    "name": "plant", "kind": "modbus", "port": modbus, "delay_s": 0.03,
                    "repeat_hz": 0,
                },
            ]  # fmt: skip

        wanted = ((NODE, "HEARTBEAT"), (ROBOT, "AGE"))
        found = _run(seconds, predictor, change=all_ports, partner=(poll, modbus, *wanted))
        begin_ns, end_ns = found["window_ns"]
        summary = found["summary"]  # the node's own counts, from its start to its end
        counted = summary["source"]["live"]
        more = {key: summary[key] for key in ("late_ticks", "seconds_at", "unknown_because")}
        yield _line("node: ROS 2, 30 Hz", counted["scenes"], counted["lost"], **more)
        can, bare = _cell("all ports", found)
        yield can
        yield _polled([row for row in found["partner"] if begin_ns <= row[0] <= end_ns])
        at_ns, counts = zip(*(r for r in robot.heard if begin_ns <= r[0] <= end_ns), strict=True)
        yield _numbered("RTDE, 125 Hz", at_ns, counts, RTDE_HZ)
        yield bare
    yield from _cell("alone", _run(seconds, predictor))


def _run(seconds: float, predictor: str, **others: Any) -> dict[str, Any]:
    return heard(
        wire=WIRE,
        predictor=predictor,
        rate_hz=RATE_HZ,
        seconds=seconds,
        captures_hz=PEOPLE_HZ,
        **others,
    )


def rows(scope: Scope) -> Iterator[Row]:
    """Yield the latency at each receiver, in ms, with all ports and with CAN alone."""
    return rows_of(costs(2.0 * scope.seconds, scope.network), "receiver")


@contextlib.contextmanager
def _people() -> Iterator[dict[str, Any]]:
    """Publish two standing people; yield the settings of the source that receives them."""
    from hri_sim.senders.ros2 import DOMAIN, FRAME, TOPIC  # needs rclpy

    with child(_publish) as publisher:
        publisher.receive()
        yield {
            "kind": "ros2", "topics": [TOPIC], "frame": FRAME, "sees_room": True,
            "domain_id": DOMAIN, "rate_hz": PEOPLE_HZ, "room_from_source": POSE,
        }  # fmt: skip


def _publish(pipe: Connection) -> None:
    """Publish the scenes of the cell's own source, stamped with UTC; for ``child``."""
    from hri_sim.senders.ros2 import Ros2End  # needs rclpy

    settings = cell.settings(captures_hz=PEOPLE_HZ)["source"] | {"room_from_source": POSE}
    source = ProceduralSource(validated(ProceduralSettings, settings, "the bench's people"))
    source.open(time.time_ns())
    end = Ros2End(Path())
    end.start()
    pipe.send("ready")
    while not pipe.poll():
        scene = source.poll(time.time_ns())
        if scene is not None:
            for unit in end.encode(scene):
                end.write(unit)
        time.sleep(0.001)
    end.stop()


def _polled(rows: Sequence[tuple[int, ...]]) -> dict[str, Any]:
    at_ns, beats, ages = zip(*rows, strict=True)
    known = [age for age in ages if age != NOT_AVAILABLE]
    return _numbered("Modbus, polled every 10 ms", at_ns, beats, RATE_HZ, ages_ms=known)


def _numbered(
    receiver: str, at_ns: Sequence[int], numbers: Sequence[int], rate_hz: float, **more: Any
) -> dict[str, Any]:
    """Return the row of messages that are numbered modulo 65536."""
    steps = [(b - a) % 65_536 for a, b in itertools.pairwise(numbers)]
    lost = sum(step - 1 for step in steps if step > 1)
    return _line(receiver, len(numbers), lost, deviations_ms=deviations(at_ns, rate_hz), **more)


def _cell(what: str, found: dict[str, Any]) -> Iterator[dict[str, Any]]:
    """Yield the rows of a cell's CAN bus and its bare loop."""
    yield _line(
        f"CAN FD, 25 Hz, {what}",
        found["heard"],
        found["missing"],
        deviations_ms=found["deviation_ms"],
        ages_ms=found["ages_ms"],
        cpu_percent=found["cpu_percent"],
    )
    bare = found["bare_ms"]
    yield _line(f"bare loop, {what}", len(bare) + 1, 0, deviations_ms=bare)


def _line(
    receiver: str,
    heard: int,
    lost: int,
    *,
    deviations_ms: Sequence[float] = (),
    ages_ms: Sequence[float] = (),
    **more: Any,
) -> dict[str, Any]:
    return {
        "receiver": receiver,
        "heard": heard,
        "lost": lost,
        "deviation_ms": spread(deviations_ms, 2) if deviations_ms else None,
        "age_ms": spread(ages_ms, 0) if ages_ms else None,
        **more,
    }
