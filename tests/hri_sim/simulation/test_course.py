"""The referee of a course that is over comes to what it comes to tick by tick."""

import copy

import numpy as np
import pytest

from hri_predict.base.skeleton import CANONICAL
from hri_sim.referee import Contact, Referee, TruePeople
from hri_sim.simulation.course import Course, CourseReferee, SharedTruth

STEP_NS = 40_000_000
JOINTS = len(CANONICAL.joints)


def course(cell, ticks=60, seed=0):
    """People who come, touch the arm, lose joints and go; an arm that moves, stands and moves."""
    rng = np.random.default_rng(seed)
    made, model, trajectory = Course(), cell.models[0], cell.trajectories[0]
    phase = 0.0
    for k in range(ticks):
        rate = 0.0 if 20 <= k < 35 else 1.0
        phase += rate * 0.04
        q, qd = trajectory.at_phase(phase, rate)
        people = {}
        for person, (first, last, off) in {1: (5, 50, 0.0), 2: (25, 58, 1.5)}.items():
            if first <= k < last:
                capsules = model.capsules(q)
                at = capsules.b[-1] + [2.5 - 0.08 * k + off, 0.0, 0.0]
                joints = at + 0.3 * np.sin(np.arange(JOINTS * 3)).reshape(JOINTS, 3)
                people[person] = joints, rng.random(JOINTS) < 0.9
        made.stamps_ns.append(STEP_NS * k + (7_000_000 if k == 40 else 0))  # one comes late
        made.people.append(people)
        made.robots.append({model.name: (q, qd)})
        made.tools.append({model.name: None})
    return made


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("tells", [False, True])
def test_a_course_is_judged_as_tick_by_tick(cell, seed, tells):
    made = course(cell, seed=seed)
    told: tuple[list[Contact], list[Contact]] = ([], [])
    slow = Referee(cell.models, 0.3, None, told[0].append if tells else None)
    for stamp, people, robots in zip(made.stamps_ns, made.people, made.robots, strict=True):
        slow.observe(stamp, people, robots)
    fast = CourseReferee(cell.models, 0.3, None, told[1].append if tells else None)
    fast.judge(made)
    assert slow.contacts + slow.contacts_standing > 0  # it is a course that tells something
    assert slow.violation_s > 0
    assert (fast.contacts, fast.contacts_standing) == (slow.contacts, slow.contacts_standing)
    assert fast.observations == slow.observations
    # distances of some metres: a rounding of 1e-15 m, times the operations of a distance
    for name in ("min_separation_m", "moving_separation_m", "violation_s", "violation_m"):
        assert getattr(fast, name) == pytest.approx(getattr(slow, name), abs=1e-12)
    assert len(told[0]) == len(told[1])
    assert tells == bool(told[0])


def test_time_too_near_two_robots_counts_once(cell):
    alone, both = course(cell), course(cell)
    twin = copy.copy(cell.models[0])
    twin.name = "twin"
    for robots, tools in zip(both.robots, both.tools, strict=True):
        robots["twin"], tools["twin"] = robots[cell.models[0].name], None
    one, two = CourseReferee(cell.models, 0.3), CourseReferee([*cell.models, twin], 0.3)
    one.judge(alone)
    two.judge(both)
    assert two.violation_s == pytest.approx(one.violation_s)
    assert one.violation_s > 0


def test_runs_hold_every_tick_once_and_never_a_change(cell):
    made = course(cell)
    runs = list(made.runs())
    assert [k for run in runs for k in run] == list(range(60))
    assert max(map(len, runs)) > 5
    for run in runs:
        assert len({frozenset(made.people[k]) for k in run}) == 1
    assert range(40, 41) in runs  # the late one


class Counting(TruePeople):
    def __init__(self):
        self.asked, self.opened = [], 0

    def open(self, start_ns):
        self.opened += 1

    def at(self, now_ns):
        self.asked.append(now_ns)
        return {}


def test_the_truth_is_computed_once_for_all_episodes():
    counting = Counting()
    shared = SharedTruth(counting)
    for _ in range(3):
        shared.open(0)
        for now_ns in (0, 1, 2):
            assert shared.at(now_ns) == {}
    assert (counting.opened, counting.asked) == (1, [0, 1, 2])
