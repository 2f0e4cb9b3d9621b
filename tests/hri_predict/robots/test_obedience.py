"""Robots that keep their limits, robots that do not, and robots that stop late."""

import math
from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hri_predict.robots.obedience import Obedience

REACTION_S = 0.3
TICK_S = 0.04
BRAKES_M_S2 = 4.0


def table(speed):
    return speed / BRAKES_M_S2, speed**2 / (2 * BRAKES_M_S2)


class Robot:
    """Follows the advised limit after its own reaction time."""

    def __init__(self, reaction_s=REACTION_S, brakes=BRAKES_M_S2, factor=1.0):
        self.watch = Obedience(REACTION_S, table, 1.0)
        self.reaction_s, self.brakes, self.factor = reaction_s, brakes, factor
        self.now = self.speed = 0.0
        self.told = [(0.0, 1.0)]

    def run(self, limit, seconds):
        for _ in range(round(seconds / TICK_S)):
            self.now += TICK_S
            heard = [v for t, v in self.told if t <= self.now - self.reaction_s] or [0.0]
            wanted = heard[-1] * self.factor
            slower = self.speed - self.brakes * TICK_S
            self.speed = min(max(wanted, slower), self.speed + 1.0 * TICK_S)
            self.watch.see(self.speed, round(self.now * 1e9))
            self.watch.warn("arm")
            self.watch.advise(limit, round(self.now * 1e9))
            self.told.append((self.now, limit))
        return self

    @property
    def too_fast(self):
        return self.watch.is_too_fast(round(self.now * 1e9))


@given(
    st.lists(st.tuples(st.floats(0, 1), st.floats(0.04, 2)), max_size=12), st.floats(0, REACTION_S)
)
def test_a_robot_that_obeys_within_its_budget_is_never_blamed(limits, reaction_s):
    robot = Robot(reaction_s)
    for limit, seconds in limits:
        robot.run(limit if limit > 0.05 else 0.0, seconds)
        assert (robot.watch.too_fast, robot.watch.stretch) == (0, 1.0)


def test_a_robot_that_ignores_its_limit_is_too_fast_for_a_while():
    robot = Robot(factor=2.0).run(1.0, 2.0).run(0.5, 1.0)
    assert robot.too_fast
    robot.factor = 1.0
    assert robot.run(0.5, 5.0).too_fast
    assert not robot.run(0.5, 10.0).too_fast
    assert robot.watch.too_fast == 1


@pytest.mark.parametrize("times", [3.0, 6.0])
def test_a_late_stop_stretches_the_table_by_what_it_took(times):
    robot = Robot(brakes=BRAKES_M_S2 / times).run(1.0, 2.0)
    assert robot.watch.stretch == 1.0
    robot.run(0.0, 4.0)
    assert robot.watch.late_stops == 1
    assert robot.watch.stretch == pytest.approx(times, rel=0.35)
    assert robot.watch.stretch >= 2.0
    before = robot.watch.stretch
    assert robot.run(1.0, 3.0).watch.stretch == before


def test_nothing_is_said_of_a_robot_before_advice_went_out():
    watch = Obedience(REACTION_S, table, 1.0)
    for tick in range(100):
        watch.see(1.0, tick * 40_000_000)
    assert (watch.too_fast, watch.late_stops) == (0, 0)


def factors(caplog):
    """Return what the log says that a robot needed: the words before "times"."""
    return [line.split(" needed ")[1].split(" times")[0] for line in caplog.messages]


@pytest.mark.parametrize("times", [2.0, 3.0, 9.0])
def test_the_log_says_at_the_end_of_a_stop_how_late_it_was(times, caplog):
    robot = Robot(brakes=BRAKES_M_S2 / times).run(1.0, 2.0).run(0.0, 6.0)
    *before, last = factors(caplog)
    assert last == f"{robot.watch.stretch:.2f}"
    assert before[0].startswith("at least 1.")  # the first tick of it that was too late
    assert len(caplog.messages) <= 2 + math.log2(robot.watch.stretch)
    said = len(caplog.messages)
    robot.run(1.0, 3.0).run(0.0, 6.0)
    assert len(caplog.messages) == said  # it stops as late as before


def test_a_robot_that_does_not_stop_is_told_of_at_each_doubling(caplog):
    Robot(brakes=0.0).run(1.0, 2.0).run(0.0, 120.0)
    found = [float(each.removeprefix("at least ")) for each in factors(caplog)]
    assert found[-1] > 50
    assert all(2 <= b / a < 2.5 for a, b in pairwise(found))


def test_a_robot_that_stops_in_time_is_not_in_the_log(caplog):
    Robot().run(1.0, 2.0).run(0.0, 3.0)
    assert not caplog.messages


def test_a_robot_that_moves_off_during_a_stop_is_too_fast():
    robot = Robot().run(0.0, 3.0)
    assert not robot.too_fast
    robot.told.append((robot.now, 1.0))  # somebody else's command
    for _ in range(50):
        robot.now += TICK_S
        robot.speed = min(robot.speed + TICK_S, 1.0)
        robot.watch.see(robot.speed, round(robot.now * 1e9))
        robot.watch.advise(0.0, round(robot.now * 1e9))
    assert robot.too_fast
    assert robot.watch.too_fast == 1


@pytest.mark.parametrize("rests_s", [0.0, 0.08, 0.3, 1.0])
def test_a_robot_that_ignores_a_stop_is_too_fast_though_it_rests_at_a_waypoint(rests_s):
    watch = Obedience(REACTION_S, table, 1.0)
    for k in range(200):
        now_s = k * TICK_S
        rests = now_s - 2.0 - rests_s < 0.12 and now_s >= 2.0 + rests_s
        watch.see(0.0 if rests else 1.0, round(now_s * 1e9))
        watch.advise(1.0 if now_s < 2.0 else 0.0, round(now_s * 1e9))
    assert watch.too_fast + watch.late_stops >= 1


def test_noise_of_a_robot_at_rest_is_no_motion():
    robot = Robot().run(1.0, 2.0).run(0.0, 3.0)
    for k in range(100):
        robot.watch.see(0.045 * (k % 2), round((robot.now + k * TICK_S) * 1e9))
    assert robot.watch.too_fast == 0
