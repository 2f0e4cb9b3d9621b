"""Who has left by an exit, and who has only vanished in one."""

import numpy as np
import pytest
from pydantic import ValidationError

from hri_predict.base.settings import Region
from hri_predict.base.skeleton import JOINTS
from hri_predict.contracts.scene import Person
from hri_predict.people.body.standing import standing_body
from hri_predict.people.settings import Exit

J = len(JOINTS)
ALL = np.ones(J, bool)
SHAPE = standing_body()
LEGS = np.array([name[2:] in ("knee", "ankle", "foot") for name in JOINTS])
LOW = LEGS | np.array([name == "waist" or name[2:] == "hip" for name in JOINTS])
DOOR = Region(polygon=[[4.0, -1.0], [5.0, -1.0], [5.0, 1.0], [4.0, 1.0]])
SILL = Exit(polygon=DOOR.polygon, out=[[5.0, -0.5], [5.0, 0.5]])
HZ = 25.0


def walked(make_room, places, door=DOOR, hidden=None, error_m=0.0):
    """Somebody is seen at these places in turn, then not any more."""
    room = make_room(latency=0, exits=[door])
    for i, place in enumerate(places):
        x, y = place if np.ndim(place) else (place, 0.0)
        observed = ALL if hidden is None else ~hidden(i, len(places))
        room.see(Person(1, SHAPE + np.array([x, y, 0.0]), observed, error_m=error_m))
    return room.see(times=10)


def steps(begin, end, speed=1.2):
    return np.arange(begin, end, np.sign(end - begin) * speed / HZ)


def line(begin, end, speed=1.2):
    """(N, 2) places from one to another."""
    begin, end = np.array(begin), np.array(end)
    count = round(float(np.hypot(*(end - begin))) / speed * HZ)
    return np.linspace(begin, end, count + 1)


@pytest.mark.parametrize(
    ("xs", "has_left"),
    [
        (steps(2.0, 5.3), True),  # crosses it
        (steps(2.0, 5.3, 0.6), True),  # slowly
        (steps(2.0, 5.3, 0.3), False),  # too slowly: about to stop, perhaps
        (steps(2.0, 4.95), False),  # just before the side that leads out
        (steps(2.0, 5.07), False),  # in it
        (np.append(steps(2.0, 5.3), np.full(50, 5.3)), True),  # crosses it, and stops behind it
        (np.append(steps(2.0, 5.4), steps(5.4, 5.2)), False),  # crosses it, and turns round
        (np.append(steps(2.0, 5.4), steps(5.4, 5.15, 0.2)), False),  # and comes back slowly
        (steps(2.0, 4.7), False),  # inside, on the way out: may turn round unseen
        (steps(2.0, 4.35), False),
        (np.append(steps(2.0, 4.95), np.full(10, 4.95)), False),  # stops before the side
        (np.append(steps(2.0, 4.5), steps(4.5, 4.9, 0.3)), False),  # slows down
        (np.full(50, 4.5), False),  # stood there all the time
        (steps(4.9, 4.3), False),  # has just come in
        (np.append(steps(2.0, 4.8), steps(4.8, 4.2)), False),  # turned round
        (np.append(steps(4.8, 3.0), steps(3.0, 5.2)), True),  # came in, and leaves again
        (np.append(steps(5.4, 4.5), steps(4.5, 5.2)), False),  # never was in the room
        (steps(1.0, 3.7), False),  # on the way to it
        (steps(2.0, 7.0), False),  # walks on behind it: there is no wall
    ],
)
def test_who_has_left(make_room, xs, has_left):
    snapshot = walked(make_room, xs)
    assert snapshot.ids == ()
    assert len(snapshot.lost) == (not has_left)
    assert snapshot.counters.get("left_by_exit", 0) == has_left


@pytest.mark.parametrize("off", [0.05, 0.1, 0.2])
@pytest.mark.parametrize("hides", [LEGS, LOW])
def test_who_passes_an_edge_has_not_left(make_room, off, hides):
    """Half of the legs' height is missing from the mean of joints; the body moves over no side."""
    places = line([4.0 + off, -3.0], [4.0 + off, 0.95])

    def hidden(i, count):
        return hides & (i > count - 10)

    assert len(walked(make_room, places, hidden=hidden).lost) == 1
    assert len(walked(make_room, line([4.0 + off, -3.0], [4.0 + off, 1.2])).lost) == 1


