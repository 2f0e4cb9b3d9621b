"""The echo: however late advice is, and however its delay came about, it moves the robot never.

A small node that answers every RobotState is played at the other end; time is stepped in
milliseconds.
"""

from collections import deque
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from hri_drivers.links.can.link import CanCodec, CanLinkSettings
from hri_drivers.links.framed import SerialCodec
from hri_predict.protocol.definition import SCHEMA_HASH, SCHEMA_VERSION
from hri_predict.protocol.messages import Level, Schema
from hri_sim.controllers.controller import ControllerCore, ControllerSettings
from tests.messages import make_advice

MS = 1_000_000
GOOD = make_advice(Level.CLEAR, speed_limit_m_s=1.0, echo=0, age_s=0.04)
SCHEMA = Schema(SCHEMA_VERSION, SCHEMA_HASH)
MAX_AGE_MS, SILENCE_MS = 400, 150  # max_age_s, silence_timeout_s


def make_codec(kind):
    if kind == "serial":
        return SerialCodec(115200)
    return CanCodec(
        CanLinkSettings(name="x", interface="virtual", channel="x", fd=kind == "can_fd")
    )


class Pair:
    """A controller and a played node: clear every 40 ms, schema every second, ever later."""

    def __init__(self, kind="serial", state_rate_hz=50.0):
        settings = ControllerSettings(
            reaction_s=0.05, silence_timeout_s=SILENCE_MS / 1e3, state_rate_hz=state_rate_hz
        )
        self.core = ControllerCore(
            name="link", settings=settings, robot=0, codec=make_codec(kind), full_speed_m_s=1.0
        )
        self.node = make_codec(kind)
        self.ms = 0
        self.echo = None
        self.under_way: deque = deque()  # when due, units
        self.moving = []  # when it was allowed to

    def run(self, ms, delay_ms=lambda ms: 0.0, answer_ms=lambda ms: 0.0):
        """Delay what the node sends by ``delay_ms``, what it hears by ``answer_ms``."""
        heard: deque = deque()
        for _ in range(ms):
            now_ns = self.ms * MS
            while heard and heard[0][0] <= self.ms:
                self.echo = heard.popleft()[1]
            units = self.node.encode(SCHEMA) if self.ms % 1000 == 0 else []
            if self.ms % 40 == 0:
                units += self.node.encode(replace(GOOD, echo=self.echo))
            self._later(self.under_way, delay_ms, units)
            while self.under_way and self.under_way[0][0] <= self.ms:
                self.core.receive(self.under_way.popleft()[1], now_ns)
            permit = self.core.permit(now_ns)
            self.core.obey(permit, now_ns)
            if permit.speed_m_s > 0:
                self.moving.append(self.ms)
            q = np.zeros(6)
            for unit in self.core.outgoing(now_ns, q, q):
                for message in self.node.decode(unit):
                    self._later(heard, answer_ms, message.counter)
            self.ms += 1
        self.cause = permit.cause
        return self

    def _later(self, queue, delay_ms, what):
        due = self.ms + delay_ms(self.ms)
        queue.append((max(due, queue[-1][0]) if queue else due, what))


def running(kind="serial"):
    pair = Pair(kind).run(1500)
    assert pair.moving[-1] == pair.ms - 1
    return pair


@pytest.mark.parametrize("kind", ["serial", "can", "can_fd"])
@pytest.mark.parametrize("delay_s", [0.6, 5.1, 5.13, 5.2, 5.3, 10.24, 21.0])
def test_advice_that_is_late_by_any_time_never_moves_it(kind, delay_s):
    # among them what a counter of 8 bits would take for fresh at 50 Hz, and one of 10 bits
    pair = running(kind)
    at = pair.ms
    pair.run(round(delay_s * 1e3) + 3000, delay_ms=lambda ms: delay_s * 1e3)
    assert pair.core.report().messages > 90  # the late ones did come
    assert pair.moving[-1] < at + SILENCE_MS
    assert pair.cause == "no age"


