"""Mock controllers as real processes behind real pseudo-terminals.

No test here asserts that anything is fast; what must happen by itself is waited for.
"""

import json
import os
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from hri_drivers.links.can.link import CanCodec, CanLink, CanLinkSettings
from hri_drivers.links.framed import SerialCodec
from hri_drivers.links.serial.link import SerialLink, SerialLinkSettings
from hri_predict.base.clock import MonotonicClock
from hri_predict.base.errors import LinkError
from hri_predict.base.settings import Pose
from hri_predict.protocol.definition import SCHEMA_HASH, SCHEMA_VERSION
from hri_predict.protocol.messages import Advice, Level, RobotState, Schema
from hri_predict.protocol.reasons import Reason
from hri_predict.robots.model import RobotSettings
from hri_sim.controllers.cell import MockCell
from hri_sim.controllers.process import job_for
from hri_sim.controllers.station import posts
from hri_sim.controllers.wiring import Wiring

ARM = RobotSettings(name="arm", model="ur5e", room_from_robot=Pose(), max_speed_m_s=1.0)
# Generous times: the machine that runs this may be busy with other things.
PATIENT = {"max_age_s": 2.0, "silence_timeout_s": 0.5, "acceleration": 5.0}
DRIVE = {"role": "drive", "robot": "arm", "trajectory": "pick_and_place", **PATIENT}
MONITOR = {"role": "monitor", "robot": "arm", **PATIENT}
GO = Advice(robot=0, level=Level.CLEAR, reason=Reason.NONE, speed_limit_m_s=1.0, echo=0, age_s=0.03)
WAIT_S = 20.0
pytestmark = pytest.mark.realtime


class PlayedNode:
    """Advises over a real transport every 20 ms while it is asked to, echo and all."""

    def __init__(self, link):
        self.codec: Any = (
            CanCodec(link) if isinstance(link, CanLinkSettings) else SerialCodec(115200)
        )
        cls = CanLink if isinstance(link, CanLinkSettings) else SerialLink
        self.transport: Any = cls.make_transport(link)
        self.transport.open()
        self.echo = None
        self.states = []
        self.k = 0

    def tick(self, advice=GO, spoil=None):
        while units := self.transport.read(0.003):  # slcan's acknowledgements look like nothing
            for message in (m for unit in units for m in self.codec.decode(unit)):
                assert isinstance(message, RobotState)
                self.echo = message.counter
                self.states.append(message)
        messages = [Schema(SCHEMA_VERSION, SCHEMA_HASH)] if self.k % 10 == 0 else []
        self.k += 1
        for message in [*messages, replace(advice, echo=self.echo)]:
            for unit in self.codec.encode(message):
                self.transport.write(spoil(unit) if spoil else unit)

    @property
    def moving(self):
        return bool(self.states) and any(abs(v) > 0 for v in self.states[-1].velocities)


def until(condition, *nodes, **tick):
    """Let ``nodes`` advise until ``condition`` holds."""
    end = time.monotonic() + WAIT_S
    while not condition():
        assert time.monotonic() < end, "waited in vain"
        for node in nodes:
            node.tick(**tick)
        time.sleep(0.02)


@pytest.fixture
def one(tmp_path: Path):
    """A drive's process on its own, outside any cell: (process, link settings, wiring)."""
    links = [SerialLinkSettings(name="drive", simulate=DRIVE)]
    (post,) = posts(links, [ARM], None)
    wiring = Wiring.create(tmp_path / "wiring", ["drive"])
    job = tmp_path / "job.json"
    job.write_text(json.dumps(job_for(post, tmp_path / "wiring", ["drive"], 1.0)))
    process = subprocess.Popen(
        [sys.executable, "-m", "hri_sim.controllers.process", str(job)],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
    )
    assert process.stdout is not None
    port = json.loads(process.stdout.readline())["port"]
    yield process, links[0].model_copy(update={"port": port}), wiring
    process.kill()
    process.wait()
    for stream in (process.stdin, process.stdout):
        if stream is not None:
            stream.close()
    wiring.close()


