"""Where a lost person may be, by what was seen free: the true place is never left out."""

import time

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hri_predict.base.settings import Region
from hri_predict.base.skeleton import JOINTS
from hri_predict.contracts.scene import Person
from hri_predict.people.body.standing import standing_body
from hri_predict.people.lost.free_space import CELL_M, MOST_PLACES, FreeSpace

MS = 1_000_000
PERIOD = 40 * MS
VIEW = Region(polygon=[[-6, -6], [6, -6], [6, 6], [-6, 6]])
PALLET = Region(polygon=[[1, -1], [2.5, -1], [2.5, 1], [1, 1]], z_max=1.2)
CAPTURES = 10
WALK = 1.6


def space(shadows=(PALLET,), viewpoints=(), view=VIEW, room=None):
    return FreeSpace(
        view=view, room=room, shadows=shadows, viewpoints=viewpoints, captures=CAPTURES
    )


def at(x, y):
    return np.array([x, y, 1.0])


def may_be(whereabouts, point):
    return bool(holds(whereabouts.places(), point[None, :2])[0])


def holds(places, points):
    """Whether each of the points is in one of the places."""
    apart = np.hypot(*np.moveaxis(points[:, None] - places[:, :2], -1, 0))
    return (apart <= places[:, 2] + 1e-9).any(1)


def seen_there(room, place, start=0):
    """Somebody was lost at a place, and a body was seen there again, down to its feet."""
    lost = room.start(place, start, WALK)
    lost.update(start + MS, None, [place[:2]])
    return lost


def watch(room, whereabouts, captures, *seen, start=0):
    for k in range(1, captures + 1):
        whereabouts.update(start + k * PERIOD, room.free(seen))
    return start + captures * PERIOD


def test_who_was_found_in_the_open_is_gone_after_so_many_captures():
    room = space()
    lost = seen_there(room, at(-2, -2))
    watch(room, lost, CAPTURES - 1)
    assert lost.anywhere
    watch(room, lost, 1, start=(CAPTURES - 1) * PERIOD)
    assert not lost.anywhere


def test_who_vanishes_behind_a_pallet_stays_there_and_nowhere_else():
    room = space()
    lost = room.start(at(1.7, 0), 0, WALK)
    watch(room, lost, 2000)  # 80 s
    assert may_be(lost, at(1.7, 0.9))
    assert may_be(lost, at(0.8, 0.0))  # half hidden at its edge, or a step out of it
    places = lost.places()
    assert (places[:, 0] - places[:, 2]).min() > -1.2
    assert (places[:, 0] + places[:, 2]).max() < 4.7
    assert not may_be(lost, at(-2, 0))


def test_scenes_that_prove_nothing_let_the_place_grow():
    room = space()
    lost = room.start(at(-2, -2), 0, WALK)
    for k in range(1, 26):  # 1 s
        lost.update(k * PERIOD, None)
    assert may_be(lost, at(-2 + 1.6, -2))
    room = space(shadows=())
    lost = seen_there(room, at(0, 0))
    for k in range(1, 26):
        lost.update(k * PERIOD, None)
    watch(room, lost, 3 * CAPTURES, start=25 * PERIOD)
    assert not lost.anywhere


def test_people_in_view_hide_others_unless_it_is_known_from_where_they_are_seen():
    blind, sighted = space(shadows=()), space(shadows=(), viewpoints=[[-6, 0, 2.5]])
    assert not blind.free([at(0, 0)]).any()
    behind, beside = seen_there(sighted, at(2, 0)), seen_there(sighted, at(0, -3))
    for lost in (behind, beside):
        watch(sighted, lost, 3 * CAPTURES, at(0, 0))
    assert behind.anywhere
    assert not beside.anywhere


def test_a_body_at_the_camera_hides_everything_from_it():
    sighted = space(shadows=(), viewpoints=[[-4, 0, 2.5]])
    assert not sighted.free([at(-4.1, 0.1)]).any()
    assert sighted.free([at(-3, 0.1)]).any()


def test_a_second_camera_sees_who_is_hidden_from_the_first():
    one = space(shadows=(), viewpoints=[[-6, 0, 2.5]])
    two = space(shadows=(), viewpoints=[[-6, 0, 2.5], [0, -6, 2.5]])
    for room, is_there in ((one, True), (two, False)):
        lost = seen_there(room, at(3, 0))
        watch(room, lost, 3 * CAPTURES, at(0, 0))
        assert lost.anywhere is is_there


def test_who_may_be_at_another_body_is_not_seen_free():
    two = space(shadows=(), viewpoints=[[-6, 0, 2.5], [0, -6, 2.5]])
    lost = two.start(at(0.2, 0), 0, WALK)
    watch(two, lost, 100, at(0, 0))
    assert lost.anywhere


