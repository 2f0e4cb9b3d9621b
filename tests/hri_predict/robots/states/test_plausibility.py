"""States that contradict each other are found; jitter, losses and late wires are not mistaken."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hri_predict.protocol.reasons import Reason
from hri_predict.robots.states.frozen import COUNTERS
from hri_predict.robots.states.plausibility import HELD_S, StateCheck

JOINTS = 6
FASTEST = np.full(JOINTS, math.pi)
PERIOD_S = 0.02


class Motion:
    """Six joints that swing smoothly, each as three sines; at most about 2.5 rad/s."""

    def __init__(self, seed, size):
        rng = np.random.default_rng(seed)
        self.turns = 2 * np.pi * rng.uniform(0.05, 1.2, (JOINTS, 3))
        self.phase = rng.uniform(0, 2 * np.pi, (JOINTS, 3))
        self.most = size * rng.uniform(0.2, 0.8, (JOINTS, 3))

    def at(self, t):
        angle = self.turns * t + self.phase
        q = (self.most / self.turns * np.sin(angle)).sum(1)
        return q, (self.most * np.cos(angle)).sum(1)


class Wire:
    """States as the node receives them: rounded, late, with jitter, losses, in bunches."""

    def __init__(self, seed, jitter_s=0.0, loss=0.0, bunch_s=0.0, late_s=0.1, counter=0):
        self.rng = np.random.default_rng(seed)
        self.jitter_s, self.loss, self.bunch_s, self.late_s = jitter_s, loss, bunch_s, late_s
        self.counter = counter
        self.check = StateCheck(FASTEST)
        self.newest = 0.0

    def send(self, motion, start_s, seconds, lie=lambda q, qd: (q, qd)):
        """Yield the time of each sample that arrives, and what is found then."""
        for k in range(round(start_s / PERIOD_S), round((start_s + seconds) / PERIOD_S)):
            t = k * PERIOD_S
            if self.rng.random() < self.loss:
                continue
            arrives = t + self.late_s + self.rng.uniform(0, self.jitter_s)
            if self.bunch_s:
                arrives = math.ceil(arrives / self.bunch_s) * self.bunch_s
            self.newest = max(self.newest, arrives)
            q, qd = lie(*motion.at(t))
            q, qd = np.round(q * 4000) / 4000, np.round(qd * 1000) / 1000
            received_ns = round(self.newest * 1e9)
            counter = (self.counter + k) % COUNTERS
            self.check.take(counter, tuple(q.tolist()), tuple(qd.tolist()), received_ns)
            yield t, self.check.reason(received_ns)


wires = st.fixed_dictionaries(
    {
        "seed": st.integers(0, 10_000),
        "jitter_s": st.floats(0, 0.08),
        "loss": st.floats(0, 0.3),
        "bunch_s": st.sampled_from([0.0, 0.01, 0.04, 0.1]),
        "late_s": st.floats(0, 0.3),
        "counter": st.integers(0, COUNTERS - 1),
    }
)


@given(wires, st.integers(0, 10_000), st.floats(0, 1))
def test_what_is_true_is_believed_on_any_wire(wire, seed, size):
    assert {found for _, found in Wire(**wire).send(Motion(seed, size), 0.0, 6.0)} == {None}


LIES = {
    "flip": lambda q, qd: (q, -qd),
    "zero": lambda q, qd: (q, 0 * qd),
    "degrees": lambda q, qd: (q, np.rad2deg(qd)),
    "one joint": lambda q, qd: (q, qd * np.array([-1, 1, 1, 1, 1, 1])),
}
WIRES = {
    "even": {},
    "late, lossy, in bunches": {"jitter_s": 0.01, "loss": 0.05, "bunch_s": 0.04},
}


@pytest.mark.parametrize("wire", WIRES.values(), ids=WIRES)
@pytest.mark.parametrize("lie", LIES.values(), ids=LIES)
@given(st.integers(0, 10_000))
@settings(max_examples=20)
def test_each_lie_is_found_within_0_3_s_of_motion(wire, lie, seed):
    """The time counts while the first joint, which always lies, moves at more than 0.2 rad/s."""
    motion, line = Motion(seed, 0.8), Wire(seed, **wire)
    assert all(found is None for _, found in line.send(motion, 0.0, 3.0))
    moved_s = 0.0
    for t, found in line.send(motion, 3.0, 8.0, lie):
        if found is not None:
            assert found is Reason.ROBOT_VELOCITY_WRONG
            return
        moved_s = moved_s + PERIOD_S if abs(motion.at(t)[1][0]) > 0.2 else 0.0
        assert moved_s <= 0.3


@given(st.integers(0, 10_000), st.floats(0.2, 1.0), st.sampled_from([-1.0, 1.0]))
def test_a_flipped_velocity_is_never_confirmed(seed, speed, sign):
    """From rest: nothing proves the direction before the lie is found."""
    line = Wire(seed, jitter_s=0.01, bunch_s=0.04)

    class Starts:
        def at(self, t):
            v = sign * speed * min(max(t - 2.0, 0.0) / 0.5, 1.0)
            way = sign * speed * (min(max(t - 2.0, 0.0), 0.5) ** 2 + max(t - 2.5, 0.0))
            return np.full(JOINTS, way), np.full(JOINTS, v)

    found = None
    for t, found in line.send(Starts(), 0.0, 2.5, LIES["flip"]):
        assert not line.check.confirmed
        if found is not None:
            assert t > 2.0
            break
    assert found is Reason.ROBOT_VELOCITY_WRONG


def test_a_robot_at_rest_proves_nothing_and_motion_does():
    line, motion = Wire(1), Motion(1, 0.8)

    class Rests:
        def at(self, _t):
            return np.zeros(JOINTS), np.zeros(JOINTS)

    for _ in line.send(Rests(), 0.0, 3.0):
        assert not line.check.confirmed
    moving = Wire(1)
    list(moving.send(motion, 0.0, 3.0))
    assert moving.check.confirmed


@given(st.integers(0, 10_000), st.floats(0.1, 3.0), st.integers(0, JOINTS - 1))
def test_a_jump_is_found_at_once_and_passes(seed, jump, joint):
    motion, line = Motion(seed, 0.5), Wire(seed, jitter_s=0.01)
    list(line.send(motion, 0.0, 2.0))
    off = np.zeros(JOINTS)
    off[joint] = jump
    found = [f for _, f in line.send(motion, 2.0, 0.04, lambda q, qd: (q + off, qd))]
    assert found[-1] is Reason.ROBOT_STATE_JUMPED
    held = [f for _, f in line.send(motion, 2.04, HELD_S + 1, lambda q, qd: (q + off, qd))]
    assert held[0] is Reason.ROBOT_STATE_JUMPED
    assert held[-1] is None


def test_an_emergency_stop_is_believed():
    class Stops:
        def at(self, t):
            braking = min(max(t - 2.0, 0.0), 0.08)
            way = 1.5 * min(t, 2.0) + 1.5 * (braking - braking**2 / 0.16)
            return np.full(JOINTS, way), np.full(JOINTS, 1.5 * (1 - braking / 0.08))

    for bunch_s in (0.0, 0.04):
        line = Wire(3, bunch_s=bunch_s)
        assert {found for _, found in line.send(Stops(), 0.0, 3.0)} == {None}


def test_too_slow_velocities_are_made_up_for():
    """What is too little for a finding is added to the velocity."""
    line, motion = Wire(4), Motion(4, 0.8)
    seen = []
    for t, found in line.send(motion, 0.0, 4.0, lambda q, qd: (q, 0.85 * qd)):
        assert found is None
        if line.check.unreported is not None:
            seen.append(np.sign(line.check.unreported) * np.sign(motion.at(t - 0.15)[1]))
    assert seen
    assert np.min(seen) >= 0


def test_a_sender_that_begins_anew_is_no_jump_of_its_counter():
    line, motion = Wire(5), Motion(5, 0.8)
    list(line.send(motion, 0.0, 2.0))
    line.counter = 30_000
    assert {found for _, found in line.send(motion, 2.0, 2.0)} == {None}


COUNTS = {
    "a timer of microseconds": lambda k: 20_000 * k,
    "downwards": lambda k: -k,
    "to and fro": lambda k: k % 2,
    "at random": lambda k: 7919 * k * k,
}


@pytest.mark.parametrize("count", COUNTS.values(), ids=COUNTS)
def test_a_counter_that_does_not_count_is_found(count):
    check, found = StateCheck(FASTEST), []
    for k in range(200):
        received_ns = round(k * PERIOD_S * 1e9)
        check.take(count(k) % COUNTERS, (0.004 * k,) * JOINTS, (0.0,) * JOINTS, received_ns)
        found.append(check.reason(received_ns))
    assert found[8] is Reason.ROBOT_STATE_INVALID
    assert set(found[8:]) == {Reason.ROBOT_STATE_INVALID}
    assert check.counters["miscounted"] > 0


@pytest.mark.parametrize("restarts", [1, 2])
def test_a_controller_may_restart(restarts):
    check, counter = StateCheck(FASTEST), 0
    for k in range(200):
        counter += 5000 if 50 <= k < 50 + restarts else 1
        received_ns = round(k * PERIOD_S * 1e9)
        check.take(counter % COUNTERS, (0.0,) * JOINTS, (0.0,) * JOINTS, received_ns)
        assert check.reason(received_ns) is None
