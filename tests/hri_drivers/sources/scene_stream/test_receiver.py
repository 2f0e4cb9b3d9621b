"""Sessions, replays, parts and losses of the scene stream, on a clock of the test's own."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hri_drivers.sources.scene_stream.codec import encode
from hri_drivers.sources.scene_stream.key_file import Key
from hri_drivers.sources.scene_stream.receiver import LATE_NS, SceneStream
from hri_drivers.sources.sent import SentScene
from hri_predict.base.skeleton import JOINTS
from hri_predict.contracts.source import SourceCounters
from tests.hri_drivers.sources.scene_streaming import KEY, MS, UTC, S, joint_map, names, same, scene


class Node:
    """A receiver that has just started, with a UTC clock that the test sets."""

    def __init__(self, key: Key | None = KEY, joints: int = 4) -> None:
        self.utc_ns = UTC
        self.counters = SourceCounters()
        self.key = key
        self.stream = SceneStream(
            joint_map=joint_map(joints),
            counters=self.counters,
            key=key,
            max_skew_s=2.0,
            utc_ns=lambda: self.utc_ns,
        )

    def hear(self, *datagrams: bytes, after_ns: int = 0) -> list[SentScene]:
        self.utc_ns += after_ns
        return [h for data in datagrams for h in self.stream.feed(data, self.utc_ns - UTC + S)]


class Sender:
    def __init__(self, session: int = UTC, key: Key | None = KEY, joints: int = 4) -> None:
        self.session, self.key, self.joints = session, key, joints

    def __call__(self, sequence: int, stamp_ns: int | None = None, people: int = 1) -> list[bytes]:
        stamp_ns = self.session + sequence * 33 * MS if stamp_ns is None else stamp_ns
        sent = scene(sequence, people, self.joints, stamp_ns, session=self.session)
        return encode(sent, names(self.joints), self.key)


def test_what_came_before_is_not_heard_again():
    node, sender = Node(), Sender()
    recorded = [sender(i)[0] for i in range(5)]
    assert len(node.hear(*recorded)) == 5
    assert node.hear(*recorded) == []
    assert node.counters.replayed == 5
    assert len(node.hear(*sender(5))) == 1


def test_an_old_session_is_not_heard_again():
    node, before, after = Node(), Sender(UTC), Sender(UTC + S)
    recorded = [before(i)[0] for i in range(5)]
    node.hear(*recorded)
    assert len(node.hear(*after(0), after_ns=S)) == 1
    assert node.hear(*recorded, *before(5)) == []
    assert node.counters.replayed == 6
    assert "an older session" in (node.counters.last_error or "")


def test_a_recording_is_refused_by_a_node_that_has_just_started():
    recorded = [Sender()(i)[0] for i in range(5)]
    node = Node()
    assert node.hear(*recorded, after_ns=3 * S) == []
    assert node.counters.replayed == 5
    assert "-2.9 s off" in (node.counters.last_error or "")


def test_the_documented_rest_a_fresh_recording_until_the_sender_itself_is_heard():
    sender, node = Sender(), Node()
    recorded = [sender(i)[0] for i in range(5)]
    assert len(node.hear(*recorded[:2], after_ns=S)) == 2
    assert len(node.hear(*sender(30))) == 1
    assert node.hear(*recorded[2:]) == []


def test_a_clock_that_steps_in_a_session_is_heard_and_one_that_starts_wrong_is_not():
    node, sender = Node(), Sender()
    node.hear(*sender(0))
    assert len(node.hear(*sender(1, stamp_ns=UTC + 3600 * S))) == 1
    assert node.hear(*Sender(UTC + 3600 * S)(0)) == []
    assert "+3600.0 s off" in (node.counters.last_error or "")
    assert len(node.hear(*Sender(UTC + S)(0), after_ns=S)) == 1


def test_without_a_key_the_later_session_is_heard_and_the_earlier_once_that_is_silent():
    node, early, late = Node(None), Sender(UTC, None), Sender(UTC + S, None)
    assert len(node.hear(*early(0), *late(0))) == 2
    assert node.hear(*early(1), after_ns=500 * MS) == []
    assert node.counters.replayed == 1
    assert len(node.hear(*early(2), after_ns=600 * MS)) == 1


@pytest.mark.parametrize("key", [None, KEY])
def test_while_two_senders_contradict_each_other_the_room_is_not_seen(key):
    node, one, other = Node(key), Sender(UTC, key), Sender(UTC + S, key)
    node.hear(*one(0))
    (alone,) = node.hear(*other(0, people=0), after_ns=S)
    assert (alone.sees_room, alone.people) == (True, ())  # as after a restart
    assert node.hear(*one(31)) == []  # the first goes on: with a person
    (doubtful,) = node.hear(*other(1, people=0), after_ns=33 * MS)
    assert not doubtful.sees_room
    (believed,) = node.hear(*other(31, people=0), after_ns=S)
    assert believed.sees_room


@pytest.mark.parametrize("key", [None, KEY])
@pytest.mark.parametrize("behind", [0, 1, 30, 100])
def test_two_senders_with_one_session_contradict_each_other(key, behind):
    """Copies of one sender in two processes: one sees a person, the other an empty room."""
    node, sender = Node(key), Sender(UTC, key)
    node.hear(*(sender(i, people=0)[0] for i in range(200)))
    for i in range(200, 400):
        stamp_ns = UTC + i * 33 * MS
        (empty,) = node.hear(*sender(i, stamp_ns, people=0), after_ns=20 * MS)
        assert i == 200 or not empty.sees_room
        assert node.hear(*sender(i - behind, stamp_ns + 1, people=1), after_ns=13 * MS) == []
    assert "a second sender with the same session" in (node.counters.last_error or "")
    (alone,) = node.hear(*sender(500, people=0), after_ns=S)
    assert alone.sees_room


def test_a_sender_that_begins_again_with_its_old_session_is_named():
    node, sender = Node(None), Sender(UTC, None)
    node.hear(*(sender(i)[0] for i in range(100)))
    assert node.hear(*sender(0, UTC + 60 * S), after_ns=60 * S) == []
    assert "began again" in (node.counters.last_error or "")


@pytest.mark.parametrize("key", [None, KEY])
@pytest.mark.parametrize("ahead", [3, 30, 150, 2000])
def test_two_senders_with_one_session_and_clocks_of_their_own_are_noticed_at_once(key, ahead):
    """The node hears both from its start; the one that began earlier sees an empty room."""
    node, sender = Node(key), Sender(UTC, key)
    believed = 0
    for i in range(300):
        (empty,) = node.hear(*sender(i + ahead, UTC + i * 33 * MS + S, people=0), after_ns=20 * MS)
        believed += empty.sees_room
        assert node.hear(*sender(i, UTC + i * 33 * MS, people=1), after_ns=13 * MS) == []
    assert believed <= 11  # of a third of a second


arrivals = st.lists(st.tuples(st.integers(0, 150), st.integers(0, LATE_NS)), max_size=80)


@given(arrivals, st.sampled_from([1, 4]), st.integers(-3600, 3600))
def test_copies_and_late_datagrams_of_one_sender_contradict_nobody(sent, people, clock_set_s):
    """Each datagram arrives up to ``LATE_NS`` after it was sent, and again at once."""
    node, sender = Node(joints=128), Sender(joints=128)
    coming = sorted((i * 33 * MS + late_ns, i) for i, late_ns in sent)
    now_ns = 0
    for at_ns, i in coming:
        stamp_ns = UTC + i * 33 * MS + (clock_set_s * S if i > 75 and coming[0][1] <= 75 else 0)
        for part in sender(i, stamp_ns, people):
            heard = node.hear(part, part, after_ns=at_ns - now_ns)
            assert all(each.sees_room for each in heard)
            now_ns = at_ns


def test_a_recording_of_an_old_session_contradicts_nobody():
    node, before, after = Node(), Sender(UTC), Sender(UTC + 60 * S)
    recorded = before(0)
    node.hear(*recorded)
    node.hear(*after(0), after_ns=60 * S)
    node.hear(*recorded)
    assert node.hear(*after(1), after_ns=33 * MS)[0].sees_room


def test_a_session_from_the_future_would_lock_out_all_later_ones():
    node = Node()
    assert node.hear(*Sender(2**64 - 1)(0, stamp_ns=UTC)) == []
    assert "future" in (node.counters.last_error or "")
    assert len(node.hear(*Sender()(0))) == 1


def test_losses_and_wrong_order_are_told_apart():
    node, sender = Node(), Sender()
    heard = node.hear(*(sender(i)[0] for i in (0, 1, 5, 3, 3, 6, 200, 6)))
    assert [s.sequence for s in heard] == [0, 1, 5, 6, 200]
    counters = node.counters
    assert counters.lost == 2 + 193  # 2 and 4; 7 to 199
    assert counters.out_of_order == 1  # 3, the first time
    assert counters.replayed == 2
    assert counters.packets == 8


@given(st.lists(st.integers(0, 200), max_size=60))
def test_every_sequence_is_heard_lost_or_late_and_none_twice(sequences):
    node, sender = Node(), Sender()
    heard = [s.sequence for s in node.hear(*(sender(i)[0] for i in sequences))]
    assert heard == sorted(set(heard))
    counters = node.counters
    assert len(heard) + counters.out_of_order + counters.replayed == len(sequences)
    if heard:
        never = set(range(heard[0], heard[-1])) - set(sequences)
        too_late = {i for i in sequences if heard[0] < i not in heard}  # some beyond the window
        assert len(never) <= counters.lost <= len(never | too_late)


def test_a_scene_of_several_parts_in_any_order():
    node, sender = Node(joints=128), Sender(joints=128)
    parts = sender(0, people=4)
    assert len(parts) == 5
    (heard,) = node.hear(*reversed(parts))
    assert same(heard, scene(0, 4, 128, UTC))
    assert node.hear(parts[2]) == []
    assert node.counters.replayed == 1


def test_a_scene_that_lacks_a_part_is_counted_and_never_mixed_with_the_next():
    node, sender = Node(joints=128), Sender(joints=128)
    first, second = sender(0, people=4), sender(1, people=4)
    (heard,) = node.hear(*first[:3], *second, first[3], first[4])
    assert heard.sequence == 1
    assert (node.counters.incomplete, node.counters.replayed) == (1, 2)
    assert same(heard, scene(1, 4, 128, UTC + 33 * MS))


def test_parts_of_two_scenes_under_one_sequence_are_refused():
    node, sender = Node(joints=128), Sender(joints=128)
    other = sender(0, stamp_ns=UTC + 1, people=4)
    assert node.hear(*sender(0, people=4)[:3], *other[3:]) == []
    assert node.counters.replayed == 2
    assert "a second sender with the same session" in (node.counters.last_error or "")


def test_other_joints_are_refused_and_named():
    node = Node(joints=5)
    assert node.hear(*Sender()(0)) == []
    assert node.counters.malformed == 1
    assert "sender's 4 joints differ from those of joint map 'mine'" in (
        node.counters.last_error or ""
    )


def test_a_sender_of_the_canonical_joints_is_told_their_joint_map():
    node = Node(joints=5)
    scene = SentScene(stamp_ns=UTC, sequence=0, sees_room=True, people=(), session=UTC)
    assert node.hear(*encode(scene, JOINTS, KEY)) == []
    assert "those of 'joint_map: canonical': set that" in (node.counters.last_error or "")
    assert node.hear(*Sender()(0)) == []
    assert "canonical" not in (node.counters.last_error or "")


def test_nobody_and_a_sender_that_is_blind():
    node, sender = Node(), Sender()
    assert [(s.sees_room, s.people) for s in node.hear(*sender(0, people=0))] == [(True, ())]
    blind = SentScene(stamp_ns=UTC, sequence=1, sees_room=False, people=(), session=UTC)
    (heard,) = node.hear(*encode(blind, names(4), KEY))
    assert not heard.sees_room


@pytest.mark.parametrize("key", [None, KEY])
def test_a_socket_that_is_opened_again_forgets_no_session(key):
    node, sender = Node(key), Sender(key=key)
    recorded = sender(0)
    node.hear(*recorded)
    node.stream.reset()
    assert node.hear(*recorded) == []
    assert len(node.hear(*sender(1))) == 1
