"""Repetitions of Status and Advice: how long, how often, and never instead of a newer message."""

from typing import Any

import pytest

from hri_predict.node.repeats import NEVER_NS, Repeats
from hri_predict.protocol.messages import (
    Advice,
    Level,
    NodeState,
    Schema,
    Status,
)
from hri_predict.protocol.reasons import Reason

MS = 1_000_000
STATUS = Status(node_state=NodeState.RUNNING, reason=Reason.NONE, people=0, predictor=0, cycle=3)
CLEAR = Advice(robot=0, level=Level.CLEAR, reason=Reason.NONE, speed_limit_m_s=1.0)
STOP = Advice(robot=0, level=Level.STOP, reason=Reason.PERSON_NEAR, speed_limit_m_s=0.0)


class Posted:
    def __init__(self) -> None:
        self.messages: list[Any] = []

    def post(self, message: Any) -> None:
        self.messages.append(message)


def running(*intervals_s: float, held_s: float = 0.06) -> tuple[Repeats, list[Any]]:
    links: list[Any] = [Posted() for _ in intervals_s]
    repeats = Repeats(links, intervals_s, held_s)
    repeats.post(0, [[CLEAR, STATUS, Schema(1, 2)] for _ in links])
    repeats.posted(0)
    return repeats, links


def repeated_at(repeats: Repeats, link: Any, until_ms: int) -> list[int]:
    """Milliseconds at which the link got an Advice again."""
    at = []
    for ms in range(until_ms):
        before = len(link.messages)
        repeats.repeat(ms * MS)
        if len(link.messages) > before:
            at.append(ms)
    return at


def test_status_and_advice_come_again_until_their_time_is_over():
    repeats, (link,) = running(0.015)
    assert repeated_at(repeats, link, 200) == [15, 30, 45]  # at 60 the delay budget's time ends
    assert link.messages == [CLEAR, STATUS, Schema(1, 2), *[CLEAR, STATUS] * 3]
    assert repeats.due_ns == NEVER_NS


def test_each_link_has_an_interval_of_its_own():
    repeats, links = running(0.01, float("inf"), 0.025)
    for ms in range(200):
        repeats.repeat(ms * MS)
    assert [link.messages.count(CLEAR) - 1 for link in links] == [5, 0, 2]


def test_after_the_next_tick_only_its_messages_come():
    repeats, (link,) = running(0.015)
    repeats.repeat(15 * MS)
    repeats.post(40 * MS, [[STOP, STATUS]])
    link.messages.clear()
    repeats.posted(48 * MS)  # this long the tick took
    assert repeated_at(repeats, link, 130) == [63, 78, 93]
    assert CLEAR not in link.messages


def test_the_time_counts_from_the_tick_and_not_from_its_late_messages():
    repeats, (link,) = running(0.015)
    repeats.post(40 * MS, [[STOP, STATUS]])
    repeats.posted(95 * MS)
    assert repeated_at(repeats, link, 200)[-1:] == []  # 40 + 60 ms end before 95 + 15


@pytest.mark.parametrize("intervals_s", [(), (float("inf"),)])
def test_nothing_is_repeated_where_no_interval_is_given(intervals_s):
    link: Any = Posted()
    repeats = Repeats([link], intervals_s, 0.06)
    repeats.post(0, [[CLEAR]])
    repeats.posted(0)
    repeats.repeat(59 * MS)
    assert (link.messages, repeats.interval_ns, repeats.due_ns) == ([CLEAR], NEVER_NS, NEVER_NS)
