"""What is left out when ticks take too long, and when it is sent again."""

from hri_predict.node.shedding import LONGEST_NS, OF_TICKS, RESTORE_NS, SHED_TICKS, Shedding
from hri_predict.protocol.messages import Advice, Pose, Status, Zone

PERIOD_NS = 40_000_000


class Loop:
    """Ticks of 40 ms that use what the test says of it."""

    def __init__(self):
        self.shedding, self.now_ns = Shedding(), 0

    def run(self, used, ticks=1):
        for _ in range(ticks):
            self.shedding.note(used, self.now_ns)
            self.now_ns += PERIOD_NS

    def run_for(self, used, seconds):
        self.run(used, round(seconds * 25))

    @property
    def left_out(self):
        return [k for k in (Pose, Zone, Status, Advice) if self.shedding.leaves_out(k)]


def shed(count=1):
    loop = Loop()
    loop.run(0.9, count * SHED_TICKS)
    return loop


def test_nothing_is_left_out_while_ticks_are_short_enough():
    loop = Loop()
    loop.run_for(0.79, 60)
    assert (loop.left_out, loop.shedding.active, loop.shedding.sheds) == ([], False, 0)


def test_poses_go_first_then_zones_and_nothing_else_ever():
    loop = Loop()
    loop.run(0.9, SHED_TICKS - 1)
    assert loop.left_out == []
    loop.run(0.9)
    assert loop.left_out == [Pose]
    loop.run(0.9, SHED_TICKS)
    assert loop.left_out == [Pose, Zone]
    loop.run(3.0, 1000)
    assert (loop.left_out, loop.shedding.sheds) == ([Pose, Zone], 2)


def test_one_long_tick_alone_is_chance():
    loop = Loop()
    for _ in range(20):
        loop.run(5.0)
        loop.run(0.7, OF_TICKS - 1)
    assert loop.left_out == []


def test_every_second_tick_that_is_too_long_is_load():
    """A tracker at half the node's rate makes every second tick longer."""
    loop = Loop()
    for _ in range(20):
        loop.run(1.5)
        loop.run(0.1)
    assert loop.left_out == [Pose, Zone]
    for _ in range(2000):
        loop.run(1.5)
        loop.run(0.1)
    assert loop.left_out == [Pose, Zone]


def test_what_is_left_out_comes_back_slowly_one_by_one():
    loop = shed(2)
    loop.run_for(0.5, RESTORE_NS * 1e-9)
    assert loop.left_out == [Pose, Zone]
    loop.run(0.5)
    assert loop.left_out == [Pose]
    loop.run_for(0.5, RESTORE_NS * 1e-9 - 0.04)
    assert loop.left_out == [Pose]
    loop.run(0.5, 2)
    assert (loop.left_out, loop.shedding.active) == ([], False)


def test_between_the_bounds_nothing_changes():
    loop = shed()
    loop.run_for(0.7, 600)
    assert loop.left_out == [Pose]


def test_two_ticks_without_room_restart_the_wait():
    loop = shed()
    for _ in range(10):
        loop.run_for(0.5, RESTORE_NS * 1e-9 - 0.5)
        loop.run(0.7, SHED_TICKS)
    assert loop.left_out == [Pose]


def test_one_tick_without_room_does_not_restart_the_wait():
    loop = shed()
    for _ in range(5):
        loop.run_for(0.5, RESTORE_NS * 1e-9 / 5)
        loop.run(0.9)
    loop.run(0.5)
    assert loop.left_out == []


def test_what_is_soon_left_out_again_comes_back_later_each_time():
    loop, waited = shed(), []
    for _ in range(7):
        began_ns = loop.now_ns
        while loop.left_out:
            loop.run(0.5)
        waited.append((loop.now_ns - began_ns) // 10**9)
        loop.run(0.9, SHED_TICKS)
    assert waited == [5, 10, 20, 40, 80, 80, LONGEST_NS // 10**9]


def test_after_a_long_calm_it_comes_back_soon_again():
    loop = shed()
    loop.run_for(0.5, 6)
    loop.run(0.9, SHED_TICKS)
    loop.run_for(0.5, 600)
    loop.run(0.9, SHED_TICKS)
    began_ns = loop.now_ns
    while loop.left_out:
        loop.run(0.5)
    assert (loop.now_ns - began_ns) // 10**9 == 5


def test_ticks_that_went_without_are_counted():
    loop = shed(2)  # two ticks shed poses, two more without them shed zones
    loop.run(0.9, 10)
    assert loop.shedding.without == {Pose: SHED_TICKS + 10, Zone: 10}