@pytest.mark.parametrize(
    ("shadow", "hides"),
    [
        ({"z_max": 1.2}, True),
        ({"z_min": 0.8, "z_max": 3.0}, True),
        ({"z_max": 0.2}, False),  # nobody fits into it
        ({"z_min": 2.2, "z_max": 3.0}, False),  # above everybody
    ],
)
def test_a_shadow_hides_where_somebody_fits_into_its_height(shadow, hides):
    room = space(shadows=[Region(polygon=PALLET.polygon, **shadow)])
    lost = seen_there(room, at(1.7, 0))
    watch(room, lost, 3 * CAPTURES)
    assert lost.anywhere is hides


def test_a_view_that_begins_above_the_floor_proves_nothing():
    view = Region(polygon=VIEW.polygon, z_min=0.8)
    assert not space(view=view).free([]).any()


def test_behind_a_wall_nobody_can_be():
    view = Region(polygon=[[-3, -3], [3, -3], [3, 3], [-3, 3]])
    for room, is_there in ((None, True), (view, False)):
        inside = space(view=view, room=room, shadows=())
        lost = seen_there(inside, at(2.4, 0))
        watch(inside, lost, 3 * CAPTURES)
        assert lost.anywhere is is_there


def test_a_place_far_outside_the_view_cannot_be_followed():
    assert space().start(at(20, 0), 0, WALK) is None


@given(st.integers(0, 2**32 - 1), st.sampled_from([8.0, 15.0, 30.0]), st.floats(0.2, 5.0))
def test_whoever_is_never_in_the_open_for_long_is_never_left_out(seed, rate_hz, speed):
    """The walker steps out from behind the pallet, and is back before the tracker finds him."""
    rng = np.random.default_rng(seed)
    room = space(viewpoints=[[-6, 0, 2.5]])
    place, period = at(1.7, 0.0), round(1e9 / rate_hz)
    lost, in_open = room.start(place, 0, speed), 0
    for k in range(1, 120):
        other = at(*rng.uniform(-4, 4, 2))
        step = rng.normal(size=2)
        step *= rng.uniform(0, speed * period * 1e-9) / np.linalg.norm(step)
        free = room.free([other]) if rng.random() < 0.9 else None
        there = place + np.append(step, 0.0)
        cell = np.floor((there[:2] - room.centres[0, 0] + CELL_M / 2) / CELL_M).astype(int)
        if (cell < 0).any() or (cell >= room.shape).any():
            break
        in_open = in_open + 1 if free is not None and free[tuple(cell)] else 0
        if in_open == CAPTURES:  # now the tracker finds him
            break
        place = there
        lost.update(k * period, free)
        assert lost._left[tuple(cell)] > 0
    assert may_be(lost, place)


@given(st.integers(0, 2**32 - 1))
def test_places_hold_every_cell(seed):
    rng = np.random.default_rng(seed)
    room = space()
    lost = room.start(at(*rng.uniform(-3, 3, 2)), 0, WALK)
    lost._left = np.where(rng.random(room.shape) < rng.uniform(0.001, 0.3), 1, 0)
    places = lost.places()
    assert len(places) <= MOST_PLACES
    corners = room.centres[lost._left > 0][:, None] + CELL_M / 2 * np.array(
        [[-1, -1], [-1, 1], [1, -1], [1, 1]]
    )
    assert holds(places, corners.reshape(-1, 2)).all()


@pytest.mark.parametrize("floor_m", [-1.5, -0.9, 2.0])
def test_a_pallet_hides_people_however_high_the_floor_is(floor_m):
    heights = {"z_min": floor_m, "z_max": floor_m + 1.2}
    room = FreeSpace(
        view=Region(polygon=VIEW.polygon, z_min=floor_m, z_max=floor_m + 3),
        room=None,
        shadows=(Region(polygon=PALLET.polygon, **heights),),
        viewpoints=(),
        captures=CAPTURES,
        floor_m=floor_m,
    )
    lost = room.start(at(1.7, 0), 0, WALK)
    watch(room, lost, 200)
    assert may_be(lost, at(1.7, 0.9))


def test_a_pause_of_hours_takes_no_longer_than_one_of_a_minute():
    room = space(room=VIEW)
    lost = room.start(at(1.7, 0), 0, WALK)
    started = time.process_time()
    lost.update(12 * 3600 * 1000 * MS, None)
    assert time.process_time() - started < 0.5
    assert all(may_be(lost, at(x, y)) for x in (-5.9, 5.9) for y in (-5.9, 5.9))


def test_who_was_seen_outside_the_room_is_not_proven_gone():
    room = space(room=Region(polygon=[[0, -6], [6, -6], [6, 6], [0, 6]]))
    assert room.start(at(-0.7, 0), 0, WALK) is None
    assert room.start(at(-0.2, 0), 0, WALK) is not None  # at the wall


# -- who vanishes where the source claims to see ------------------------------------------------

