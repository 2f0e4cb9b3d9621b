import itertools

from hypothesis import given
from hypothesis import strategies as st

from hri_drivers.sources.inbox import CAPACITY, SceneInbox
from hri_drivers.sources.sent import SentScene
from hri_predict.contracts.source import NOT_KNOWN_NS

S = 1_000_000_000


def heard(sequence: int) -> SentScene:
    return SentScene(stamp_ns=0, sequence=sequence, sees_room=True, people=())


def taken(inbox: SceneInbox, now_ns: int) -> list[int]:
    found = []
    while (one := inbox.take(now_ns)) is not None:
        found.append(one.sequence)
    return found


def test_scenes_at_the_nominal_rate_are_all_taken_at_once():
    inbox = SceneInbox(30.0)
    for i in range(100):
        inbox.put(heard(i))
        assert taken(inbox, S + i * S // 30) == [i]
    assert inbox.overrun == 0
    assert inbox.next_ns() == NOT_KNOWN_NS


def test_what_came_in_a_pause_is_taken_in_order_and_the_oldest_beyond_the_capacity_is_not():
    inbox = SceneInbox(30.0)
    for i in range(CAPACITY + 3):
        inbox.put(heard(i))
    assert taken(inbox, S) == list(range(3, CAPACITY + 3))
    assert inbox.overrun == 3


def test_in_a_flood_the_newest_is_taken_at_twice_the_nominal_rate():
    inbox, found = SceneInbox(30.0), []
    for i in range(3000):  # ten seconds at 300 Hz
        inbox.put(heard(i))
        found += taken(inbox, S + i * S // 300)
    assert len(found) <= 2 * 30 * 10 + CAPACITY
    assert len(found) >= 2 * 30 * 10 - 1
    assert inbox.overrun == 3000 - len(found) - len(taken(inbox, 20 * S))
    late = [i for i in found if i > 300]
    assert all(b - a <= 6 for a, b in itertools.pairwise(late))


def test_in_a_flood_no_more_than_its_capacity_is_taken_in_one_moment():
    inbox = SceneInbox(30.0)
    for i in range(2 * CAPACITY):
        inbox.put(heard(i))
        assert len(taken(inbox, S)) == (i < CAPACITY)


def test_when_it_says_that_one_may_be_taken_one_may():
    inbox = SceneInbox(30.0)
    now_ns = S
    for i in range(100):
        inbox.put(heard(i))
        now_ns = max(now_ns, inbox.next_ns())
        assert inbox.take(now_ns) is not None


@given(st.lists(st.tuples(st.integers(0, 40), st.integers(0, S // 5)), max_size=50))
def test_every_scene_is_taken_counted_or_waits_and_order_is_kept(bursts):
    inbox, found, count, now_ns = SceneInbox(30.0), [], 0, S
    for size, pause_ns in bursts:
        for _ in range(size):
            inbox.put(heard(count))
            count += 1
        now_ns += pause_ns
        found += taken(inbox, now_ns)
    waiting = taken(inbox, now_ns + 10 * S)
    assert len(found) + len(waiting) + inbox.overrun == count
    assert found + waiting == sorted(found + waiting)
    assert len(waiting) <= CAPACITY
