"""Distances by direction: never less than the capsules', never more than that of a true body."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hri_predict.base.geometry import Capsules, capsule_distance
from hri_predict.risk.separation import search, search_loops
from hri_predict.risk.separation.nearest import BodiesInTime, Courses
from hri_predict.zones.loops.spheres import UNSEEN
from hri_predict.zones.toward import BINS, NOTHING, Toward, direction_class

JOINTS, TRIES = 4, 60
SEEDS = st.integers(0, 2**32 - 1)


def unit(vectors):
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)


def some_bodies(rng, persons, steps, segments, known=None):
    """Capsules of persons between joints anywhere, and the support of the first ``known``."""
    shape = (persons, steps, JOINTS)
    mid = rng.normal(size=(*shape, 3)) * 0.7
    radius = rng.uniform(0.02, 0.6, shape)
    ends = np.array([[rng.choice(JOINTS, 2) for _ in range(segments)] for _ in range(persons)])
    extra = rng.uniform(0, 0.2, (persons, segments))
    rest = rng.uniform(0, 0.2, shape)
    rest[rng.random(shape) < 0.1] = np.inf  # follows no forecast
    way = unit(rng.normal(size=(*shape, 3)) * [1, 1, 0.3])
    way[rng.random(shape) < 0.3] = 0.0  # still
    toward = Toward(
        ends=ends.astype(np.int64),
        extra=extra,
        mid=mid,
        radius=radius,
        path=mid + rng.normal(size=(*shape, 3)) * 0.1,
        claim=rng.uniform(0, 0.6, shape),
        rest=rest,
        within=np.where(rng.random((persons, JOINTS)) < 0.3, rng.uniform(0, 0.4), 0.0),
        way=way,
        shares=rng.uniform(0.2, 1.0, (persons, steps, BINS)),
    )
    who, step = np.arange(persons)[:, None, None], np.arange(steps)[:, None]
    first, second = ends[:, None, :, 0], ends[:, None, :, 1]
    thick = np.maximum(radius[who, step, first], radius[who, step, second]) + extra[:, None]
    capsules = Capsules(mid[who, step, first], mid[who, step, second], thick)
    return capsules, toward.of(np.arange(persons if known is None else known))


def some_robot(rng, *shape):
    """Links anywhere, some of them of one point, some in the body."""
    a = rng.normal(size=(*shape, 3)) * rng.choice([0.3, 1.5, 4.0])
    along = rng.normal(size=(*shape, 3)) * 0.5
    along[rng.random(shape) < 0.2] = 0.0
    return Capsules(a, a + along, rng.uniform(0, 0.2, shape))


def between(a1, b1, a2, b2):
    """The vector between the nearest points of two segments: of all candidates the shortest."""
    u, v, found = b1 - a1, b2 - a2, []
    for point, start, along, sign in (
        (a1, a2, v, 1), (b1, a2, v, 1), (a2, a1, u, -1), (b2, a1, u, -1)
    ):  # fmt: skip
        share = np.clip((point - start) @ along / max(along @ along, 1e-300), 0, 1)
        found.append(sign * (start + share * along - point))
    matrix = np.array([[u @ u, -u @ v], [-u @ v, v @ v]])
    if abs(np.linalg.det(matrix)) > 1e-12:
        s, t = np.linalg.solve(matrix, [u @ (a2 - a1), -v @ (a2 - a1)])
        if 0 <= s <= 1 and 0 <= t <= 1:
            found.append(a2 + t * v - a1 - s * u)
    return min(found, key=np.linalg.norm)


def pair(people, toward, robot, at, place):
    """Direction, capsules' distance and distance by direction, of a segment and a link."""
    p, k, _ = at
    span = between(people.a[at], people.b[at], robot.a[place], robot.b[place])
    size = np.linalg.norm(span)
    capsules_m = size - people.radius[at] - robot.radius[place]
    if p >= len(toward.extra) or size <= search_loops.LEAST_GAP_M:
        return None, capsules_m, capsules_m
    n = span / size
    ends = toward.ends[p, at[2]]
    far = max(reach_along(toward, (p, k, j), n) for j in ends) + toward.extra[p, at[2]]
    near = min(robot.a[place] @ n, robot.b[place] @ n) - robot.radius[place]
    return n, capsules_m, max(capsules_m, near - far)


def reach_along(toward, joint, n):
    """How far a joint may be along n: by its ball and by what is claimed of its forecast."""
    h = claimed_along(toward, joint, n)
    return min(toward.mid[joint] @ n + toward.radius[joint], toward.path[joint] @ n + h)


