"""Bodies of two sensors become one person only where nothing speaks against it."""

from itertools import combinations

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from hri_predict.base.skeleton import JOINTS
from hri_predict.people.merging.identities import JOIN_S, MAX_ID, Identities
from hri_predict.people.merging.likeness import Likeness, Seen
from hri_predict.people.track import Body
from hri_sim.people.body import Body as Figure

MS = 1_000_000
SAME_M, APART_M = 0.15, 0.25
ROUNDING_M = 1e-9
"""Nearer to a limit than this, two ways to work out a distance may differ in their verdict."""
FIGURE = Figure(1.75)
ALL = np.ones(len(JOINTS), np.bool_)


def body(x=0.0, y=0.0, heading=0.0, *, number=1, hidden=(), noise_m=0.0, seed=0):
    joints = FIGURE.joints(FIGURE.standing(np.array([x, y]), heading))
    joints = joints + np.random.default_rng(seed).normal(0.0, noise_m, joints.shape)
    observed = ALL.copy()
    observed[list(hidden)] = False
    return Body(number, np.where(observed[:, None], joints, 0.0), observed)


def seen(sensor, number):
    return Seen(sensor, (number, 0))


def step(identities, at_ms, *bodies):
    """Bodies as (sensor, id, body); returns sensor and id -> merged id, and the joined pairs."""
    given_ = {seen(sensor, number): each for sensor, number, each in bodies}
    people, joined = identities.step(given_, at_ms * MS)
    found = {(s.sensor, s.key[0]): p.id for p in people for s in p.seen.values()}
    for person in people:
        of = [given_[s] for s in person.seen.values() if given_[s].observed.any()]
        if of:
            person.place = np.mean([b.centroid for b in of], axis=0)
    return found, joined


def median_m(one, other):
    """Median distance of the joints that both see; ``None``: fewer than five."""
    both = one.observed & other.observed
    if both.sum() < 5:
        return None
    return np.median(np.linalg.norm(one.positions[both] - other.positions[both], axis=1))


def sides_m(one, other):
    """Mean distance of both shoulders, or of both hips, whichever is less."""
    found = [np.inf]
    for joint in ("shoulder", "hip"):
        pair = [JOINTS.index(f"{side}_{joint}") for side in "lr"]
        if (one.observed & other.observed)[pair].all():
            apart = np.linalg.norm(one.positions[pair] - other.positions[pair], axis=1)
            found.append(apart.mean())
    return min(found)


def test_distances_of_many_bodies_are_those_of_each_two():
    hidden = [set(range(k)) for k in range(len(JOINTS) + 1)]
    bodies = {
        Seen(k % 3, (k, 0)): body(0.05 * k, 0.0, 0.1 * k, hidden=gone, noise_m=0.02, seed=k)
        for k, gone in enumerate(hidden)
    }
    likeness = Likeness(bodies, SAME_M, APART_M)
    for (one, ours), (other, theirs) in combinations(bodies.items(), 2):
        median = median_m(ours, theirs)
        assert likeness.apart_m(one, other) == (None if median is None else pytest.approx(median))
        is_one = median is not None and max(median, sides_m(ours, theirs)) <= SAME_M
        assert likeness.is_same(one, other) == likeness.is_same(other, one) == is_one


