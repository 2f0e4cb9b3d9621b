"""A test may take permission away, and never give any."""

from typing import Any

from hypothesis import given
from hypothesis import strategies as st

from hri_predict.commissioning.governed_link import GovernedLink, lowered
from hri_predict.contracts.link import LinkCounters, Received
from hri_predict.protocol.messages import Advice, Level, RobotMode, RobotState
from hri_predict.protocol.reasons import Reason
from tests.messages import make_status

MOVING = (Level.CLEAR, Level.WARN, Level.SLOW)
speeds = st.floats(0, 20) | st.just(float("nan"))


def permitted(advice: Advice) -> float:
    """What a careful controller takes out of an advice, m/s."""
    return (advice.speed_limit_m_s or 0.0) if advice.level in MOVING else 0.0


@given(st.sampled_from(Level), st.none() | st.floats(0, 20), speeds)
def test_no_advice_ever_permits_more_than_the_node_or_than_the_test(level, granted, limit):
    node = Advice(robot=0, level=level, reason=Reason.NONE, speed_limit_m_s=granted)
    told = lowered(node, limit)
    assert permitted(told) <= permitted(node)
    assert permitted(told) <= (limit if limit > 0 else 0.0)
    if level not in MOVING:
        assert told == node


class Fake:
    name, connected, last_error, foreign_ns = "plc", True, "trouble", 7
    on_sent = None

    def __init__(self):
        self.counters, self.posted, self.done = LinkCounters(), [], []

    def post(self, message):
        self.posted.append(message)

    def take(self):
        return [Received(state(0), 1), Received(state(1), 2)]

    def start(self):
        self.done.append("start")

    def service(self, now_ns):
        self.done.append(now_ns)

    def stop(self):
        self.done.append("stop")


def state(robot):
    return RobotState(robot=robot, mode=RobotMode.AUTOMATIC, counter=1, positions=(), velocities=())


def test_it_is_a_link_for_its_own_robots_alone():
    fake: Any = Fake()
    link = GovernedLink(fake, [1], lambda robot: 0.5)
    clear = Advice(robot=1, level=Level.CLEAR, reason=Reason.NONE, speed_limit_m_s=1.0)
    status = make_status()
    link.post(clear)
    link.post(Advice(robot=0, level=Level.CLEAR, reason=Reason.NONE, speed_limit_m_s=1.0))
    link.post(status)
    first, last = fake.posted
    assert (first.level, first.speed_limit_m_s, last) == (Level.SLOW, 0.5, status)
    assert [received.message for received in link.take()] == [state(1)]
    link.start()
    link.service(3)
    link.stop()
    assert fake.done == ["start", 3, "stop"]
    assert (link.name, link.connected, link.last_error, link.foreign_ns) == (
        "plc", True, "trouble", 7,
    )  # fmt: skip
    link.on_sent = print
    assert fake.on_sent is link.on_sent is print
    assert link.counters is fake.counters
