"""Who has left by an exit, and who has only vanished in one."""

import numpy as np
import pytest

from hri_predict.scene import Person
from hri_predict.settings import Region
from hri_predict.skeleton import JOINTS

J = len(JOINTS)
SHAPE = np.random.default_rng(7).uniform([-0.2, -0.4, 0.0], [0.2, 0.4, 1.8], (J, 3))
DOOR = Region(polygon=[[4.0, -1.0], [6.0, -1.0], [6.0, 1.0], [4.0, 1.0]])


def walked(make_room, xs, y=0.0):
    """Somebody is seen at these places in turn, then not any more."""
    room = make_room(latency=0, exits=[DOOR])
    for x in xs:
        room.see(Person(1, SHAPE + np.array([x, y, 0.0]), np.ones(J, bool)))
    return room.see(times=10)


def steps(begin, end, speed=1.2):
    return np.arange(begin, end, np.sign(end - begin) * speed / 25.0)


@pytest.mark.parametrize(
    ("xs", "has_left"),
    [
        (steps(2.0, 4.8), True),  # walks into the exit
        (np.append(steps(2.0, 5.0), np.full(10, 5.0)), True),  # and stops at its end
        (np.append(steps(2.0, 5.0), np.full(50, 5.0)), False),  # stands there for 2 s
        (np.full(50, 5.0), False),  # stood there all the time
        (steps(5.8, 4.3), False),  # has just come in
        (np.append(steps(2.0, 5.5), steps(5.5, 4.2)), False),  # turned round
        (np.append(steps(5.8, 3.0), steps(3.0, 5.0)), True),  # came in, and leaves again
        (steps(1.0, 3.7), False),  # on the way to it
        (steps(2.0, 4.2), False),  # at its edge
    ],
)
def test_who_has_left(make_room, xs, has_left):
    snapshot = walked(make_room, xs)
    assert snapshot.ids == ()
    assert len(snapshot.lost) == (not has_left)
    assert snapshot.counters.get("left_by_exit", 0) == has_left


def test_without_an_exit_nobody_has_left(make_room):
    assert len(walked(make_room, steps(2.0, 4.8), y=3.0).lost) == 1
