"""Repeated, late and lost captures, and restarts of the sender."""

import numpy as np
import pytest

from hri_drivers.sources.mocap.decoder import LATE_RUN, MAX_LOST, STILL, Order, Rooted
from hri_drivers.sources.one_sender import SILENT_S, OneSender
from hri_drivers.sources.sent import SentPerson
from hri_predict.contracts.source import SourceCounters

S, MS = 10**9, 10**6


class Ordered:
    def __init__(self) -> None:
        self.counters = SourceCounters()
        self.order = Order(self.counters)

    def take(self, *captures: tuple[int, int | None]) -> list[bool]:
        return [self.order.advances(stamp_ns, number) for stamp_ns, number in captures]


def test_stamps_that_rise_are_used_and_repeats_are_not() -> None:
    one = Ordered()
    assert one.take((5 * S, None), (5 * S, None), (6 * S, None)) == [True, False, True]
    assert (one.order.sequence, one.order.session, one.counters.replayed) == (2, 0, 1)


def test_an_overtaken_capture_is_not_used() -> None:
    one = Ordered()
    assert one.take((5 * S, None), (5 * S - 20 * MS, None)) == [True, False]
    assert one.counters.out_of_order == 1


@pytest.mark.parametrize("number", [None, 500])
def test_a_clock_that_starts_again_is_a_restart(number: int | None) -> None:
    one = Ordered()
    start = None if number is None else 0
    assert one.take((5 * S, number), (1 * S, start)) == [True, True]
    assert one.order.session == 1


def test_many_late_captures_in_a_row_are_a_restart() -> None:
    one = Ordered()
    one.take((5 * S, None))
    used = one.take(*((5 * S - 300 * MS + k * MS, None) for k in range(LATE_RUN)))
    assert used == [False] * (LATE_RUN - 1) + [True]
    assert one.order.session == 1


def test_numbers_that_never_came_are_lost_whatever_the_stamps_say() -> None:
    one = Ordered()
    assert one.take((S, 1), (2 * S, 2), (3 * S, 6)) == [True, True, True]
    assert (one.order.sequence, one.counters.lost) == (6, 3)
    assert one.take((4 * S, 6 + MAX_LOST + 1)) == [True]
    assert (one.order.session, one.counters.lost) == (1, 3)


def test_a_clock_that_steps_back_is_seen_by_the_node_not_hidden() -> None:
    one = Ordered()
    assert one.take((3600 * S, 1), (S, 2)) == [True, True]
    assert one.order.session == 0


def test_a_clock_that_stands_still_is_not_an_advance() -> None:
    one = Ordered()
    assert one.take((S, 1), (S, 2)) == [True, False]
    assert one.counters.replayed == 1


def body(hip_x: float, hand_x: float, hip_z: float = 0.9) -> SentPerson:
    return SentPerson(
        1, np.array([[hip_x, 0.0, hip_z], [hand_x, 0.3, 1.0]]), np.array([True, True])
    )


def test_a_root_that_moves_is_in_the_room() -> None:
    rooted = Rooted(root=0, up=2)
    assert [rooted.sees(body(x, x)) for x in (0.0, 0.01, 0.02)] == [False, True, True]


def test_a_root_that_stays_while_the_body_moves_is_not() -> None:
    rooted = Rooted(root=0, up=2)
    assert not any(rooted.sees(body(0.0, 0.01 * k, 0.9 + 0.001 * k)) for k in range(3 * STILL))
    assert rooted.sees(body(0.1, 0.0))
    seen = [rooted.sees(body(0.1, 0.01 * k)) for k in range(1, STILL + 2)]
    assert seen == [True] * (STILL - 1) + [False] * 2


def test_a_root_that_is_not_measured_does_not_make_a_relative_stream_believed() -> None:
    rooted = Rooted(root=0, up=2)
    hidden = range(5, 3 * STILL, 5)
    roots = [np.nan if k in hidden else 0.0 for k in range(3 * STILL)]
    assert not any(rooted.sees(body(root, 0.01 * k)) for k, root in enumerate(roots))
    rooted = Rooted(root=0, up=2)
    assert not any(rooted.sees(body(np.nan, 0.01 * k)) for k in range(3 * STILL))


def test_a_person_in_the_room_whose_root_is_hidden_for_a_while_stays_in_the_room() -> None:
    rooted = Rooted(root=0, up=2)
    rooted.sees(body(0.0, 0.0))
    assert rooted.sees(body(0.1, 0.1))
    assert all(rooted.sees(body(np.nan, 0.01 * k)) for k in range(3 * STILL))
    assert rooted.sees(body(0.3, 0.3))


def test_a_person_who_does_not_move_at_all_is_not_taken_for_one() -> None:
    rooted = Rooted(root=0, up=2)
    rooted.sees(body(0.0, 0.0))
    rooted.sees(body(0.1, 0.1))
    assert all(rooted.sees(body(0.1, 0.1)) for _ in range(3 * STILL))


def test_one_sender_is_heard_until_it_is_silent() -> None:
    now = [100.0]
    counters = SourceCounters()
    receiver = OneSender("127.0.0.1", 0, counters=counters, now_s=lambda: now[0])
    assert receiver.accepts("a")
    assert not receiver.contradicted
    assert not receiver.accepts("b")
    assert receiver.contradicted
    now[0] += SILENT_S
    assert not receiver.contradicted
    assert receiver.accepts("b")
    assert not receiver.accepts("a")
    assert counters.refused == 2
