"""Faults on a link, each alone: the controller acts, and recovers by itself when the fault ends.

The real link, its codecs and the mock controller, on the virtual clock; advice says *clear* all the
while, so every stop is the controller's own doing.
"""

from typing import Any

import pytest

from hri_drivers.links.can.link import CanLink, CanLinkSettings
from hri_drivers.links.serial.link import SerialLink, SerialLinkSettings
from hri_drivers.wires.transport import pipe
from hri_predict.base.clock import VirtualClock
from hri_predict.base.settings import Pose
from hri_predict.protocol.definition import SCHEMA_HASH, SCHEMA_VERSION
from hri_predict.protocol.messages import Level, Schema
from hri_predict.robots.model import RobotSettings
from hri_sim.controllers.cell import MockCell
from hri_sim.faults.injector import FaultyTransport
from tests.messages import make_advice

MS = 1_000_000
ARM = RobotSettings(name="arm", model="ur5e", room_from_robot=Pose(), max_speed_m_s=1.0)
DRIVE = {"role": "drive", "trajectory": "pick_and_place"}
START_S, DURATION_S = 3.0, 1.0

# fault -> (causes that may stop the robot, limit in ms from the fault's start)
EVERY_MS = 15  # the node repeats its advice so often by default
SILENT_MS = 60 + EVERY_MS + 8  # the time-out, from the last advice before the fault, and a cycle
TABLE: dict[str, tuple[Any, Any]] = {
    "none": ([], None),
    "freeze": ({"silent"}, SILENT_MS),
    "drop:1.0": ({"silent"}, SILENT_MS),
    "bit_errors": ({"errors", "silent"}, SILENT_MS),
    "truncate": ({"errors", "silent"}, SILENT_MS),
    # sound advice, on time, that rests on what was 500 ms ago: nothing comes at first
    "delay": ({"silent", "stale"}, SILENT_MS),
    "reorder": ({"errors"}, 2 * EVERY_MS + 8),
    "duplicate": ({"errors"}, EVERY_MS + 8),
    "unplug": ({"silent"}, SILENT_MS),
}
PARAMETERS = {
    "bit_errors": {"rate": 0.01},
    "truncate": {"probability": 1.0},
    "delay": {"delay_s": 0.5},
}


def run(kind, fault, seconds=6.5):
    settings: Any
    clock = VirtualClock(1000 * MS)
    if kind == "serial":
        settings = SerialLinkSettings(name="link", simulate=DRIVE)
    else:
        settings = CanLinkSettings(name="link", interface="slcan", simulate=DRIVE)
    cell = MockCell(links=[settings], robots=[ARM], base_dir=None, clock=clock)
    name, _, probability = fault.partition(":")
    faults = (
        []
        if fault == "none"
        else [
            {
                "kind": name,
                "start_s": START_S,
                "duration_s": DURATION_S,
                "direction": "out",
                **PARAMETERS.get(name, {}),
                **({"probability": float(probability)} if probability else {}),
            }
        ]
    )
    transport = FaultyTransport(inner=cell.transports()["link"], faults=faults, clock=clock, seed=1)
    link = (SerialLink if kind == "serial" else CanLink)(settings, clock, transport)
    start = tick = clock.now_ns()
    while clock.now_ns() < start + seconds * 1e9:
        due = cell.next_ns()
        assert due is not None
        clock.advance_to(min(due, tick))
        now = clock.now_ns()
        if due <= now:
            cell.step(now)
        if tick <= now:
            if (tick - start) // (EVERY_MS * MS) % 66 == 0:  # once a second
                link.post(Schema(SCHEMA_VERSION, SCHEMA_HASH))
            link.post(make_advice(Level.CLEAR, speed_limit_m_s=1.0, capture_ns=now - 30 * MS))
            link.service(now)
            link.take()
            tick += EVERY_MS * MS
    (report,) = cell.stop()
    return report


@pytest.mark.parametrize("kind", ["serial", "can"])
@pytest.mark.parametrize("fault", TABLE)
def test_fault(kind, fault):
    causes, limit_ms = TABLE[fault]
    report = run(kind, fault)
    stops = [(t, cause) for t, cause, limit in report.events if limit == 0]
    if not causes:
        assert stops == []
        return
    assert stops, "the fault did not stop the robot"
    assert {cause for _, cause in stops} <= causes
    assert START_S <= stops[0][0] <= START_S + limit_ms * 1e-3
    # nothing is stopped for long after the fault (a delay outlasts it by itself), and it runs again
    assert all(t <= START_S + DURATION_S + 1.0 for t, _ in stops)
    assert report.events[-1][2] > 0
    assert report.events[-1][0] <= START_S + DURATION_S + 2.0


def test_a_stretched_link_is_ever_later_and_drains_in_order():
    clock = VirtualClock(0)
    near: Any
    far: Any
    near, far = pipe()
    fault = {"kind": "stretch", "rate": 0.5, "start_s": 1.0, "duration_s": 1.0}
    faulty: Any = FaultyTransport(inner=near, faults=[fault], clock=clock, seed=1)
    faulty.open()
    far.open()
    came: dict[int, int] = {}
    for k in range(400):  # a unit every 10 ms
        clock.advance_to(k * 10 * MS)
        faulty.write(k.to_bytes(2, "little"))
        data = b"".join(far.read(0.0))
        units = [data[i : i + 2] for i in range(0, len(data), 2)]
        came |= {int.from_bytes(unit, "little"): 10 * k for unit in units}
    assert list(came) == list(range(400))
    for k, ms in came.items():
        due = 1000 + 1.5 * (10 * k - 1000) if 100 <= k < 200 else max(10 * k, came[199])
        assert 0 <= ms - (10 * k if k < 100 else due) < 10
