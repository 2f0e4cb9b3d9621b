"""Stops are measured against the delay budget and the stopping table."""

from typing import Any

import pytest

from hri_predict.base.clock import VirtualClock
from hri_predict.commissioning import stopping
from hri_predict.commissioning.folder import worst
from hri_predict.commissioning.stopping import (
    StoppingTrials,
    StopTest,
    judge_stops,
    measure_stops,
)
from hri_predict.commissioning.typed_stops import (
    NEAR,
    MeasuredStop,
    typed_stops,
    without_top_speed,
)
from hri_predict.contracts.link import Received
from hri_predict.run import assemble
from tests.hri_predict.commissioning.cells import cell_data, load_cell
from tests.messages import make_state

S, MS = 1_000_000_000, 1_000_000
PLAN = StoppingTrials(speeds_m_s=[0.5], repeats=1, wait_s=2.0)
PLAN_OF_PARTS = StoppingTrials(speeds_m_s=[], repeats=1, wait_s=1.0)


@pytest.fixture(autouse=True)
def _soon(monkeypatch):
    """On the virtual clock a test runs to its longest time."""
    monkeypatch.setattr(stopping, "STOPS_WITHIN_S", 2.0)


def empty_cell(folder, change=lambda data: None):
    data = cell_data()
    data["source"]["people"] = []
    change(data)
    return load_cell(folder, data)


def test_a_drive_that_brakes_as_its_table_says_passes(tmp_path):
    found, missing = measure_stops(empty_cell(tmp_path), PLAN, VirtualClock(S))
    (stop,) = found.stops
    assert (judge_stops(found), missing) == ([], [])
    assert stop.passed
    assert stop.speed_m_s == pytest.approx(0.5, abs=0.03)
    assert stop.total_s is not None
    assert stop.total_m is not None
    assert 0 < stop.braking_s < stop.total_s <= stop.allowed_s
    assert 0 < stop.braking_m < stop.total_m <= stop.allowed_m
    (curve,) = found.curves
    assert curve.speed_m_s[-1] == 1.0


def test_a_drive_that_brakes_late_fails_and_is_named(tmp_path):
    def late(data):
        data["links"][0]["simulate"]["lies"] = [{"kind": "brakes_late", "factor": 3.0}]

    found, _ = measure_stops(empty_cell(tmp_path, late), PLAN, VirtualClock(S))
    (stop,) = found.stops
    assert stop.total_s is not None
    assert stop.total_s > 1.4 * stop.allowed_s
    (line,) = judge_stops(found)
    assert line.startswith("robot arm, stopped at 0.5")


def test_a_robot_that_may_not_move_is_missing_and_the_test_ends(tmp_path):
    data = cell_data()
    stands = {"start": [0.9, 0.3], "script": [{"do": "wait", "seconds": 60}]}
    data["source"]["people"] = [stands]  # beside the robot
    plan = StoppingTrials(speeds_m_s=[0.5], repeats=1, wait_s=0.5)
    found, missing = measure_stops(load_cell(tmp_path, data), plan, VirtualClock(S))
    assert found.stops == []
    assert missing[0].startswith("robot arm: never reached 0.5 m/s; the fastest was")


def test_a_robot_that_reports_nothing_is_named(tmp_path):
    def stands(data):
        data["robots"][0]["motion"] = {"kind": "standing", "positions": [0, -1.5, 1.5, 0, 0, 0]}

    (line,) = measure_stops(empty_cell(tmp_path, stands), PLAN, VirtualClock(S))[1]
    assert "robot arm: no link reports its state" in line


class Ramp:
    """A robot whose speed follows a function of time, judged as the demo's arm."""

    def __init__(self, folder, speed_at, hz=100, silent_s=(9.0, 9.0)):
        self.config = empty_cell(folder)
        (self.model,) = assemble.build_robots(self.config)
        me: Any = self
        self.test = StopTest([me], PLAN, {0: self.config.node.robots[0]})
        self.dof = 1
        self._speed_at, self._period_ns = speed_at, round(S / hz)
        self._silent_s = silent_s

    def tip_speed(self, q, qd):
        return abs(qd[0])

    def stop(self):
        """What was measured of the one trial."""
        (stop,), missing = self.measured()
        assert missing == []
        return stop

    def measured(self):
        """Feed states and ticks until the one trial is over; its stop, and what is missing."""
        commanded_ns, now_ns = None, 0
        while not self.test.done.is_set():
            trial = self.test.trials[-1] if self.test.trials else None
            if trial is not None and commanded_ns is None:
                commanded_ns = trial.commanded_ns
            since = None if commanded_ns is None else (now_ns - commanded_ns) * 1e-9
            speed = self._speed_at(since)
            state = make_state((0.0,), (speed,))
            if since is None or not self._silent_s[0] < since < self._silent_s[1]:
                self.test.on_received("drive", Received(state, now_ns))
            self.test.each_tick(now_ns)
            now_ns += self._period_ns
        budget = assemble.build_budget(self.config, assemble.build_source(self.config))
        return stopping._measured(self.config, [self.model], budget, self.test.trials)


