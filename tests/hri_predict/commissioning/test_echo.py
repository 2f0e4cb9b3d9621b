"""The echo's round trip, without the time in the node, is what the link took."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hri_predict.base.clock import VirtualClock
from hri_predict.commissioning import bench, echo
from hri_predict.commissioning.echo import MeasuredElsewhere, Tap, judge_echo, measure_echo, times
from hri_predict.contracts.cell import ControllerReport
from hri_predict.protocol.messages import Advice
from tests.hri_predict.commissioning.cells import cell_data, load_cell

S = 1_000_000_000


def measured(folder, data=None, elsewhere=None):
    return measure_echo(load_cell(folder, data), 2.0, VirtualClock(S), elsewhere or {})


@pytest.fixture(scope="module")
def demo(tmp_path_factory):
    return measured(tmp_path_factory.mktemp("demo"))


def test_both_links_of_the_demo_are_within_the_budget(demo):
    assert judge_echo(demo) == ([], [])
    for link, blocked_ms in zip(demo.links, (5.584, 0.54), strict=True):
        assert link.measured_by == "controller"
        # 25 messages a second, each sent three times; repetitions may carry the same echo
        assert 45 <= link.echoes <= link.round_trip.count
        assert link.round_trip.count == 150
        assert link.both_ways_ms <= 8.0  # the controller's cycle
        assert link.allowed_ms == pytest.approx(2 * 5.0 + blocked_ms, abs=0.01)


def test_a_link_that_is_slower_than_its_budget_fails(tmp_path):
    data = cell_data()
    data["links"][0]["simulate"]["faults"] = [{"kind": "delay", "delay_s": 0.03}]
    found = measured(tmp_path, data)
    (line,) = judge_echo(found)[0]
    assert line.startswith("link drive:")
    # on this clock the node reads at its ticks, 40 ms apart, and the drive in its cycle of 8 ms
    assert 60.0 <= found.links[0].both_ways_ms <= 60.0 + 40.0 + 2 * 8.0


def test_a_controllers_own_figures_are_compared(tmp_path):
    quick = MeasuredElsewhere(p50_ms=5.0, p99_ms=8.0, max_ms=10.0)
    slow = MeasuredElsewhere(p50_ms=10.0, p99_ms=20.0, max_ms=90.0)
    found = measured(tmp_path, elsewhere={"drive": quick, "monitor": slow})
    for link, max_ms in zip(found.links, (10.0, 90.0), strict=True):
        assert link.measured_by == "integrator"
        assert link.both_ways_ms == pytest.approx(max(0.0, max_ms - link.in_node.p50_ms))
        assert link.in_node.count == link.echoes  # the first of each state
    (line,) = judge_echo(found)[0]
    assert line.startswith("link monitor:")


def test_one_long_wait_in_the_node_hides_no_slow_link(tmp_path, monkeypatch):
    decoded = echo._decoded

    def late(receiver, units):
        """One advice was written 60 ms late."""
        rows = list(decoded(receiver, units))
        advices = [i for i, (_, message) in enumerate(rows) if isinstance(message, Advice)]
        for i in advices[-1:]:
            rows[i] = (rows[i][0] + 60 * S // 1000, rows[i][1])
        return rows

    monkeypatch.setattr(echo, "_decoded", late)
    slow = MeasuredElsewhere(p50_ms=50.0, p99_ms=55.0, max_ms=60.0)
    found = measured(tmp_path, elsewhere={"drive": slow})
    (line,) = judge_echo(found)[0]
    assert line.startswith("link drive: 6")


def test_a_controller_that_measures_nothing_or_says_nothing_leaves_it_open(demo):
    found = demo
    mute = found.links[0].model_copy(update={"round_trip": None, "both_ways_ms": None})
    silent = found.links[1].model_copy(update={"states": 0})
    deaf = found.links[1].model_copy(update={"echoes": 0})
    failed, missing = judge_echo(found.model_copy(update={"links": [mute, silent, deaf]}))
    assert failed == []
    assert "echo.measured.drive" in missing[0]
    assert "no RobotState arrived" in missing[1]
    assert "no advice repeated a RobotState" in missing[2]
    assert judge_echo(found.model_copy(update={"links": []}))[1] == ["the cell has no link"]


def test_no_robot_may_move_meanwhile(tmp_path, monkeypatch):
    kept: list[ControllerReport] = []
    reports = bench.Bench.reports

    def keep(end):
        kept.extend(reports(end))
        return kept

    monkeypatch.setattr(bench.Bench, "reports", keep)
    data = cell_data()
    data["source"]["people"] = []
    measured(tmp_path, data)
    drive, _ = kept
    assert drive.messages > 0
    assert drive.events == []  # it never left its first stop


@given(st.lists(st.floats(0, 5000), min_size=1, max_size=50))
def test_times_are_those_of_numpy_and_every_one_is_counted(values):
    found = times(values)
    assert found is not None
    assert found.p99_ms == pytest.approx(np.percentile(values, 99), abs=1e-3)
    assert found.max_ms == pytest.approx(max(values), abs=1e-3)
    assert sum(found.bins) == found.count == len(values)


def test_several_echoes_of_one_state_are_paired_in_order():
    waited = {7: [10.0, 50.0], 8: [5.0]}
    heard = [(7, 13.0), (7, 54.0), (8, 6.0)]
    assert list(echo._on_link(heard, waited)) == [3.0, 4.0, 1.0]
    lost = [(7, 54.0), (8, 6.0)]  # the record does not tell which of the two was lost
    assert list(echo._on_link(lost, waited)) == [44.0, 1.0]


def test_a_tap_is_the_wire_and_remembers_when():
    class Wire:
        device = "can0"

        def __init__(self):
            self.said = []

        def open(self):
            self.said.append("open")

        def close(self):
            self.said.append("close")

        def write(self, unit):
            self.said.append(unit)

        def read(self, timeout_s):
            return [b"x", b"y"]

    clock, wire = VirtualClock(5), Wire()
    tap = Tap(wire, clock)
    tap.open()
    tap.write(b"a")
    clock.advance_to(9)
    assert tap.read(0.0) == [b"x", b"y"]
    tap.close()
    assert wire.said == ["open", b"a", "close"]
    assert (tap.written, tap.read_units) == ([(5, b"a")], [(9, b"x"), (9, b"y")])
    assert tap.device == "can0"
