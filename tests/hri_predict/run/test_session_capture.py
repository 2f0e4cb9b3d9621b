"""Whole runs with a tick for each capture, on the virtual clock and in real time."""

import bisect
import itertools
import subprocess
import sys
import threading
from dataclasses import replace
from functools import cache
from pathlib import Path

import pytest

from hri_predict.node.listeners import Tick
from hri_predict.protocol.reasons import Reason
from hri_predict.run import config as configuration
from hri_predict.run.session import Options, View, run
from hri_sim.baseline_demo import BASELINE
from hri_sim.wires.ports import free_udp_port

MS = 1_000_000
SENDER = Path(__file__).resolve().parents[3] / "drivers" / "python" / "hri_sender.py"


@cache
def cell(**node):
    """The demo's cell with a cheap predictor, and a tick for each capture."""
    loaded = configuration.load(configuration.shipped("demo.yaml")).quiet()
    people = loaded.node.people.model_copy(update={"exits": [], "entrances": None})
    node = {"ticks": "capture", "people": people} | node  # no door, for which rates matter
    return replace(loaded.with_predictor(**BASELINE), node=loaded.node.model_copy(update=node))


class Watch(View):
    """Keeps the ticks between start and stop."""

    def __init__(self):
        self.ticks: list[Tick] = []

    def on_tick(self, tick):
        if tick.snapshot is not None:
            self.ticks.append(tick)

    @property
    def began_ms(self):
        first = self.ticks[0].now_ns
        return [(t.now_ns - first) / MS for t in self.ticks]

    @property
    def advice(self):
        return [(t.now_ns, t.advices) for t in self.ticks]


def play(config, **options):
    watch = Watch()
    summary = run(config, Options(factor=None, view=watch, **options))
    return summary, watch


def obeyed(summary):
    """The controllers, whose receivers judge counters and silence, had nothing to complain of."""
    assert not summary.counted.get("assess_failures")
    for controller in summary.controllers:
        assert controller["ended"] == "ok"
        assert controller["counter_errors"] == controller["crc_errors"] == 0
        assert controller["timeouts"] == 0


def source(config, **keys):
    return config.with_source(config.source.model_dump() | keys)


def test_each_capture_is_judged_when_it_arrives():
    config = source(cell(), rate_hz=30.0, latency_s=0.015, min_latency_s=0.015)
    summary, watch = play(config, duration_s=2.0)
    obeyed(summary)
    arrived = [0.0, *(15 + k * 1000 / 30 for k in range(60))]
    assert watch.began_ms == pytest.approx([t for t in arrived if t < 2000], abs=1e-3)
    ages = [t.snapshot.age_s for t in watch.ticks[5:]]
    assert ages == pytest.approx([0.015] * len(ages), abs=1e-6)


def test_at_the_fixed_rate_the_same_captures_wait_for_the_tick():
    config = source(cell(ticks="fixed"), rate_hz=30.0, latency_s=0.015, min_latency_s=0.015)
    _, watch = play(config, duration_s=2.0)
    assert watch.began_ms == [40.0 * k for k in range(50)]
    ages = [t.snapshot.age_s for t in watch.ticks[5:]]
    assert max(ages) > 0.04


def test_a_source_slower_than_the_floor_and_one_faster_than_the_largest_rate():
    _, slow = play(source(cell(), rate_hz=10.0), duration_s=2.0)
    assert max(b - a for a, b in itertools.pairwise(slow.began_ms)) == pytest.approx(40.0)
    summary, fast = play(source(cell(max_rate_hz=50.0), rate_hz=240.0), duration_s=2.0)
    obeyed(summary)
    apart = [b - a for a, b in itertools.pairwise(fast.began_ms)]
    assert min(apart) >= 20.0 - 1e-6
    assert len(fast.ticks) == 100
    assert fast.ticks[-1].snapshot.captures > 400  # though every scene was taken in


@pytest.mark.long
def test_two_runs_give_the_same_bytes(tmp_path):
    a, b = tmp_path / "a.mcap", tmp_path / "b.mcap"
    for path in (a, b):
        summary, _ = play(cell(), duration_s=6.0, record=path)
        obeyed(summary)
    assert a.stat().st_size > 100_000
    assert a.read_bytes() == b.read_bytes()


@pytest.mark.long
def test_a_recording_made_so_and_replayed_so_gives_the_same_advice(tmp_path):
    path = tmp_path / "a.mcap"
    _, first = play(cell(), duration_s=6.0, record=path)
    played = cell().with_source({"kind": "recording", "path": str(path)})
    _, second = play(played, duration_s=6.0)
    assert any(a.separation_m is not None for _, advices in first.advice for a in advices)
    assert second.advice[: len(first.advice)] == first.advice


class Ends(Watch):
    """Ends the sender after 40 captures, and the run a second later."""

    def __init__(self, sender, stop):
        super().__init__()
        self.sender, self.stop, self.ended_ns = sender, stop, None
        self.received_ns = []

    def on_scene(self, scene, receipt_ns):
        self.received_ns.append(receipt_ns)

    def on_tick(self, tick):
        super().on_tick(tick)
        if tick.snapshot is None:
            return
        if self.ended_ns is None and tick.snapshot.captures >= 40:
            self.sender.terminate()
            self.ended_ns = tick.now_ns
        elif self.ended_ns is not None and tick.now_ns > self.ended_ns + 1_000 * MS:
            self.stop.set()


@pytest.mark.realtime
def test_a_real_sender_over_udp_wakes_the_loop_and_its_end_leaves_the_floor():
    """20 Hz of another process, then nobody: the floor of 10 Hz, and stale input."""
    port, stop = free_udp_port(), threading.Event()
    shipped = configuration.load(configuration.shipped("live_udp.yaml"))
    live = {"port": port, "rate_hz": 20.0}
    config = cell(rate_hz=10.0).with_source(shipped.source.model_dump() | live)
    with subprocess.Popen([sys.executable, SENDER, "--port", str(port), "--rate", "20"]) as sender:
        watch = Ends(sender, stop)
        run(config, Options(view=watch, duration_s=30.0), stop)
    assert watch.ended_ns is not None
    began_ns = [t.now_ns for t in watch.ticks]
    waited_ms = sorted(
        (began_ns[bisect.bisect_left(began_ns, at)] - at) / MS for at in watch.received_ns[5:35]
    )
    # Half of them wait less than 20 ms, and 0.2 ms on a quiet machine. With ticks at the fixed rate
    # alone, half would wait for more than 50.
    assert waited_ms[len(waited_ms) // 2] < 20.0
    silent = [t for t in watch.ticks if t.now_ns > watch.ended_ns + 300 * MS]
    assert len(silent) > 3  # of 7 in 0.7 s
    assert silent[-1].status.reason is Reason.INPUT_STALE
