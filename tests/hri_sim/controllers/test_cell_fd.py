"""A mock controller over CAN FD on a bus that both processes share, in a network of its own."""

import json
import sys

import pytest

from tests.namespaces import in_namespace, why_not

SCRIPT = """
import json, time
from dataclasses import asdict
from hri_drivers.links.can.link import CanLink, CanLinkSettings
from hri_predict.base.clock import MonotonicClock
from hri_predict.protocol.definition import SCHEMA_HASH, SCHEMA_VERSION
from hri_predict.protocol.messages import Advice, Level, Schema
from hri_predict.protocol.reasons import Reason
from hri_predict.robots.model import RobotSettings
from hri_predict.base.settings import Pose
from hri_sim.controllers.cell import MockCell

arm = RobotSettings(name="arm", model="ur5e", room_from_robot=Pose(), max_speed_m_s=1.0)
settings = CanLinkSettings(
    name="fd", interface="udp_multicast", channel="239.74.163.2", fd=True,
    simulate={"role": "drive", "trajectory": "pick_and_place", "max_age_s": 2.0,
              "silence_timeout_s": 0.5, "acceleration": 5.0},
)
clock = MonotonicClock()
cell = MockCell(links=[settings], robots=[arm], base_dir=None, clock=clock)
channel = cell.start()["fd"]
link = CanLink(settings.model_copy(update={"channel": channel}), clock)
link.start()
moved = False
end = time.monotonic() + 20
k = 0
while not moved and time.monotonic() < end:
    if k % 10 == 0:
        link.post(Schema(SCHEMA_VERSION, SCHEMA_HASH))
    link.post(Advice(robot=0, level=Level.CLEAR, reason=Reason.NONE, speed_limit_m_s=1.0,
                     capture_ns=clock.now_ns() - 30_000_000))
    link.take()
    truth = cell.robot_truth(clock.now_ns())
    moved = bool(truth) and bool(truth["arm"][1].any())
    k += 1
    time.sleep(0.02)
link.stop()
(report,) = cell.stop()
print(json.dumps({"moved": moved, **asdict(report)}))
"""


@pytest.mark.realtime
def test_a_drive_on_a_shared_fd_bus_hears_and_answers():
    if reason := why_not():
        pytest.skip(reason)
    pytest.importorskip("msgpack", reason="python-can's udp_multicast needs msgpack")
    done = in_namespace(f"exec {sys.executable} -c '{SCRIPT}'", 120)
    assert done.returncode == 0, done.stderr
    report = json.loads(done.stdout.splitlines()[-1])
    assert report["moved"]
    assert report["ended"] == "ok"
    assert (report["crc_errors"], report["malformed"], report["counter_errors"]) == (0, 0, 0)
    assert report["round_trip_p50_s"] is not None