CAMERA = (-6.0, 0.0, 2.4)


def test_who_vanishes_in_the_open_may_be_anywhere():
    """A vehicle that stops between the camera and somebody hides more than that place."""
    room = space(shadows=(), viewpoints=[CAMERA], room=VIEW)
    lost = room.start(at(1, 0), 0, WALK)
    watch(room, lost, CAPTURES - 1)
    assert not lost.disputed
    end = watch(room, lost, 2000, start=(CAPTURES - 1) * PERIOD)
    assert lost.disputed
    assert all(may_be(lost, at(x, y)) for x in (-5.9, 5.9) for y in (-5.9, 5.9))
    lost.update(end + PERIOD, room.free([]), [np.array([1.0, 0.0])])
    watch(room, lost, CAPTURES, start=end + PERIOD)
    assert not lost.anywhere


def test_the_place_grows_from_when_the_person_was_seen():
    room = space(shadows=(), viewpoints=[CAMERA])
    lost = room.start(at(0, 0), 0, WALK)
    watch(room, lost, CAPTURES)
    reached = WALK * CAPTURES * PERIOD * 1e-9
    assert may_be(lost, at(reached, 0))
    assert may_be(lost, at(0, -reached))
    assert not may_be(lost, at(reached + 2.5, 0))


@pytest.mark.parametrize(
    ("body", "shows"),
    [
        ((1.0, 0.0), True),  # that very place
        ((1.4, 0.1), True),  # just behind it
        ((0.85, 0.1), True),
        ((2.5, 0.0), False),  # far behind: seen above a cart that hides who crouches
        ((0.5, 0.0), False),  # before it: a vehicle may stand between
        ((1.0, 0.3), False),  # beside it, past the vehicle's edge
    ],
)
def test_which_body_shows_that_a_place_is_seen(body, shows):
    place, room = np.array([1.0, 0.0]), space(shadows=(), viewpoints=[CAMERA])
    assert room.shows(place, [np.array(body)]) is shows
    two = space(shadows=(), viewpoints=[CAMERA, (0.0, -6.0, 2.4)])
    is_there = bool(np.hypot(*(np.array(body) - place)) <= 0.2)
    assert two.shows(place, [np.array(body)]) is is_there


def test_a_body_that_walks_by_shows_nothing_of_other_places():
    room = space(shadows=(), viewpoints=[CAMERA])
    lost = room.start(at(1, 0), 0, WALK)
    for k in range(1, 200):
        body = np.array([0.2, -4.0 + 0.04 * k])  # crosses the line, before the place
        lost.update(k * PERIOD, room.free([np.append(body, 1.0)]), [body])
    assert lost.disputed


def test_who_is_lost_behind_a_body_that_then_goes_is_not_gone():
    """Nobody was seen where the lost one was, so something else hides that place."""
    room = space(shadows=(), viewpoints=[CAMERA])
    lost = room.start(at(1, 0), 0, WALK)
    end = watch(room, lost, 50, at(0.3, 0))
    assert not lost.disputed
    watch(room, lost, 50, at(0.3, 3), start=end)
    assert lost.disputed


def test_a_shadow_next_to_the_place_explains_where_a_person_went():
    room = space(viewpoints=[CAMERA])
    lost = room.start(at(0.9, 0.0), 0, WALK)
    watch(room, lost, 500)
    assert not lost.disputed


# -- through the people stage ---------------------------------------------------------------------

SHAPE = standing_body()
ALL = np.ones(len(JOINTS), bool)
NO_FEET = np.array(["ankle" not in name and "foot" not in name for name in JOINTS])
SEES = {"sees_free_space": True, "field_of_view": VIEW, "viewpoints": [list(CAMERA)]}


def person(number, x, y=0.0, observed=ALL):
    return Person(number, SHAPE + np.array([x, y, 0.0]), observed)


def test_who_vanishes_in_the_open_stays_lost_until_seen_there_again(make_room):
    room = make_room(latency=0, source=SEES, room=VIEW, exits=[])
    room.see(person(1, 1.0), times=10)
    assert len(room.see(times=200).lost) == 1
    room.see(person(7, 3.0), times=20)  # on the same line, far behind
    room.see(times=20)
    assert [lost.id for lost in room.snapshot().lost] == [1, 7]
    room.see(person(8, 1.05, observed=NO_FEET), times=20)  # seen above a cart, perhaps
    room.see(times=20)
    assert len(room.snapshot().lost) == 3
    room.see(person(9, 1.05), times=20)
    assert [lost.id for lost in room.see(times=20).lost] == [7, 9]


def test_an_acknowledgement_ends_it_too(make_room):
    room = make_room(latency=0, source=SEES, room=VIEW, exits=[])
    room.see(person(1, 1.0), times=10)
    room.see(times=200)
    room.people.acknowledge()
    assert room.snapshot().lost == ()
