"""Changing ids: who is forgotten when an id moves, comes back or is doubled, if none is kept."""

import numpy as np
import pytest

from hri_predict.base.skeleton import JOINTS
from hri_predict.contracts.scene import Person
from hri_predict.people.track import Body, Track
from hri_predict.protocol.reasons import Reason
from tests.hri_predict.people.figures import ALL, DOOR, SHAPE, J, body, lost_at, noisy

HEAD = np.array(["head" in name or "shoulder" in name or name == "neck" for name in JOINTS])
LEGS = np.array([name[2:] in ("hip", "knee", "ankle", "foot") for name in JOINTS])
# -- an id that was absent ---------------------------------------------------------------------


@pytest.mark.parametrize("seconds", [0.6, 1.5, 20.0])
@pytest.mark.parametrize("blind", [False, True])
def test_after_an_outage_an_id_may_be_somebody_else(make_room, seconds, blind):
    """Whoever had it may have hidden meanwhile, so both exist."""
    room = make_room()
    room.see(body(1, 0.0), times=10)
    if blind:
        room.see(times=round(seconds * 25), sees_room=False)
    else:
        room.now += round(seconds * 1e9)
    snapshot = room.see(body(1, 0.3), times=2)
    assert snapshot.ids == (1,)
    assert lost_at(snapshot) == [0.0]
    assert [person.id for person in snapshot.lost] == [-2]  # a zone of their own on every link


@pytest.mark.parametrize(("seconds", "lost"), [(1.0, []), (2.5, []), (4.0, [0.0]), (60.0, [0.0])])
def test_who_stays_in_place_is_the_same_person_after_a_few_seconds(make_room, seconds, lost):
    """Nobody leaves a place and hides while somebody else takes that very place; later, perhaps."""
    room = make_room()
    room.see(body(1, 0.0), times=10)
    room.now += round(seconds * 1e9)
    assert lost_at(room.see(body(1, 0.1), times=2)) == lost


def test_who_was_absent_from_scenes_is_no_such_person(make_room):
    room = make_room()
    room.see(body(1, 0.0), times=10)
    room.see(times=25)
    assert lost_at(room.see(body(1, 0.1), times=2)) == [0.0]


def test_after_a_short_outage_an_id_goes_on_where_its_person_can_be(make_room):
    for x, lost in ((0.15, []), (0.6, [0.0]), (1.5, [0.0])):
        room = make_room()
        room.see(body(1, 0.0), times=10)
        room.now += 300_000_000
        snapshot = room.see(body(1, x), times=2)
        assert snapshot.ids == (1,)
        assert lost_at(snapshot) == lost


def test_a_source_that_keeps_its_ids_may_be_silent_for_long(make_room):
    room = make_room(source={"keeps_ids": True})
    room.see(body(1, 0.0), times=10)
    room.now += 20_000_000_000
    snapshot = room.see(body(1, 3.0), times=2)
    assert snapshot.ids == (1,)
    assert snapshot.lost == ()


def test_where_ids_are_kept_a_tracked_person_is_lost_nowhere(make_room):
    room = make_room(source={"keeps_ids": True})
    room.see(body(1, 0.0), times=10)
    room.see(body(1, 4.0), times=6)
    room.see(times=8)
    snapshot = room.see(body(1, 0.0), times=2)
    assert snapshot.ids == (1,)
    assert snapshot.lost == ()


# -- a frozen source ------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("seconds", "x", "lost"),
    [
        *((seconds, x, [0.0]) for seconds in (0.6, 1.5, 20.0) for x in (0.6, 1.5, 3.0)),
        (0.6, 0.1, []),
        (2.5, 0.1, []),
        (4.0, 0.1, [0.0]),
    ],
)
def test_after_a_frozen_source_an_id_is_as_after_any_outage(make_room, seconds, x, lost):
    """Repeated captures show no person: the one who was there may have hidden meanwhile."""
    room = make_room(declares_noise=True)
    for seed in range(10):
        room.see(noisy(1, 0.0, seed=seed))
    snapshot = room.see(noisy(1, 0.0, seed=9), times=round(seconds * 25))
    assert (snapshot.ids, snapshot.lost) == ((1,), ())
    assert snapshot.reasons[0] is Reason.INPUT_FROZEN
    for seed in range(20, 40):
        snapshot = room.see(noisy(1, x, seed=seed))
    assert snapshot.ids == (1,)
    assert lost_at(snapshot) == pytest.approx(lost)


@pytest.mark.parametrize(("x", "lost"), [(0.0, [3.0]), (-3.0, [0.0, 3.0])])
def test_who_was_seen_under_the_id_before_the_source_froze_is_lost(make_room, x, lost):
    room = make_room(declares_noise=True)
    for seed in range(10):
        room.see(noisy(1, 0.0, seed=seed))
    room.see(noisy(1, 3.0, seed=0))
    room.see(noisy(1, 0.0, seed=9), times=50)
    for seed in range(20, 30):
        snapshot = room.see(noisy(1, x, seed=seed))
    assert snapshot.ids == (1,)
    assert lost_at(snapshot) == pytest.approx(lost)


# -- an id that moves farther than its person can -----------------------------------------------


