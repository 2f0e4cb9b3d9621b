"""The referee: touches counted once, as what they are, by real radii."""

import numpy as np
import pytest

from hri_predict.base.geometry import Capsules
from hri_predict.base.settings import validated
from hri_predict.base.skeleton import CANONICAL
from hri_predict.contracts.joint_map import load_joint_map
from hri_predict.contracts.scene import Person, Scene
from hri_sim.people.procedural import ProceduralSettings, ProceduralSource
from hri_sim.referee import KnownPeople, KnowsTruth, Referee, TruePeople

MS = 1_000_000
BALL = 0.1
FOREARM = next(s for s in CANONICAL.segments if s.name == "l_forearm")
HEAD = next(s for s in CANONICAL.segments if s.name == "head")


class Ball:
    """A robot that is a ball of 0.1 m on the x axis, at its one joint's value."""

    name = "ball"

    def __init__(self, radius=BALL):
        self.radius = radius

    def capsules(self, q):
        centre = np.concatenate([q, np.zeros((*q.shape[:-1], 2))], axis=-1)[..., None, :]
        return Capsules(centre, centre, np.full(centre.shape[:-1], self.radius))

    def counting(self, tool):
        return self if tool is None else Ball(tool / 10)

    def tip_speed(self, q, qd):
        return np.abs(qd[..., 0])


def referee_of_ball(clearance_m=0.0):
    return Referee([Ball()], clearance_m)  # type: ignore[list-item]  # all that it asks of a robot model


def test_the_tool_that_is_mounted_counts():
    tool = None
    referee = Referee([Ball()], tool_of=lambda _: tool)  # type: ignore[list-item]
    near = {1: forearm(TOUCH + 0.1)}
    referee.observe(0, near, ball(0.0, 1.0))
    assert referee.contacts == 0
    tool = 3  # 0.2 m thicker
    referee.observe(40 * MS, near, ball(0.0, 1.0))
    assert referee.contacts == 1


def joints(**at):
    positions = np.full((len(CANONICAL.joints), 3), np.nan)
    for name, where in at.items():
        positions[CANONICAL.index(name)] = where
    return positions, np.isfinite(positions).all(axis=1)


def forearm(x):
    """A forearm along y, beside the ball's axis, its axis at x."""
    return joints(l_elbow=[x, -0.2, 0], l_wrist=[x, 0.2, 0])


def ball(x, speed=0.0):
    return {"ball": (np.array([x]), np.array([speed]))}


TOUCH = FOREARM.radius + BALL


def test_separation_is_that_of_the_real_surfaces():
    referee = referee_of_ball()
    assert referee.min_separation_m is None
    referee.observe(0, {1: forearm(2.0)}, ball(0.0))
    assert referee.min_separation_m == pytest.approx(2.0 - TOUCH)
    referee.observe(40 * MS, {1: forearm(1.0)}, ball(0.0))
    referee.observe(80 * MS, {1: forearm(3.0)}, ball(0.0))
    assert referee.min_separation_m == pytest.approx(1.0 - TOUCH)
    assert (referee.contacts, referee.contacts_standing) == (0, 0)


def test_a_touch_of_the_moving_robot_counts_once_however_long():
    referee = referee_of_ball()
    for k in range(100):
        referee.observe(k * 10 * MS, {1: forearm(TOUCH - 0.01)}, ball(0.0, 0.5))
    assert (referee.contacts, referee.contacts_standing) == (1, 0)


def test_a_touch_of_the_standing_robot_is_counted_apart():
    referee = referee_of_ball()
    for k in range(10):
        referee.observe(k * 10 * MS, {1: forearm(TOUCH - 0.01)}, ball(0.0, 0.010))
    assert (referee.contacts, referee.contacts_standing) == (0, 1)


def test_a_robot_that_starts_while_touched_makes_it_a_contact():
    referee = referee_of_ball()
    speeds = [0, 0, 0, 0.2, 0.2, 0, 0, 0.2]
    for k, speed in enumerate(speeds):
        referee.observe(k * 10 * MS, {1: forearm(TOUCH - 0.01)}, ball(0.0, speed))
    assert (referee.contacts, referee.contacts_standing) == (1, 0)


