"""How long a link or a live source waits between two tries."""

import pytest

from hri_drivers.wires.backoff import FIRST_S, LAST_S, SETTLED_NS, BackOff


def test_the_wait_doubles_up_to_a_limit():
    back_off = BackOff()
    waits = [back_off.next_s(0) for _ in range(9)]
    assert waits[:3] == [FIRST_S, 2 * FIRST_S, 4 * FIRST_S]
    assert waits[-2:] == [LAST_S, LAST_S]


@pytest.mark.parametrize(
    ("lived_ns", "wait_s"), [(SETTLED_NS, FIRST_S), (SETTLED_NS - 1, 4 * FIRST_S)]
)
def test_only_a_settled_connection_starts_it_afresh(lived_ns, wait_s):
    back_off = BackOff()
    back_off.next_s(0)
    back_off.next_s(0)
    back_off.opened(5)
    assert back_off.next_s(5 + lived_ns) == wait_s


def test_a_settled_connection_counts_once():
    back_off = BackOff()
    back_off.opened(0)
    assert [back_off.next_s(SETTLED_NS) for _ in range(2)] == [FIRST_S, 2 * FIRST_S]