def braking(reaction_s, deceleration):
    """0.5 m/s until ``reaction_s`` after the command, then uniformly down."""

    def speed_at(since_s):
        late_s = 0.0 if since_s is None else max(0.0, since_s - reaction_s)
        return max(0.0, 0.5 - deceleration * late_s)

    return speed_at


@pytest.mark.parametrize(("reaction_s", "deceleration"), [(0.02, 4.0), (0.05, 8.0), (0.0, 5.0)])
def test_time_and_way_are_those_of_uniform_braking(tmp_path, reaction_s, deceleration):
    stop = Ramp(tmp_path, braking(reaction_s, deceleration)).stop()
    # to STANDS_M_S, seen at one of 100 samples a second
    down_s = (0.5 - 0.02) / deceleration
    assert stop.total_s == pytest.approx(reaction_s + down_s, abs=0.011)
    assert stop.total_m == pytest.approx(0.5 * reaction_s + 0.25 / 2 / deceleration, abs=0.006)
    assert stop.braking_s == pytest.approx(down_s, abs=0.02)
    assert stop.passed


@pytest.mark.parametrize(("reaction_s", "deceleration"), [(0.3, 4.0), (0.02, 1.0)])
def test_a_late_or_a_weak_brake_fails(tmp_path, reaction_s, deceleration):
    assert not Ramp(tmp_path, braking(reaction_s, deceleration)).stop().passed


def test_a_robot_that_never_stands_fails(tmp_path):
    stop = Ramp(tmp_path, lambda since: 0.5, hz=20).stop()
    assert not stop.stood
    assert not stop.passed
    found = stopping.Stopping(stops=[stop], curves=[])
    assert "did not come to a standstill within 2 s" in judge_stops(found)[0]


@pytest.mark.parametrize(
    ("silent_s", "found"),
    [
        ((0.01, 0.9), "missing for 0.89 s during the stop from 0.5 m/s"),
        ((0.01, 9.0), "missing for 2 s during the stop from 0.5 m/s"),  # never seen again
        ((0.01, 0.06), True),
    ],
)
def test_a_stop_that_was_not_seen_is_not_measured(tmp_path, silent_s, found):
    stops, missing = Ramp(tmp_path, braking(0.02, 4.0), silent_s=silent_s).measured()
    if found is True:
        assert ([stop.passed for stop in stops], missing) == ([True], [])
    else:
        (line,) = missing
        assert stops == []
        assert found in line


def test_a_gap_hides_no_stop_that_fails_in_any_case(tmp_path):
    for speed_at in (braking(0.9, 4.0), lambda since: 0.5):  # long after the gap, it still moves
        (stop,), missing = Ramp(tmp_path, speed_at, silent_s=(0.1, 0.3)).measured()
        assert (stop.passed, missing) == (False, [])


def test_what_the_integrator_measured_is_compared_with_the_table(tmp_path):
    config = empty_cell(tmp_path)
    (model,) = assemble.build_robots(config)
    time_s, distance_m = model.stopping(0.7)
    found = typed_stops(
        config,
        [
            MeasuredStop("arm", 0.7, time_s, distance_m),
            MeasuredStop("arm", 0.7, time_s + 0.01, distance_m),
            MeasuredStop("arm", 0.7, time_s, distance_m + 0.01),
        ],
    )
    assert [stop.passed for stop in found.stops] == [True, False, False]
    assert len(judge_stops(found)) == 2
    assert worst(found)["arm", 0.7] is not found.stops[0]


@pytest.mark.parametrize("top_m_s", [0.3333, 0.6664, 1.0])
def test_a_speed_that_was_rounded_for_the_test_is_still_the_highest(tmp_path, top_m_s):
    config = empty_cell(tmp_path)
    robots = [config.node.robots[0].model_copy(update={"max_speed_m_s": top_m_s})]
    reached = NEAR * PLAN_OF_PARTS.speeds_of(robots[0])[-1]
    for speed_m_s, missing in ((reached, 0), (0.9 * top_m_s, 1)):
        found = typed_stops(config, [MeasuredStop("arm", round(speed_m_s, 4), 0.1, 0.1)])
        assert len(without_top_speed(robots, found)) == missing


def test_each_robot_is_stopped_at_parts_of_its_own_speed(tmp_path):
    (arm,) = empty_cell(tmp_path).node.robots
    fast = arm.model_copy(update={"max_speed_m_s": 2.0})
    assert [PLAN_OF_PARTS.speeds_of(robot) for robot in (arm, fast)] == [
        [0.25, 0.5, 0.75, 1.0],
        [0.5, 1.0, 1.5, 2.0],
    ]