@pytest.mark.parametrize("delay_s", [0.6, 5.1, 5.2, 10.24])
def test_advice_that_rests_on_an_old_robot_state_never_moves_it(delay_s):
    # the node hears late where the robot was, and takes it for fresh
    pair = running()
    at = pair.ms
    pair.run(round(delay_s * 1e3) + 3000, answer_ms=lambda ms: delay_s * 1e3)
    assert pair.moving[-1] < at + MAX_AGE_MS
    assert pair.cause == "no age"


@pytest.mark.parametrize("rate", [0.05, 0.5])
def test_a_delay_that_grows_past_an_8_bit_counter_never_moves_it_on_old_advice(rate):
    pair = running()
    at = pair.ms
    pair.run(round(5600 * (1 + 1 / rate)), delay_ms=lambda ms: rate * (ms - at))
    # what has come by then was sent at / (1 + rate), and 40 ms old already
    assert (pair.moving[-1] - at) * rate / (1 + rate) <= MAX_AGE_MS - 40
    assert pair.core.report().timeouts == 0  # there was no silence that would have stopped it
    assert set(pair.core.report().stop_causes) <= {"stale", "starting"}


@pytest.mark.parametrize("kind", ["serial", pytest.param("can", marks=pytest.mark.long)])
def test_a_counter_that_wraps_is_no_event(kind):
    pair = Pair(kind, state_rate_hz=1000.0)
    pair.run(67_000)
    assert pair.core.report().stops == 0
    assert pair.moving[-1] == pair.ms - 1
    assert pair.core.report().states_sent == 67_000


@pytest.mark.parametrize("rate_hz", [25.0, 50.0, 500.0])
@pytest.mark.parametrize(
    ("back_s", "cause"),
    [(0.0, "clear"), (0.25, "clear"), (0.65, "no age"), (5.12, "no age"), (-0.04, "no age")],
)
def test_only_echoes_of_the_newest_states_are_believed(rate_hz, back_s, cause):
    """As many as max_age_s and the silence time-out hold; the counter wraps in between."""
    pair = Pair(state_rate_hz=rate_hz)
    period_ns = round(1e9 / rate_hz)
    now_ns = 65536 * period_ns - 100 * MS  # the counter begins by the clock
    counters = []
    for _ in range(round(0.2 * rate_hz)):
        units = pair.core.outgoing(now_ns, np.zeros(6), np.zeros(6))
        counters += [m.counter for unit in units for m in pair.node.decode(unit)]
        now_ns += period_ns
    steps = [(after - before) % 65536 for before, after in pairwise(counters)]
    assert set(steps) == {1}
    assert max(counters) > 65530
    assert counters[-1] < rate_hz
    for _ in range(round(1.0 * rate_hz)):
        units = pair.core.outgoing(now_ns, np.zeros(6), np.zeros(6))
        counters += [m.counter for unit in units for m in pair.node.decode(unit)]
        now_ns += period_ns
    advice = replace(GOOD, echo=(counters[-1] - round(back_s * rate_hz)) % 65536)
    pair.core.receive(pair.node.encode(SCHEMA) + pair.node.encode(advice), now_ns)
    assert pair.core.permit(now_ns + 50 * MS).cause == cause


def test_what_answers_a_life_before_this_one_is_not_believed():
    lives = []
    for start_ns in (10_000 * MS, 15_200 * MS):  # the controller restarts after 5.2 s
        pair = Pair()
        units = pair.core.outgoing(start_ns, np.zeros(6), np.zeros(6))
        lives += [m.counter for unit in units for m in pair.node.decode(unit)]
    assert (lives[1] - lives[0]) * 20 == 5200
    advice = replace(GOOD, echo=lives[0])
    pair.core.receive(pair.node.encode(SCHEMA) + pair.node.encode(advice), start_ns + 20 * MS)
    assert pair.core.permit(start_ns + 80 * MS).cause == "no age"