def test_a_touch_ends_only_when_it_is_clearly_over():
    referee = referee_of_ball()
    for k, gap in enumerate([-0.001, 0.001, -0.001, 0.01, -0.001, 0.5, -0.001]):
        referee.observe(k * 10 * MS, {1: forearm(TOUCH + gap)}, ball(0.0, 1.0))
    assert referee.contacts == 2


def test_every_person_counts():
    referee = referee_of_ball()
    near = forearm(TOUCH - 0.01)
    referee.observe(0, {1: near, 2: near, 3: forearm(5.0)}, ball(0.0, 1.0))
    assert referee.contacts == 2


def test_a_touch_between_two_observations_is_seen():
    # the ball passes through the arm within one cycle of the node: 100 mm a millisecond step
    referee = referee_of_ball()
    referee.observe(0, {1: forearm(0.0)}, ball(-1.0, 20.0))
    referee.observe(100 * MS, {1: forearm(0.0)}, ball(1.0, 20.0))
    assert referee.contacts == 1
    assert referee.min_separation_m == pytest.approx(-TOUCH)
    # and so when the person passes through the robot
    referee = referee_of_ball()
    referee.observe(0, {1: forearm(-1.0)}, ball(0.0))
    referee.observe(100 * MS, {1: forearm(1.0)}, ball(0.0))
    assert referee.contacts_standing == 1


def test_nothing_is_invented_across_a_long_gap_or_for_somebody_new():
    referee = referee_of_ball()
    referee.observe(0, {1: forearm(-1.0)}, ball(0.0))
    referee.observe(5000 * MS, {1: forearm(1.0)}, ball(0.0))
    referee.observe(5040 * MS, {2: forearm(-1.0)}, ball(0.0))
    assert referee.contacts_standing == 0
    assert referee.min_separation_m == pytest.approx(1.0 - TOUCH)


def test_unobserved_joints_are_skipped_and_lone_ones_are_balls():
    referee = referee_of_ball()
    positions, observed = joints(l_wrist=[1.0, 0, 0])
    referee.observe(0, {1: (positions, observed)}, ball(0.0))
    thinnest = min(
        s.radius for s in CANONICAL.segments if CANONICAL.index("l_wrist") in (s.joint_a, s.joint_b)
    )
    assert referee.min_separation_m == pytest.approx(1.0 - BALL - thinnest)
    # a position that is there but not known does not count, nor does NaN that claims to be known
    referee = referee_of_ball()
    positions, observed = forearm(0.0)
    referee.observe(0, {1: (positions, np.zeros_like(observed))}, ball(0.0))
    referee.observe(0, {1: (np.full_like(positions, np.nan), observed)}, ball(0.0))
    assert referee.min_separation_m is None


def test_the_head_is_a_capsule_and_its_centre_adds_nothing():
    referee = referee_of_ball()
    head = joints(neck=[0.5, 0, 0], head_top=[0.5, 0, 0.3], head=[0.5, 0, 0.2])
    referee.observe(0, {1: head}, ball(0.0))
    assert referee.min_separation_m == pytest.approx(0.5 - BALL - HEAD.radius)


def test_it_agrees_with_sampling_by_brute_force():
    rng = np.random.default_rng(5)
    for _ in range(20):
        positions = rng.uniform([1.5, -1, -1], [3.5, 1, 1], (len(CANONICAL.joints), 3))
        referee = referee_of_ball()
        referee.observe(0, {1: (positions, np.ones(len(positions), bool))}, ball(0.0))
        along = np.linspace(0, 1, 2001)[:, None]
        expected = min(
            np.linalg.norm(
                positions[s.joint_a] * (1 - along) + positions[s.joint_b] * along, axis=1
            ).min()
            - s.radius
            for s in CANONICAL.segments
        )
        assert referee.min_separation_m == pytest.approx(expected - BALL, abs=1e-3)