def claimed_along(toward, joint, n):
    p, k, j = joint
    share = toward.shares[p, k, direction_class(n, toward.way[joint])]
    claim, within = share * toward.claim[joint], toward.within[p, j]
    if within > 0:
        claim = UNSEEN * np.hypot(claim, within)
    return claim + toward.rest[joint]


def true_joints(rng, toward, joint, n):
    """Places of a joint in its ball that are not farther along n than is claimed. (M, 3)."""
    off = unit(rng.normal(size=(TRIES, 3))) * rng.uniform(0, 1, (TRIES, 1)) ** 0.2
    off[: TRIES // 3] = unit(off[: TRIES // 3] + 2 * n)  # towards the robot, where it hurts most
    place = toward.mid[joint] + toward.radius[joint] * off
    over = (place - toward.path[joint]) @ n - claimed_along(toward, joint, n)
    place = place - np.where(np.isfinite(over), np.maximum(over, 0), 0)[:, None] * n
    inside = np.linalg.norm(place - toward.mid[joint], axis=1) <= toward.radius[joint]
    return place[inside]


def arrays_of(capsules):
    return capsules.a, capsules.b, capsules.radius


def one_course(steps):
    return np.array([0]), np.array([0]), np.array([steps]), np.array([np.inf])


VERSIONS = pytest.mark.parametrize(
    "find", [search.search, search._search_by_arrays], ids=["compiled", "arrays"]
)


def found_by(find, people, toward, robot, courses):
    arrays = arrays_of(people)
    return find((arrays, search.spheres_of(*arrays), toward), arrays_of(robot), courses)


@VERSIONS
@given(SEEDS)
def test_a_body_within_its_claims_is_no_nearer_than_stated(find, seed):
    rng = np.random.default_rng(seed)
    people, toward = some_bodies(rng, 1, 1, 1)
    robot = some_robot(rng, 1, 1)
    (stated,), *_ = found_by(find, people, toward, robot, one_course(1))
    n, capsules_m, _ = pair(people, toward, robot, (0, 0, 0), (0, 0))
    assert stated >= capsules_m - 1e-9
    if n is None:
        return
    first, second = (true_joints(rng, toward, (0, 0, j), n) for j in toward.ends[0, 0])
    many = min(len(first), len(second))
    true = Capsules(first[:many], second[:many], np.full(many, toward.extra[0, 0]))
    link = Capsules(*(v[0] for v in (robot.a, robot.b, robot.radius)))
    # sums of some metres
    assert (capsule_distance(true, link) >= stated - 1e-9).all()


@VERSIONS
@given(SEEDS, st.tuples(*(st.integers(1, n) for n in (3, 4, 3, 3))), st.booleans())
def test_along_a_course_the_nearest_pair_is_that_of_all_pairs(find, seed, shape, some_unknown):
    rng = np.random.default_rng(seed)
    persons, steps, segments, links = shape
    people, toward = some_bodies(rng, persons, steps, segments, persons - (some_unknown and 1))
    robot = some_robot(rng, steps, links)
    (stated,), (p,), (s,), (c,) = found_by(find, people, toward, robot, one_course(steps))
    every = {
        (k, p, s, c): pair(people, toward, robot, (p, k, s), (k, c))[2]
        for k in range(steps) for p in range(persons) for s in range(segments) for c in range(links)
    }  # fmt: skip
    assert stated == pytest.approx(min(every.values()), abs=1e-9)
    own = min(every[k, p, s, c] for k in range(steps))
    assert own == pytest.approx(stated, abs=1e-9)


@VERSIONS
@given(SEEDS, st.floats(-0.3, 1.5))
def test_beyond_what_is_enough_nothing_need_be_known(find, seed, enough):
    rng = np.random.default_rng(seed)
    people, toward = some_bodies(rng, 2, 3, 2)
    robot = some_robot(rng, 3, 2)
    (whole,), *_ = found_by(find, people, toward, robot, one_course(3))
    courses = (*one_course(3)[:3], np.array([enough]))
    (stated,), *_ = found_by(find, people, toward, robot, courses)
    assert stated == min(whole, enough)


@given(SEEDS, st.tuples(*(st.integers(1, n) for n in (3, 4, 3, 3, 3))), st.booleans())
def test_loops_and_arrays_find_the_same_by_direction(seed, shape, damaged):
    rng = np.random.default_rng(seed)
    persons, steps, segments, links, groups = shape
    people, toward = some_bodies(rng, persons, steps, segments, rng.integers(0, persons + 1))
    robot = some_robot(rng, groups * steps, links)
    if damaged:
        every = [*toward[2:], *arrays_of(people)]
        every[rng.integers(len(every))].reshape(-1)[:1] = rng.choice([np.nan, np.inf])
    first = rng.integers(0, steps, groups)
    courses = (
        first,
        rng.integers(0, (groups - 1) * steps + 1, groups),
        rng.integers(1, steps - first + 1),
        np.where(rng.random(groups) < 0.5, rng.normal(), np.inf),
    )
    with np.errstate(all="ignore"):
        loops = found_by(search.search, people, toward, robot, courses)
        arrays = found_by(search._search_by_arrays, people, toward, robot, courses)
    for one, other in zip(loops, arrays, strict=True):
        np.testing.assert_array_equal(one, other)


@VERSIONS
@given(SEEDS)
def test_whole_shares_and_no_support_are_as_capsules(find, seed):
    rng = np.random.default_rng(seed)
    people, toward = some_bodies(rng, 2, 2, 3)
    robot, course = some_robot(rng, 2, 2), one_course(2)
    without = found_by(find, people, NOTHING, robot, course)
    unknown = toward._replace(rest=np.full_like(toward.rest, np.inf))
    spheres = Capsules(people.a, people.a, people.radius)  # where a ball says all
    ends = np.repeat(toward.ends[..., :1], 2, axis=-1)
    radius = np.take_along_axis(toward.radius, ends[..., 0][:, None], axis=2)
    spheres = Capsules(people.a, people.a, radius + toward.extra[:, None])
    by_ball = found_by(find, spheres, unknown._replace(ends=ends), robot, course)
    by_capsule = found_by(find, spheres, NOTHING, robot, course)
    # a ball's extent along n is its radius: sums in another order
    np.testing.assert_allclose(by_ball[0], by_capsule[0], atol=1e-9)
    assert found_by(find, people, unknown, robot, course)[0] >= without[0]


@given(SEEDS)
def test_a_robot_that_may_move_anywhere_is_no_nearer_than_its_way_less(seed):
    """A link whose points move by w at most is no nearer a true body than stated less w."""
    rng = np.random.default_rng(seed)
    people, toward = some_bodies(rng, 1, 1, 1)
    robot = some_robot(rng, 1, 1)
    n, _, stated = pair(people, toward, robot, (0, 0, 0), (0, 0))
    if n is None:
        return
    first, second = (true_joints(rng, toward, (0, 0, j), n) for j in toward.ends[0, 0])
    many, way_m = min(len(first), len(second)), rng.uniform(0, 0.5)
    true = Capsules(first[:many], second[:many], np.full(many, toward.extra[0, 0]))
    a, b = (v[0] + way_m * unit(rng.normal(size=(many, 3))) for v in (robot.a, robot.b))
    link = Capsules(a, b, np.full(many, robot.radius[0, 0]))
    assert (capsule_distance(true, link) >= stated - way_m - 1e-9).all()


def test_of_two_people_the_nearer_one_may_be_the_farther_by_direction():
    """The second ball is 10 cm nearer, but its joint comes less far towards the robot."""
    at = np.zeros((2, 2, 1, 3))
    at[1, ..., 0] = 0.1
    people = Capsules(at, at, np.full((2, 2, 1), 0.5))
    here = np.repeat(at, JOINTS, axis=2)
    toward = Toward(
        ends=np.zeros((2, 1, 2), np.int64), extra=np.zeros((2, 1)),
        mid=here, path=here, way=np.zeros(here.shape),
        radius=np.full(here.shape[:3], 0.5), claim=np.full(here.shape[:3], 0.5),
        rest=np.zeros(here.shape[:3]), within=np.zeros((2, JOINTS)),
        shares=np.ones((2, 2, BINS)),
    )  # fmt: skip
    toward.shares[1] = 0.4  # 0.2 m instead of 0.5
    place = np.array([[2.0, 0.0, 0.0]])
    robot = Capsules(place, place, np.zeros(1))
    for support, expected, who in ((None, 1.4, 1), (toward, 1.5, 0)):
        bodies = BodiesInTime(people, support)
        (found,) = bodies.standing([robot], [2])
        np.testing.assert_allclose(found.distance, expected)
        np.testing.assert_array_equal(found.person, who)
        way = Capsules(*(np.stack([v, v])[None] for v in (robot.a, robot.b, robot.radius)))
        (least,) = bodies.least([Courses(way, np.array([1]), np.array([9.0]))])
        np.testing.assert_allclose(least.distance, expected)