def end(process, how):
    """End the process by ``how`` and return its report."""
    if how is None:
        process.stdin.close()
    else:
        process.send_signal(how)
    report = json.loads(process.stdout.readline())
    assert process.wait(WAIT_S) == 0
    return report


def arm_stands(wiring):
    truth = wiring.truth()
    return truth is not None and not truth.qd.any()


def test_silence_stops_the_arm_by_itself_and_sigterm_gives_the_report(one):
    process, link, wiring = one
    node = PlayedNode(link)
    until(lambda: node.moving, node)
    until(lambda: arm_stands(wiring) and wiring.lowest_permit(MonotonicClock().now_ns())[0] == 0)
    time.sleep(0.1)  # and it stays so
    assert arm_stands(wiring)
    report = end(process, signal.SIGTERM)
    assert report["stop_causes"] == {"silent": 1}
    assert report["timeouts"] == 1
    assert (report["crc_errors"], report["malformed"], report["counter_errors"]) == (0, 0, 0)
    assert report["messages"] > 2
    assert report["states_sent"] > 2
    # by its own account it stopped one time-out after the last message, give or take its cycle
    assert report["events"][-1][1:] == ["silent", 0.0]


def test_bit_errors_are_counted_and_stop_it_and_it_recovers(one):
    process, link, wiring = one
    node = PlayedNode(link)
    until(lambda: node.moving, node)
    node.tick(spoil=lambda unit: bytes([unit[0], unit[1] ^ 4]) + unit[2:])
    until(lambda: arm_stands(wiring), node)
    until(lambda: node.moving, node)
    report = end(process, signal.SIGTERM)
    assert report["crc_errors"] + report["malformed"] >= 1
    assert report["stop_causes"].get("errors", 0) >= 1


def test_the_end_of_its_parent_ends_it_but_only_after_the_arm_has_stopped(one):
    process, link, wiring = one
    node = PlayedNode(link)
    until(lambda: node.moving, node)
    report = end(process, None)
    assert arm_stands(wiring)
    assert report["timeouts"] == 1


def test_a_node_that_goes_and_comes_back_is_heard_again(one):
    _, link, _ = one
    node = PlayedNode(link)
    until(lambda: node.moving, node)
    node.transport.close()
    time.sleep(1.2)  # longer than any node needs to start again
    node = PlayedNode(link)
    until(lambda: node.moving, node)


def test_it_survives_garbage(one):
    process, link, wiring = one
    node = PlayedNode(link)
    for k in range(50):
        node.transport.write(bytes((k * j) % 256 for j in range(90)))
        node.transport.read(0.0)
        time.sleep(0.005)
    assert arm_stands(wiring)
    report = end(process, signal.SIGTERM)
    assert report["crc_errors"] + report["malformed"] > 10
    assert report["stops"] == 0  # it never moved


def test_a_job_that_cannot_be_done_is_one_line_and_status_2(tmp_path: Path):
    done = subprocess.run(
        [sys.executable, "-m", "hri_sim.controllers.process", str(tmp_path / "absent.json")],
        capture_output=True,
        check=False,
    )
    assert done.returncode == 2
    assert done.stdout == b""
    assert len(done.stderr.strip().splitlines()) == 1


def test_a_node_that_is_killed_before_its_controller_is_ready_leaves_no_traceback(tmp_path: Path):
    (post,) = posts([SerialLinkSettings(name="drive", simulate=DRIVE)], [ARM], None)
    wiring = Wiring.create(tmp_path / "wiring", ["drive"])
    job = tmp_path / "job.json"
    job.write_text(json.dumps(job_for(post, tmp_path / "wiring", ["drive"], 1.0)))
    process = subprocess.Popen(
        [sys.executable, "-m", "hri_sim.controllers.process", str(job)],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
    )
    assert process.stdin is not None
    assert process.stdout is not None
    assert process.stderr is not None
    process.stdin.close()
    process.stdout.close()  # as the kernel does for a process that was killed
    with process.stderr:
        assert process.stderr.read() == b""
    assert process.wait(WAIT_S) == 0
    wiring.close()


# --- the cell in real time -----------------------------------------------------------------------