def test_sixty_four_people_whom_four_sensors_see_are_sixty_four():
    bodies = [
        (sensor, k, body(1.0 * (k % 8), 1.0 * (k // 8), 0.0, noise_m=0.01, seed=64 * sensor + k))
        for sensor in range(4)
        for k in range(64)
    ]
    found, joined = step(Identities(SAME_M, APART_M), 0, *bodies)
    assert joined == ()
    assert len(set(found.values())) == 64
    assert all(found[sensor, k] == found[0, k] for sensor in range(4) for k in range(64))


@given(
    apart_m=st.floats(0.0, 3.0),
    direction=st.floats(-np.pi, np.pi),
    headings=st.tuples(st.floats(-3, 3), st.floats(-3, 3)),
    hidden=st.sets(st.integers(0, len(JOINTS) - 1), max_size=12),
    noise_m=st.floats(0.0, 0.03),
    seed=st.integers(0, 999),
)
def test_bodies_are_one_person_only_if_near(apart_m, direction, headings, hidden, noise_m, seed):
    """In any direction, posture and visibility: near is one, far is two, whatever the noise."""
    one = body(0.0, 0.0, headings[0], noise_m=noise_m, seed=seed)
    x, y = apart_m * np.cos(direction), apart_m * np.sin(direction)
    other = body(x, y, headings[1], hidden=hidden, noise_m=noise_m, seed=seed + 1)
    found, joined = step(Identities(SAME_M, APART_M), 0, (0, 7, one), (1, 3, other))
    median, sides = median_m(one, other), sides_m(one, other)
    assume(median is None or abs(max(median, sides) - SAME_M) > ROUNDING_M)
    is_one = median is not None and max(median, sides) <= SAME_M
    assert (found[0, 7] == found[1, 3]) == is_one
    assert joined == ()
    if apart_m > 0.5:  # of two who stand on their own feet, whatever their headings and noise
        assert found[0, 7] != found[1, 3]


@given(
    steps=st.lists(
        st.lists(
            st.tuples(
                st.integers(0, 2), st.integers(0, 3), st.floats(-1, 1), st.floats(-1, 1),
                st.integers(0, 21),
            ),
            max_size=8,
        ),
        min_size=1,
        max_size=6,
    )
)  # fmt: skip
def test_no_body_is_lost_and_no_person_has_two_of_one_sensor(steps):
    """Whatever three sensors show: all bodies are people, and ids are those of the wire."""
    identities = Identities(SAME_M, APART_M)
    for index, bodies in enumerate(steps):
        shown = {}
        for sensor, number, x, y, hidden in bodies:
            shown[seen(sensor, number)] = body(x, y, number=number, hidden=range(hidden))
        people, joined = identities.step(shown, index * 40 * MS)
        of = [s for person in people for s in person.seen.values()]
        assert sorted(of) == sorted(shown)
        assert all(sensor == s.sensor for p in people for sensor, s in p.seen.items())
        ids = [person.id for person in people]
        assert len(set(ids)) == len(ids)
        assert all(1 <= number <= MAX_ID for number in ids)
        assert all(gone not in ids and kept in ids for gone, kept in joined)


@given(apart_m=st.floats(0.3, 2.0), direction=st.floats(-np.pi, np.pi), seed=st.integers(0, 99))
def test_two_people_of_whom_each_sensor_sees_one_are_two(apart_m, direction, seed):
    identities = Identities(SAME_M, APART_M)
    x, y = apart_m * np.cos(direction), apart_m * np.sin(direction)
    for k in range(40):
        one = body(noise_m=0.01, seed=seed + k)
        other = body(x, y, noise_m=0.01, seed=seed + 1000 + k)
        found, joined = step(identities, 40 * k, (0, 1, one), (1, 1, other))
        assert found[0, 1] != found[1, 1]
        assert joined == ()


def test_a_second_body_that_could_be_meant_keeps_them_apart():
    """One sensor sees two people close together, the other only one of them: it says not which."""
    found, _ = step(
        Identities(SAME_M, APART_M), 0, (0, 1, body()), (1, 1, body(0.05)), (1, 2, body(0.2))
    )
    assert len(set(found.values())) == 3


def test_ids_stay_when_one_sensor_loses_the_person_and_finds_him():
    identities = Identities(SAME_M, APART_M)
    both, _ = step(identities, 0, (0, 7, body()), (1, 3, body(0.05)))
    alone, _ = step(identities, 40, (1, 3, body(0.06)))
    again, _ = step(identities, 80, (0, 7, body(0.01)), (1, 3, body(0.06)))
    other_id, _ = step(identities, 120, (0, 8, body(0.01)), (1, 3, body(0.06)))
    ids = [*both.values(), *alone.values(), *again.values(), *other_id.values()]
    assert len(set(ids)) == 1


def test_hysteresis_keeps_one_person_one_up_to_the_larger_limit():
    identities = Identities(SAME_M, APART_M)
    step(identities, 0, (0, 7, body()), (1, 3, body(0.1)))
    found, _ = step(identities, 40, (0, 7, body()), (1, 3, body(0.24)))
    assert len(set(found.values())) == 1
    found, _ = step(identities, 80, (0, 7, body()), (1, 3, body(0.26)))
    assert len(set(found.values())) == 2


def test_who_is_split_is_the_body_that_moved_away():
    identities = Identities(SAME_M, APART_M)
    before, _ = step(identities, 0, (0, 7, body()), (1, 3, body()))
    found, _ = step(identities, 40, (0, 7, body(1.0)), (1, 3, body(0.02)))
    assert found[1, 3] == before[1, 3]
    assert found[0, 7] != before[0, 7]


@pytest.mark.parametrize("sensor", [0, 1])
def test_ids_that_a_sensor_swaps_change_no_person(sensor):
    identities = Identities(SAME_M, APART_M)
    places = {1: body(), 2: body(1.0)}
    before, _ = step(identities, 0, *((s, n, places[n]) for s in (0, 1) for n in (1, 2)))
    swapped = {s: {1: places[2], 2: places[1]} if s == sensor else places for s in (0, 1)}
    found, joined = step(identities, 40, *((s, n, swapped[s][n]) for s in (0, 1) for n in (1, 2)))
    other = 1 - sensor
    assert {n: found[other, n] for n in (1, 2)} == {n: before[other, n] for n in (1, 2)}
    assert (found[sensor, 1], found[sensor, 2]) == (before[other, 2], before[other, 1])
    assert joined == ()


def test_people_who_swap_within_the_limit_are_shown_more_than_once_never_less():
    """Two people 0.22 m apart, whose ids one sensor swaps: each of them is shown somewhere."""
    identities = Identities(SAME_M, 0.25)
    p, q = body(), body(0.22)
    step(identities, 0, (0, 1, body()), (1, 1, body()), (0, 2, body(2.0)), (1, 2, body(2.0)))
    found, _ = step(identities, 40, (0, 1, q), (1, 1, p), (0, 2, p), (1, 2, q))
    of = {(0, 1): "q", (1, 1): "p", (0, 2): "p", (1, 2): "q"}
    shown: dict[int, set[str]] = {}
    for key, number in found.items():
        shown.setdefault(number, set()).add(of[key])
    assert all(len(who) == 1 for who in shown.values())
    assert set.union(*shown.values()) == {"p", "q"}


def test_one_person_shown_as_two_is_joined_after_a_while_and_the_younger_id_goes():
    identities = Identities(SAME_M, APART_M)
    first, _ = step(identities, 0, (0, 1, body()), (1, 1, body(0.2)))
    younger = first[1, 1]
    for k in range(1, 100):
        found, joined = step(identities, 40 * k, (0, 1, body()), (1, 1, body(0.05)))
        if joined:
            break
    assert joined == ((younger, first[0, 1]),)
    assert set(found.values()) == {first[0, 1]}
    assert JOIN_S * 1000 <= 40 * (k - 1) <= JOIN_S * 1000 + 80


def test_one_capture_that_speaks_against_it_starts_the_wait_again():
    identities = Identities(SAME_M, APART_M)
    step(identities, 0, (0, 1, body()), (1, 1, body(0.2)))
    for k in range(1, 60):
        other = body(0.3 if k % 10 == 0 else 0.05)
        _, joined = step(identities, 40 * k, (0, 1, body()), (1, 1, other))
        assert joined == ()


def test_a_body_without_a_joint_stays_with_its_person_and_joins_no_other():
    identities = Identities(SAME_M, APART_M)
    nothing = body(hidden=range(len(JOINTS)))
    before, _ = step(identities, 0, (0, 1, body()), (1, 1, body()))
    found, _ = step(identities, 40, (0, 1, body()), (1, 1, nothing), (1, 2, nothing))
    assert found[1, 1] == before[0, 1]
    assert found[1, 2] != before[0, 1]


def test_one_side_of_a_body_is_not_enough_until_both_are_seen():
    """It could be the side of another person, who stands shoulder to shoulder."""
    identities = Identities(SAME_M, APART_M)
    right = [i for i, name in enumerate(JOINTS) if name.startswith("r_")]
    found, _ = step(identities, 0, (0, 1, body()), (1, 1, body(hidden=right)))
    assert found[0, 1] != found[1, 1]
    found, _ = step(identities, 40, (0, 1, body()), (1, 2, body()))
    assert found[0, 1] == found[1, 2]


def test_bodies_with_too_few_joints_in_common_are_two():
    legs = [i for i, name in enumerate(JOINTS) if "knee" in name or "ankle" in name]
    trunk = [i for i in range(len(JOINTS)) if i not in legs]
    found, _ = step(
        Identities(SAME_M, APART_M), 0, (0, 1, body(hidden=legs)), (1, 1, body(hidden=trunk))
    )
    assert found[0, 1] != found[1, 1]


def test_ids_are_not_given_twice_within_what_is_remembered():
    identities = Identities(SAME_M, APART_M)
    given_ids = [step(identities, k, (0, k, body()))[0][0, k] for k in range(3000)]
    assert len(set(given_ids)) == 3000
