"""The nearest pair over time is that of all pairs."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hri_predict.base.geometry import Capsules, capsule_distance
from hri_predict.risk.separation.nearest import (
    BodiesInTime,
    Courses,
    nearest_in_time,
)

# -- nearest in time ---------------------------------------------------------------------------


@given(
    st.integers(0, 2**32 - 1),
    st.tuples(st.integers(1, 3), st.integers(1, 4), st.integers(1, 5), st.integers(1, 4)),
)
def test_nearest_is_that_of_all_pairs(seed, shape):
    rng = np.random.default_rng(seed)
    people, steps, segments, links = shape

    def capsules(*batch: int) -> Capsules:
        a = rng.normal(size=(*batch, 3)) * 3
        return Capsules(a, a + rng.normal(size=(*batch, 3)), rng.random(batch))

    body, robot = capsules(people, steps, segments), capsules(steps, links)
    found = nearest_in_time(body, robot)
    for k in range(steps):
        every = np.array(
            [
                [
                    [
                        capsule_distance(
                            Capsules(body.a[p, k, s], body.b[p, k, s], body.radius[p, k, s]),
                            Capsules(robot.a[k, c], robot.b[k, c], robot.radius[k, c]),
                        )
                        for c in range(links)
                    ]
                    for s in range(segments)
                ]
                for p in range(people)
            ]
        )
        assert found.distance[k] == pytest.approx(every.min())
        assert every[found.person[k], found.segment[k], found.link[k]] == pytest.approx(every.min())


def drawn(rng: np.random.Generator, *batch: int) -> Capsules:
    """Capsules anywhere within some metres."""
    a = rng.normal(size=(*batch, 3)) * 2
    return Capsules(a, a + rng.normal(size=(*batch, 3)) * 0.5, rng.random(batch) * 0.3)


@given(st.integers(0, 2**32 - 1), st.floats(-0.5, 3))
def test_least_is_that_of_the_steps_that_count(seed, enough):
    rng = np.random.default_rng(seed)

    body, robot, until = drawn(rng, 3, 6, 4), drawn(rng, 3, 6, 2), np.array([1, 4, 9])
    asked = Courses(robot, until, np.array([np.inf, np.inf, enough]))
    (found,) = BodiesInTime(body).least([asked])
    a, b, radius = (v[:, :, None] for v in (robot.a, robot.b, robot.radius))
    of_robot = Capsules(a[:, :, :, :, None], b[:, :, :, :, None], radius[..., None])
    swapped = [v.swapaxes(0, 1)[:, :, None] for v in (body.a, body.b, body.radius)]
    every = capsule_distance(Capsules(*swapped), of_robot)  # (L, K, P, C, S)
    for course, last in enumerate(until):
        least = every[course, 1 : last + 1].min()
        assert found.distance[course] == min(least, enough if course == 2 else np.inf)
        if least == found.distance[course]:
            at = found.person[course], found.link[course], found.segment[course]
            assert (every[course, 1 : last + 1][:, *at] == least).any()


@given(st.integers(0, 2**32 - 1), st.floats(-0.5, 3))
def test_robots_together_are_as_one_by_one(seed, enough):
    rng = np.random.default_rng(seed)

    bodies = BodiesInTime(drawn(rng, 3, 6, 4))
    robots = [drawn(rng, 2), drawn(rng, 4), drawn(rng, 1)]  # not equally many links each
    ways = [
        Courses(drawn(rng, 2, 5, 2), np.array([4, 2]), np.array([np.inf, enough])),
        Courses(drawn(rng, 1, 6, 3), np.array([9]), np.array([enough])),
    ]
    ways[1].capsules.a[0, 2, 1, 0] = np.nan if seed % 2 else 0.0
    alone = [bodies.standing([r], [n])[0] for r, n in zip(robots, (6, 3, 1), strict=True)]
    alone += [bodies.least([way])[0] for way in ways]
    together = bodies.standing(robots, [6, 3, 1]) + bodies.least(ways)
    for one, among in zip(alone, together, strict=True):
        for name in ("distance", "person", "segment", "link"):
            assert getattr(one, name).tolist() == getattr(among, name).tolist()


def test_least_is_minus_infinity_where_anything_is_not_finite():
    body = Capsules(np.zeros((1, 3, 2, 3)) + 5, np.zeros((1, 3, 2, 3)) + 6, np.full((1, 3, 2), 0.1))
    robot = Capsules(np.zeros((2, 3, 1, 3)), np.zeros((2, 3, 1, 3)), np.full((2, 3, 1), 0.1))
    robot.a[1, 2, 0, 1] = np.nan
    for until, expected in ((1, False), (2, True)):
        asked = Courses(robot, np.full(2, until), np.full(2, 1.0))
        (found,) = BodiesInTime(body).least([asked])
        assert found.distance[0] == 1.0
        assert (found.distance[1] == -np.inf) == expected


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_what_is_not_finite_is_never_far(value):
    body = Capsules(np.zeros((1, 2, 3, 3)) + 5, np.zeros((1, 2, 3, 3)) + 6, np.full((1, 2, 3), 0.1))
    robot = Capsules(np.zeros((2, 1, 3)), np.zeros((2, 1, 3)), np.full((2, 1), 0.1))
    assert (nearest_in_time(body, robot).distance > 0).all()
    body.a[0, 1, 2, 0] = value
    distance = nearest_in_time(body, robot).distance
    assert distance[0] > 0
    assert distance[1] == -np.inf