@pytest.fixture
def cell():
    """A started cell with a drive on serial and a monitor on CAN over slcan, and its nodes."""
    links = [
        SerialLinkSettings(name="drive", simulate=DRIVE),
        CanLinkSettings(name="monitor", interface="slcan", simulate=MONITOR),
    ]
    cell = MockCell(links=links, robots=[ARM], base_dir=None, clock=MonotonicClock(), factor=1.0)
    ports = cell.start()
    nodes = [
        PlayedNode(links[0].model_copy(update={"port": ports["drive"]})),
        PlayedNode(links[1].model_copy(update={"channel": ports["monitor"]})),
    ]
    yield cell, ports, links, nodes
    for node in nodes:
        node.transport.close()
    cell.stop()


def forbidden(cell):
    """Whether the monitor's wire forbids motion, and the arm stands."""
    wiring = cell._wirings[0]
    return wiring.permit("monitor", MonotonicClock().now_ns())[0] == 0 and arm_stands(wiring)


def test_two_processes_move_and_stop_one_arm(cell):
    cell, _, _, (drive, monitor) = cell
    until(lambda: drive.moving and monitor.moving, drive, monitor)
    # the monitor's channel alone falls silent
    until(lambda: forbidden(cell), drive)
    until(lambda: drive.moving and not forbidden(cell), drive, monitor)
    now_ns = MonotonicClock().now_ns()
    assert set(cell.robot_truth(now_ns)) == {"arm"}
    reports = cell.stop()
    assert [r.name for r in reports] == ["drive", "monitor"]
    assert [r.ended for r in reports] == ["ok", "ok"]
    assert all(r.crc_errors == r.malformed == r.counter_errors == 0 for r in reports)
    assert reports[0].stop_causes.get("silent", 0) >= 1
    assert reports[1].timeouts >= 1
    assert cell.stop() == reports


def test_a_killed_monitor_stops_the_arm_and_is_found_again_after_its_restart(cell):
    cell, ports, links, (drive, monitor) = cell
    until(lambda: drive.moving and monitor.moving, drive, monitor)
    cell.kill("monitor")
    until(lambda: forbidden(cell), drive)
    monitor.transport.close()
    cell.restart("monitor")
    monitor = PlayedNode(links[1].model_copy(update={"channel": ports["monitor"]}))
    until(lambda: drive.moving and monitor.moving, drive, monitor)
    monitor.transport.close()
    assert [r.ended for r in cell.stop()] == ["ok", "killed", "ok"]


def test_a_restarted_drive_goes_on_from_where_the_arm_stood(cell):
    cell, ports, links, (drive, monitor) = cell
    until(lambda: drive.moving, drive, monitor)
    travelled = cell._wirings[0]
    until(lambda: travelled.truth().path_s > 0.5, drive, monitor)
    cell.kill("drive")
    now_ns = MonotonicClock().now_ns()
    before, _ = cell.robot_truth(now_ns + 10**9)["arm"]
    drive.transport.close()
    cell.restart("drive")
    drive = PlayedNode(links[0].model_copy(update={"port": ports["drive"]}))
    until(lambda: bool(drive.states), drive)
    assert drive.states[0].positions == pytest.approx(tuple(before), abs=0.01)
    drive.transport.close()


def test_nothing_is_left_behind(cell):
    cell, ports, _, _ = cell
    folder = Path(ports["drive"]).parent
    assert folder.exists()
    assert folder.stat().st_mode & 0o077 == 0  # nobody else's business
    pids = [p._child.pid for p in cell._processes.values()]
    cell.stop()
    assert not folder.exists()
    for pid in pids:
        with pytest.raises(ProcessLookupError):
            os.kill(pid, 0)


def test_a_shared_bus_without_a_channel_says_so():
    link = CanLinkSettings(name="can", interface="udp_multicast", fd=True, simulate=DRIVE)
    cell = MockCell(links=[link], robots=[ARM], base_dir=None, clock=MonotonicClock(), factor=1.0)
    with pytest.raises(LinkError, match="'can'"):
        cell.start()
    cell.stop()
