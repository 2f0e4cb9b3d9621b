"""Two programs that send into one stream of MVN: the people of one would be missing."""

import numpy as np
import pytest

from hri_drivers.sources.mvn.source import MvnDecoder, MvnSettings
from hri_drivers.sources.sent import SentScene
from hri_predict.base.arrays import Floats
from hri_predict.contracts.joint_map import load_joint_map
from hri_predict.contracts.source import SourceCounters
from hri_sim.people.body import Body
from hri_sim.senders import mvn as mvn_sender

BODY = Body(1.75)
STEP_NS = 10_000_000


class Hearing:
    """A decoder that hears a datagram every 10 ms."""

    def __init__(self) -> None:
        settings = MvnSettings(kind="mvn", rate_hz=100, sees_room=True, room_from_source={})
        self.counters = SourceCounters()
        self.decoder = MvnDecoder(settings, load_joint_map("xsens23"), self.counters)
        self.now_ns = 0

    def hear(self, *datagrams: bytes) -> list[SentScene]:
        scenes = []
        for data in datagrams:
            self.now_ns += STEP_NS
            scenes += self.decoder.feed(data, self.now_ns)
        return scenes


def place(x: float) -> Floats:
    return mvn_sender.segments_of(BODY.joints(BODY.standing(np.array([x, 0.0]), 0.0)))


def at(sample: int, x: float, character: int = 0) -> bytes:
    (data,) = mvn_sender.quaternions(sample, 10 * sample, character, place(x))
    return data


@pytest.mark.parametrize("character", [0, 1])
@pytest.mark.parametrize("behind", [0, 1, 20, 64, 65, 5000])
def test_a_second_program_hides_the_room(behind: int, character: int) -> None:
    if character and not behind:
        pytest.skip("one sample with both people, which is complete")
    hearing = Hearing()
    hearing.hear(at(9000, 6.0))
    for sample in range(9001, 9004):
        hearing.hear(at(sample, 6.0), at(sample - behind, 0.5, character))
    scenes = hearing.hear(at(9004, 6.0))
    scenes += hearing.hear(at(9004 - behind, 0.5, character), at(9005, 6.0))
    assert scenes
    assert not any(scene.sees_room for scene in scenes)
    assert "two programs send to this port" in str(hearing.counters.last_error)


def test_a_room_is_seen_again_a_second_after_the_second_program_was_stopped() -> None:
    hearing = Hearing()
    hearing.hear(at(9000, 6.0), at(8990, 0.5))
    seen = [scene.sees_room for n in range(9001, 9110) for scene in hearing.hear(at(n, 6.0))]
    assert seen[:98] == [False] * 98
    assert all(seen[100:])


def test_late_and_repeated_datagrams_of_one_program_do_not_hide_the_room() -> None:
    hearing = Hearing()
    hearing.hear(at(1, 6.0), at(1, 2.0, 1))
    for n in range(2, 20, 2):
        walked = 0.02 * n
        pair = at(n, 6.0 + walked), at(n, 2.0 + walked, 1)
        late, newer = at(n + 1, 6.0 + walked), at(n + 2, 6.0 + walked)
        (scene,) = hearing.hear(*pair)
        assert scene.sees_room
        assert not hearing.hear(newer, late, pair[1], newer)
    assert hearing.counters.out_of_order
    assert hearing.counters.replayed
    assert hearing.counters.last_error is None


def test_a_part_of_a_body_is_compared_with_the_same_part() -> None:
    """The feet alone are half a metre and more from the middle of a body."""
    hearing = Hearing()
    parts = mvn_sender.quaternions(7, 70, 0, place(6.0), items_each=8)
    (scene,) = hearing.hear(*parts)
    assert scene.sees_room
    hearing.hear(*parts)
    (after,) = hearing.hear(at(8, 6.0))
    assert after.sees_room


def test_one_restart_does_not_hide_the_room() -> None:
    hearing = Hearing()
    scenes = hearing.hear(at(9000, 6.0), at(9001, 6.0), at(0, 1.0), at(1, 1.0))
    assert [scene.sees_room for scene in scenes] == [True] * 4
