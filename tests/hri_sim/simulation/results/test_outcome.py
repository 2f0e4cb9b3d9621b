"""Every measure on logs made by hand: one person, one robot whose tip goes to and fro on a line."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from hri_predict.base.geometry import Capsules
from hri_predict.contracts.cell import ControllerReport
from hri_predict.protocol.messages import Level
from hri_sim.simulation.course import Course
from hri_sim.simulation.episode import Log
from hri_sim.simulation.results.outcome import HORIZON_S, NEAR_M, Truth, outcome
from hri_sim.simulation.scenario import Scenario

RATE = 10.0  # ticks per second
CLEAR, SLOW, STOP, UNKNOWN = Level.CLEAR, Level.SLOW, Level.STOP, Level.UNKNOWN
SCENARIO = Scenario(
    index=7,
    motions=("a",),
    places=((0.0, 0.0, 0.0),),
    lead_in_s=1.0,
    start=0,
    phase_s=0.0,
    link_seed=0,
)


class Slider:
    """A ball of 0.1 m that is q metres along x."""

    name = "arm"

    def capsules(self, q):
        at = np.concatenate([q, np.zeros((*q.shape[:-1], 2))], axis=-1)[..., None, :]
        return Capsules(at, at, np.full(at.shape[:-1], 0.1))


class Line:
    """1 m/s along x, for 4 s, over and over."""

    duration_s = 4.0

    def at(self, t_s):
        return (np.asarray(t_s) % 4.0)[..., None], None


CELL: Any = SimpleNamespace(models=(Slider(),), trajectories=(Line(),))


def log(path_s, levels, events=(), **more):
    """A log at 10 Hz; somebody is there from 1 s on."""
    times = np.arange(len(path_s)) / RATE
    here = {1: (np.zeros((21, 3)), np.zeros(21, dtype=bool))}
    report = ControllerReport(name="drive", role="drive", robot="arm", events=list(events))
    return Log(
        times_s=times.tolist(),
        course=Course(people=[here if t >= 1.0 else {} for t in times]),
        q={"arm": [np.array([p % 4.0]) for p in path_s]},
        path_s={"arm": list(path_s)},
        levels=[(level,) for level in levels],
        controllers=[report],
        **more,
    )


def truth(body_x, first_touch=None):
    """A ball of 0.1 m at x, tick by tick; infinitely far where it is ``None``."""
    there = np.array([x is not None for x in body_x])[:, None]
    at = np.array([[[0.0 if x is None else x, 0.0, 0.0]] for x in body_x])
    radius = np.full((len(body_x), 1), 0.1)
    return Truth(
        Capsules(at, at, radius), there, {} if first_touch is None else {"arm": first_touch}
    )


FREE = [k / RATE for k in range(41)]  # full speed for 4 s
FAR = truth([None] * 10 + [9.0] * 31)


def test_work_is_counted_while_somebody_is_there_against_the_empty_cell():
    # 4 s in all, somebody from 1 s on. Half speed from then on: 1.5 s of path, 3 s alone; / 4 s.
    slowed = FREE[:11] + [1.0 + 0.05 * k for k in range(1, 31)]
    found = outcome(
        cell=CELL,
        scenario=SCENARIO,
        log=log(slowed, [CLEAR] * 41),
        alone=log(FREE, [CLEAR] * 41),
        truth=FAR,
    )
    assert found.seconds == pytest.approx(3.0)
    assert found.cycles == pytest.approx(1.5 / 4)
    assert found.cycles_empty == pytest.approx(3.0 / 4)


def test_a_stop_for_nobody_is_false_and_one_for_somebody_in_the_way_is_not():
    stopped = FREE[:21] + [2.0] * 20
    stop = [(2.0, "stop", 0.0)]
    alone = log(FREE, [CLEAR] * 41)
    # going on from 2 m at 2 s, the ball comes to 3 m at 3 s
    for body_m, false in ((9.0, 1), (3.0 + 0.2 + NEAR_M + 0.01, 1), (3.0 + 0.2 + NEAR_M - 0.01, 0)):
        near = truth([None] * 10 + [body_m] * 31)
        found = outcome(
            cell=CELL,
            scenario=SCENARIO,
            log=log(stopped, [CLEAR] * 41, stop),
            alone=alone,
            truth=near,
        )
        assert (found.stops, found.judged_stops, found.false_stops) == (1, 1, false)


def test_somebody_who_comes_after_the_horizon_does_not_make_a_stop_right():
    body = [None] * 10 + [9.0] * 22 + [2.0] * 9  # at the robot from 3.2 s on
    stop = [(2.0, "stop", 0.0)]
    found = outcome(
        cell=CELL,
        scenario=SCENARIO,
        log=log(FREE, [CLEAR] * 41, stop),
        alone=log(FREE, [CLEAR] * 41),
        truth=truth(body),
    )
    assert found.false_stops == 1


def test_stops_of_the_wire_and_of_the_last_second_are_kept_apart():
    events = [
        (0.5, "stop", 0.0),  # before anybody came
        (1.2, "silent", 0.0),
        (1.4, "slow", 0.3),  # no stop
        (2.0, "unknown", 0.0),
        (3.5, "stop", 0.0),  # what came after 4 s is not recorded
    ]
    levels = [CLEAR] * 41
    found = outcome(
        cell=CELL,
        scenario=SCENARIO,
        log=log(FREE, levels, events),
        alone=log(FREE, levels),
        truth=FAR,
    )
    assert (found.stops, found.wire_stops, found.judged_stops) == (2, 1, 1)
    assert found.judged_s == pytest.approx(3.0 - HORIZON_S)


def test_lead_time_counts_from_where_the_advice_last_became_severe():
    # touched at tick 30; severe at 12..14, mild again, severe from 18 on: 1.2 s before
    levels = [CLEAR] * 12 + [SLOW] * 3 + [CLEAR] * 3 + [SLOW] * 2 + [STOP] * 21
    found = outcome(
        cell=CELL,
        scenario=SCENARIO,
        log=log(FREE, levels),
        alone=log(FREE, levels),
        truth=truth([None] * 10 + [9.0] * 31, 30),
    )
    assert (found.touches, found.missed) == (1, 0)
    assert found.lead_s == [pytest.approx(1.2)]


@pytest.mark.parametrize("level", [CLEAR, Level.WARN])
def test_a_touch_before_which_the_advice_was_mild_is_missed(level):
    levels = [UNKNOWN] * 5 + [level] * 26 + [STOP] * 10
    found = outcome(
        cell=CELL,
        scenario=SCENARIO,
        log=log(FREE, levels),
        alone=log(FREE, levels),
        truth=truth([None] * 10 + [9.0] * 31, 30),
    )
    assert (found.touches, found.missed, found.lead_s) == (1, 1, [])


def test_no_touch_is_neither_missed_nor_foreseen():
    found = outcome(
        cell=CELL,
        scenario=SCENARIO,
        log=log(FREE, [STOP] * 41),
        alone=log(FREE, [CLEAR] * 41),
        truth=FAR,
    )
    assert (found.touches, found.missed, found.lead_s) == (0, 0, [])


def test_the_referees_figures_are_passed_on():
    judged = {
        "contacts": 2,
        "contacts_standing": 1,
        "min_separation_m": -0.1,
        "moving_separation_m": 0.3,
    }
    judged |= {"violation_s": 0.4, "violation_m": 0.2}
    levels = [CLEAR] * 41
    found = outcome(
        cell=CELL,
        scenario=SCENARIO,
        log=log(FREE, levels, **judged),
        alone=log(FREE, levels),
        truth=FAR,
    )
    assert {key: getattr(found, key) for key in judged} == judged
