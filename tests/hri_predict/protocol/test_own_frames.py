"""Own frames: an echo is not another sender's frame, and memory does not grow."""

from hypothesis import given
from hypothesis import strategies as st

from hri_predict.protocol.own_frames import KEPT, PAIR_NS, OwnFrames

FRAMES = st.lists(st.binary(min_size=1, max_size=2), max_size=60)


@given(FRAMES, FRAMES)
def test_what_was_sent_is_an_echo_and_all_else_is_foreign(sent, heard):
    own = OwnFrames()
    for frame in sent:
        own.sent(frame)
    for frame in heard:
        own.hear(frame)
    assert own.echoes == sum(frame in sent for frame in heard)
    assert own.foreign == len(heard) - own.echoes


def test_only_the_newest_are_remembered():
    own = OwnFrames()
    for k in range(3 * KEPT):
        own.sent(k)
        own.sent("the same")
    own.hear(0)
    assert (own.echoes, own.foreign) == (0, 1)
    own.hear("the same")
    own.hear(3 * KEPT - 1)
    assert (own.echoes, own.foreign) == (2, 1)
    assert len(own._times) <= KEPT
    assert len(own._newest) == KEPT


def test_two_frames_of_another_within_half_a_second_prove_a_second_sender():
    own = OwnFrames()
    own.hear(1)
    assert not own.prove_second(0)
    assert not own.prove_second(1), "nothing new"
    own.hear(2)
    assert not own.prove_second(PAIR_NS + 1), "too long after the first"
    own.hear(3)
    assert own.prove_second(PAIR_NS + 2)
    own.hear(4)
    own.hear(5)
    assert own.prove_second(9 * PAIR_NS), "two at once"
