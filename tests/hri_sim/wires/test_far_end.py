"""A far end takes bytes at the rate of the wire; delays are matched tick by tick."""

import os
import select
import time

import pytest

from hri_drivers.links.can.link import CanLink, CanLinkSettings
from hri_predict.protocol.can import CanSender
from hri_predict.protocol.messages import Advice, Level, NodeState, Status
from hri_predict.protocol.reasons import Reason
from hri_sim.bench.latency import _figures, _Seen, _status_times, _Watch
from hri_sim.bench.links import saturate
from hri_sim.wires.child import child
from hri_sim.wires.far_end import drain, serial_line
from hri_sim.wires.pty import open_pty

MS = 1_000_000


@pytest.mark.realtime
def test_a_paced_far_end_takes_every_byte_and_never_faster_than_the_wire():
    with child(serial_line, 20_000) as line:
        port = os.open(line.receive(), os.O_WRONLY | os.O_NOCTTY)
        began = time.monotonic()
        for _ in range(2):
            os.write(port, b"x" * 1000)
            time.sleep(0.01)
        while time.monotonic() - began < 0.11:  # what is not read when the port closes is lost
            time.sleep(0.01)
        os.close(port)
        report = line.report()
    assert report.received == 2000
    assert report.busy_s >= 2000 / 20_000
    assert all(0 <= waiting < 2000 for waiting in report.backlog_bytes)


def test_bytes_that_wait_before_the_first_look_are_taken():
    master, path = open_pty()
    port = os.open(path, os.O_WRONLY | os.O_NOCTTY)
    os.write(port, b"x" * 100)
    assert select.select([master], [], [], 10)[0]  # the kernel hands them over in its own time
    assert drain(master, 1e6, lambda _: True).received == 100
    os.close(port)
    os.close(master)


@pytest.mark.realtime
def test_a_saturating_link_is_accounted_for_to_the_last_message():
    report = saturate(115_200, seconds=1.0)
    assert report["bytes"] > 0
    assert report["used"] <= 1.001  # of what a wire carries no one gets more
    counted = ("sent", "decimated", "superseded", "write_errors")
    assert sum(report[name] for name in counted) == report["posted"]
    assert report["decimated"] > report["sent"]  # more was posted than fits


def test_each_tick_is_matched_with_the_status_of_its_own_cycle():
    watch = _Watch()
    watch.arrived_ns = [n * 40 * MS - 10 * MS for n in range(400)]
    watch.ticks = [_Seen(n, n * 40 * MS, 2 * MS, n * 40 * MS + 5 * MS) for n in range(401)]
    written = [(n * 40 * MS + 6 * MS, n % 256) for n in range(400) if n != 300]
    figures = _figures(watch, written)
    assert (figures["scenes"], figures["missed"]) == (400 - 25 - 1, 1)
    middle = {name: span["p50"] for name, span in figures.items() if isinstance(span, dict)}
    parts = {"wait_ms": 10.0, "inference_ms": 2.0, "node_ms": 3.0, "link_ms": 1.0}
    assert middle == parts | {"total_ms": sum(parts.values())}


def test_a_scene_counts_once_and_old_ones_not_at_all():
    watch = _Watch()
    watch.arrived_ns = [995 * MS, 1010 * MS, 1030 * MS]
    watch.ticks = [_Seen(n, n * 40 * MS, 0, n * 40 * MS) for n in range(30)]
    written = [(n * 40 * MS + MS, n) for n in range(30)]
    figures = _figures(watch, written)
    assert figures["scenes"] == 2  # at 1000 ms the first, at 1040 ms the newest of two
    assert figures["wait_ms"]["p50"] == 7.5


def test_a_status_counts_when_its_last_frame_was_written():
    settings = CanLinkSettings(name="x", interface="virtual", channel="x")
    sender = CanSender()
    frames = sender.encode(Advice(robot=0, level=Level.SLOW, reason=Reason.PERSON_NEAR))
    frames += sender.encode(
        Status(node_state=NodeState.RUNNING, reason=Reason.NONE, people=1, predictor=0, cycle=77)
    )
    written = list(enumerate(frames))
    assert _status_times(CanLink.receiver(settings), written) == [(len(frames) - 1, 77)]