class Walker:
    """Scene k at k x 40 ms: the left wrist at x = k, and its owner leaves after scene 50."""

    joint_map = load_joint_map("canonical")
    rate_hz = 25.0
    declares_noise = False

    def open(self, start_ns):
        self.k = 0

    def next_ns(self):
        return self.k * 40 * MS

    def poll(self, now_ns):
        k = self.k
        if k > 60 or k * 40 * MS > now_ns:
            return None
        self.k += 1
        positions, observed = joints(l_wrist=[k, 0, 0])
        people = (Person(7, positions, observed),) if k <= 50 else ()
        return Scene(k * 40 * MS, k, True, people)

    def close(self):
        pass


def test_true_people_are_interpolated_between_scenes():
    truth = TruePeople(Walker())
    truth.open(0)
    wrist = CANONICAL.index("l_wrist")
    for now_ms in (0, 10, 40, 45, 1990):
        people = truth.at(now_ms * MS)
        positions, observed = people[7]
        assert positions[wrist, 0] == pytest.approx(now_ms / 40)
        assert list(np.flatnonzero(observed)) == [wrist]
    assert truth.at(2035 * MS)[7][0][wrist, 0] == 50  # about to leave: held until the next scene
    assert truth.at(2040 * MS) == {}


def test_a_violation_is_time_and_depth_of_moving_too_near():
    referee = referee_of_ball(clearance_m=0.3)
    here = {1: forearm(1.0)}
    gap = 1.0 - TOUCH
    referee.observe(0, here, ball(gap - 0.4, 0.5))
    referee.observe(200 * MS, here, ball(gap - 0.2, 0.5))  # from half way on nearer than 0.3 m
    assert referee.violation_s == pytest.approx(0.1, abs=0.011)
    assert referee.violation_m == pytest.approx(0.1)
    assert referee.moving_separation_m == pytest.approx(0.2)
    assert referee.contacts == 0
    referee.observe(240 * MS, here, ball(gap - 0.2, 0.0))  # interpolated: it comes to rest
    before = referee.violation_s
    referee.observe(640 * MS, here, ball(gap - 0.2, 0.0))  # standing is no violation
    referee.observe(680 * MS, {1: forearm(0.9)}, ball(gap - 0.2, 0.0))
    assert referee.violation_s == before
    assert referee.moving_separation_m == pytest.approx(0.2)
    assert referee.min_separation_m == pytest.approx(0.1)


class Other(Ball):
    """Another robot of the same kind."""

    name = "other"


def test_time_too_near_two_robots_counts_once():
    referee = Referee([Ball(), Other()], 0.3)  # type: ignore[list-item]
    here, gap = {1: forearm(1.0)}, 1.0 - TOUCH
    state = np.array([gap - 0.2]), np.array([0.5])
    for k in range(6):
        referee.observe(40 * k * MS, here, {"ball": state, "other": state})
    assert referee.violation_s == pytest.approx(0.2)
    far = np.array([gap - 2.0]), np.array([0.5])
    referee = Referee([Ball(), Other()], 0.3)  # type: ignore[list-item]
    referee.observe(0, here, {"ball": state, "other": far})
    referee.observe(200 * MS, here, {"ball": far, "other": state})  # one after the other
    apart_s = referee.violation_s
    referee = Referee([Ball(), Other()], 0.3)  # type: ignore[list-item]
    referee.observe(0, here, {"ball": state, "other": far})
    referee.observe(200 * MS, here, {"ball": far, "other": far})
    assert apart_s == pytest.approx(2 * referee.violation_s, abs=0.011)
    assert referee.violation_s > 0


def test_a_source_that_knows_the_truth_is_asked_for_it():
    settings = {"kind": "procedural", "noise_m": 0.05, "joint_map": "coco17"}
    source = ProceduralSource(validated(ProceduralSettings, settings, "source"))
    assert isinstance(source, KnowsTruth)
    assert not isinstance(Walker(), KnowsTruth)
    people = KnownPeople(source)
    people.open(0)
    positions, known = people.at(2000 * MS)[1]
    np.testing.assert_array_equal(positions, source.truth(2000 * MS)[1][0])
    assert known.all()  # also what the tracker does not deliver