def test_who_crouches_in_an_exit_has_not_left(make_room):
    room = make_room(latency=0, exits=[DOOR])
    for i, x in enumerate(np.append(steps(2.0, 4.9), np.full(12, 4.9))):
        low = 0.5 * max(0.0, i - len(steps(2.0, 4.9))) / 12
        room.see(Person(1, SHAPE * [1.0, 1.0, 1.0 - low] + np.array([x, 0.0, 0.0]), ALL))
    assert len(room.see(times=10).lost) == 1


@pytest.mark.parametrize("hides", [LEGS, LOW])
def test_hips_or_feet_must_be_seen(make_room, hides):
    places = line([2.0, 0.0], [5.2, 0.0])
    snapshot = walked(make_room, places, hidden=lambda i, count: hides & (i > 40))
    assert len(snapshot.lost) == (hides is LOW)
    snapshot = walked(make_room, places, hidden=lambda i, count: ~hides)  # legs alone
    assert len(snapshot.lost) == 0


def turned(begin, end, speed=1.2, seconds=0.6):
    """Places of somebody who walks there, slows down, turns round and is on the way back."""
    times = np.arange(-seconds, seconds, 1 / HZ)
    turn = end + 0.5 * speed * (seconds - times**2 / seconds) - 0.5 * speed * seconds
    return np.concatenate([steps(begin, turn[0], speed), turn])


@pytest.mark.parametrize("until", [1.0, 4.5, 5.2])
@pytest.mark.parametrize("hides", [LEGS, LOW])
def test_who_comes_back_behind_something_has_not_left(make_room, hides, until):
    """A cart hides the legs, perhaps the hips, of a person who returns through the exit."""
    out = turned(2.0, 5.6)
    places = np.append(out, steps(out[-1], until))
    turned_at = int(np.argmax(places))
    snapshot = walked(make_room, places, hidden=lambda i, count: hides & (i > turned_at))
    assert len(snapshot.lost) == 1
    assert snapshot.counters.get("left_by_exit", 0) == 0


@pytest.mark.parametrize("hides", [LEGS, LOW])
def test_who_goes_on_behind_something_has_left(make_room, hides):
    places = steps(2.0, 5.6)
    snapshot = walked(make_room, places, hidden=lambda i, count: hides & (places[i] > 5.2))
    assert snapshot.lost == ()


@pytest.mark.parametrize("angle", [-0.5, 0.0, 0.5])
def test_an_exit_is_crossed_in_any_direction_that_goes_through(make_room, angle):
    way = np.array([np.cos(angle), np.sin(angle)])
    assert walked(make_room, line([4.5, 0.0] - 2.5 * way, [4.5, 0.0] + 0.7 * way)).lost == ()


def test_where_a_line_is_named_that_alone_leads_out(make_room):
    assert walked(make_room, line([2.0, 0.0], [5.2, 0.0]), SILL).lost == ()
    assert walked(make_room, line([2.0, 0.0], [7.0, 0.0]), SILL).lost == ()  # far behind it
    assert len(walked(make_room, line([2.0, 0.8], [5.2, 0.8]), SILL).lost) == 1  # beside it
    assert len(walked(make_room, line([4.5, -3.0], [4.5, 1.2]), SILL).lost) == 1
    assert walked(make_room, line([4.5, -3.0], [4.5, 1.2])).lost == ()  # without it, any side


@pytest.mark.parametrize(
    ("error_m", "until", "aside", "has_left"),
    [
        (0.0, 5.3, 0.0, True),
        (0.1, 5.3, 0.0, True),
        (0.25, 5.3, 0.0, False),  # the true place may be 5.05: in the exit
        (0.25, 5.45, 0.0, True),
        (0.25, 5.45, 0.2, True),
        (0.25, 5.45, 0.4, False),  # the way may lead past the exit's end, which is at 0.5
        (20.0, 5.45, 0.0, False),
    ],
)
def test_who_may_still_be_here_has_not_left(make_room, error_m, until, aside, has_left):
    places = line([2.0, aside], [until, aside])
    assert bool(walked(make_room, places, SILL, error_m=error_m).lost) is not has_left


def test_without_an_exit_nobody_has_left(make_room):
    assert len(walked(make_room, line([2.0, 3.0], [5.2, 3.0])).lost) == 1


def test_a_line_that_lies_on_no_side_is_refused():
    for out, why in (
        ([[4.5, -0.5], [4.5, 0.5]], "on one side of polygon"),
        ([[5.0, 0.5], [4.5, 1.0]], "on one side of polygon"),
        ([[5.0, 0.5], [5.0, 0.52]], "apart"),
    ):
        with pytest.raises(ValidationError, match=why):
            Exit(polygon=DOOR.polygon, out=out)