def test_within_two_captures_nobody_moves_by_a_metre(make_room):
    """Ten metres a second are possible; that somebody who stood is so fast at once is not."""
    room = make_room()
    room.see(body(1, 0.0), times=10)
    snapshot = room.see(times=2)
    snapshot = room.see(body(1, 1.1), times=6)
    assert snapshot.ids == (1,)
    assert lost_at(snapshot) == [0.0]


def test_a_runner_stays_the_same_person(make_room):
    room = make_room()
    for step in range(30):
        snapshot = room.see(body(1, 6.0 * 0.04 * step))
    assert snapshot.ids == (1,)
    assert snapshot.lost == ()
    assert snapshot.counters.get("impossible_captures", 0) == 0


@pytest.mark.parametrize("before", [HEAD, LEGS])
@pytest.mark.parametrize("after", [ALL, LEGS, HEAD])
def test_joints_unseen_for_long_make_no_jump_believable(make_room, before, after):
    room = make_room()
    room.see(body(1, 0.0), times=10)
    room.see(body(1, 0.0, observed=before), times=40)
    room.see(body(1, 2.0, observed=after))
    assert room.count("impossible_captures") == 1
    snapshot = room.see(body(1, 2.0, observed=after), times=6)
    (where,) = lost_at(snapshot)  # of legs alone, the rest is inferred: it may lean
    assert abs(where) <= 0.2


@pytest.mark.parametrize("before", [HEAD, LEGS])
@pytest.mark.parametrize("after", [ALL, LEGS, HEAD])
def test_other_joints_of_the_same_body_are_the_same_person(make_room, before, after):
    room = make_room()
    room.see(body(1, 0.0), times=10)
    room.see(body(1, 0.0, observed=before), times=40)
    assert room.see(body(1, 0.02, observed=after)).reasons == ()
    assert room.count("impossible_captures") == 0
    assert room.see(body(2, 0.02, observed=before)).ids == (2,)  # renamed at the same time
    assert room.snapshot().lost == ()


# -- one person or two --------------------------------------------------------------------------


def test_who_is_still_reported_without_a_joint_is_not_found_a_metre_away(make_room):
    room = make_room()
    room.see(body(1, 0.0), times=10)
    hidden = Person(1, np.full((J, 3), np.nan), np.zeros(J, bool))
    room.see(hidden, times=5)
    snapshot = room.see(hidden, body(2, 0.75), times=2)
    assert snapshot.ids == (2,)
    assert lost_at(snapshot) == [0.0]


def test_one_body_that_is_reported_twice_finds_one_person(make_room):
    room = make_room()
    room.see(body(1, 0.0), body(2, 0.0, y=0.5), times=10)
    room.see(times=5)
    snapshot = room.see(body(3, 0.1), body(4, 0.1, y=0.3), times=2)
    assert snapshot.ids == (3, 4)
    assert len(snapshot.lost) == 1


# -- exits --------------------------------------------------------------------------------------


def walk(room, number, start, stop, speed=1.5, y=0.0, **others):
    count = round(abs(stop - start) / (speed * 0.04))
    for x in np.linspace(start, stop, count + 1):
        snapshot = room.see(body(number, x, y))
    return snapshot


def test_who_is_missed_for_a_moment_on_the_way_out_has_left_all_the_same(make_room):
    room = make_room(exits=[DOOR])
    walk(room, 1, 2.0, 6.1)
    room.see(times=4)
    walk(room, 2, 6.4, 6.55)
    snapshot = room.see(times=10)
    assert snapshot.ids == ()
    assert snapshot.lost == ()
    assert snapshot.reasons == ()


def test_who_comes_in_past_a_leaver_has_not_left(make_room):
    """The track of who left goes on with somebody else, who vanishes on the way in."""
    room = make_room(exits=[DOOR])
    walk(room, 1, 2.0, 6.3)
    room.see(times=3)
    walk(room, 2, 6.45, 5.6)
    snapshot = room.see(times=10)
    assert snapshot.counters["inherited"] == 1
    assert lost_at(snapshot) == [5.6]


def test_one_torn_capture_of_a_leaver_is_that_leaver(make_room):
    room = make_room(exits=[DOOR])
    walk(room, 1, 2.0, 6.3)
    assert Reason.INPUT_IMPOSSIBLE in room.see(body(1, 6.3, y=0.65)).reasons
    snapshot = room.see(times=10)
    assert snapshot.counters["left_by_exit"] == 1
    assert snapshot.lost == ()


# -- how far apart ------------------------------------------------------------------------------


def test_how_far_a_body_is_from_a_track_does_not_depend_on_what_is_seen(make_room):
    room = make_room()
    aside = SHAPE + np.array([0.3, 0.4, 0.0])
    start = Body(1, SHAPE, ALL)
    track = Track.start(start, room.people._history(), 0, 0)
    assert track.apart(Body(2, aside, ALL)) == pytest.approx(0.5)
    bent = SHAPE + np.where(HEAD[:, None], [0.5, 0.0, -0.3], 0.0)  # the trunk stays
    assert track.apart(Body(2, bent, ALL)) == pytest.approx(0.0, abs=1e-12)
    for part in (HEAD, LEGS):
        assert track.apart(Body(2, aside, part)) <= 0.5 + 1e-12
