"""Protective distance and speed limits against closed forms, brute force and simulation."""

import math

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from hri_predict.risk.geometry import capsule_distance
from hri_predict.risk.nearest_in_time import (
    BodiesInTime,
    Courses,
    NearestInTime,
    nearest_in_time,
)
from hri_predict.risk.separation import (
    Finding,
    StoppingCurve,
    person_travel,
    protective_distance,
    speed_limit,
    travel_m,
)
from hri_predict.risk.separation_in_time import Course, TimeByTime, farthest
from hri_predict.risk.separation_now import judge_iso
from hri_predict.risk.types import Capsules
from hri_predict.scene import Floats

speeds = st.floats(0, 2.5)
decelerations = st.floats(0.5, 30)
reactions = st.floats(0.01, 0.6)
clearances = st.floats(0, 0.3)


def constant(deceleration: float, top: float = 2.5) -> StoppingCurve:
    return StoppingCurve.of(lambda v: (v / deceleration, v * v / (2 * deceleration)), top)


def required(v: float, a: float, reaction_s: float, clearance: float) -> float:
    return protective_distance(v, reaction_s, v / a, v * v / (2 * a), intrusion_m=clearance).total


@pytest.mark.parametrize(("reaction_s", "metres"), [(0.05, 0.70), (0.5, 2.32)])
def test_the_worked_example(reaction_s, metres):
    # v_r 2 m/s, a 10 m/s2, v_h 1.6 m/s, C 0
    assert required(2.0, 10.0, reaction_s, 0.0) == pytest.approx(metres)


def test_terms():
    s = protective_distance(
        1.0,
        0.3,
        0.25,
        0.2,
        intrusion_m=0.1,
        person_uncertainty_m=0.05,
        robot_uncertainty_m=0.02,
    )
    assert s.s_h == pytest.approx(1.6 * (0.3 + 0.25))  # until it stands, not only until it brakes
    assert s.s_r == pytest.approx(1.0 * 0.3)
    assert (s.s_s, s.c, s.z_d, s.z_r) == (0.2, 0.1, 0.05, 0.02)
    assert s.total == pytest.approx(0.88 + 0.3 + 0.37)


def test_the_boundary_at_half_a_metre():
    def total(time_s: float) -> float:
        return protective_distance(0.0, time_s, 0.0, 0.0).total

    assert total(0.2) == pytest.approx(0.4)  # 2.0 m/s
    assert total(0.25) == pytest.approx(0.5)  # 2.0 m/s just fits
    assert total(0.2501) == pytest.approx(0.5)  # 1.6 m/s would give 0.40016: at least 0.5 m
    assert total(0.3) == pytest.approx(0.5)
    assert total(0.3125) == pytest.approx(0.5)  # 1.6 m/s reaches 0.5 m here
    assert total(0.4) == pytest.approx(0.64)
    # the other terms count towards the half metre
    assert protective_distance(0.0, 0.2, 0.0, 0.0, intrusion_m=0.2).total == pytest.approx(0.52)
    assert protective_distance(0.0, 0.2, 0.0, 0.0, intrusion_m=0.12).total == pytest.approx(0.5)


@given(st.floats(0, 2), st.floats(0, 2), st.floats(0, 0.1), st.floats(0, 0.1))
def test_the_required_distance_never_falls(time_s, other, more_time, more_other):
    less = other + person_travel(time_s, other)
    more = other + more_other + person_travel(time_s + more_time, other + more_other)
    assert more >= less - 1e-12


@given(speeds, decelerations, reactions, clearances)
def test_round_trip_through_the_closed_form(v, a, reaction_s, clearance):
    d = required(v, a, reaction_s, clearance)
    found = speed_limit(d, reaction_s, a, clearance)
    if abs(d - 0.5) < 1e-9:  # on the plateau several speeds need the same distance
        assert found >= v - 1e-6
        assert required(found, a, reaction_s, clearance) <= 0.5 + 1e-6
    else:
        assert found == pytest.approx(v, abs=1e-6)


@given(st.floats(-0.5, 4), decelerations, reactions, clearances)
def test_the_table_agrees_with_the_closed_form(d, a, reaction_s, clearance):
    curve = constant(a)
    exact = min(speed_limit(d, reaction_s, a, clearance), 2.5)
    (found,) = curve.speed_limits([d], curve.required_m(reaction_s, clearance))
    assert found <= exact + 1e-9
    assert found >= exact - 2.5 / 256 - 1e-6


@given(
    st.lists(st.tuples(st.floats(0.01, 0.5), st.floats(0, 0.4)), min_size=3, max_size=6), reactions
)
def test_a_measured_table_is_inverted(steps, reaction_s):
    times = np.cumsum([t for t, _ in steps])
    distances = np.cumsum([d for _, d in steps])
    at = np.linspace(0, 1.5, len(steps))
    curve = StoppingCurve.of(
        lambda v: (float(np.interp(v, at, times)), float(np.interp(v, at, distances))), 1.5
    )
    for v in (0.0, 0.4, 1.1, 1.5):
        d = protective_distance(v, reaction_s, *curve.at(v), intrusion_m=0.1).total
        (found,) = curve.speed_limits([d + 1e-9], curve.required_m(reaction_s, 0.1))
        assert found >= v - 1.5 / 256
        assert (
            protective_distance(found, reaction_s, *curve.at(found), intrusion_m=0.1).total
            <= d + 1e-6
        )


def test_a_stopping_table_that_is_no_number_is_refused():
    with pytest.raises(ValueError, match="finite"):
        StoppingCurve.of(lambda v: (math.nan, 0.0), 1.0)


@given(st.floats(0, 3), st.floats(0, 1), speeds)
def test_iso_nearer_is_never_faster(d, nearer, v):
    curve, margins = constant(5.0), (0.0, 0.1, 0.5)
    far = judge_iso(d, v, curve.at(v), curve, 0.3, 0.05, margins)
    near = judge_iso(d - nearer, v, curve.at(v), curve, 0.3, 0.05, margins)
    assert all(a <= b for a, b in zip(near.limits, far.limits, strict=True))
    assert near.slack_m <= far.slack_m
    assert near.near >= far.near
    assert near.breach_s <= far.breach_s
    assert sorted(far.limits, reverse=True) == list(far.limits)


# -- nearest in time ---------------------------------------------------------------------------


@settings(max_examples=60, deadline=None)
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


@settings(max_examples=60, deadline=None)
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


@settings(max_examples=40, deadline=None)
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


# -- predictive: a robot on a line, simulated finely ---------------------------------------------

TIMES = np.arange(31) / 25.0


def line(v: float, a: float, reaction_s: float, t: Floats) -> Floats:
    """Oracle: where a robot on a line is that brakes at ``reaction_s`` with ``a``."""
    braking = np.clip(t - reaction_s, 0, v / a)
    return v * np.minimum(t, reaction_s) + v * braking - a * braking**2 / 2


def along(distance: float, approach: float, v: float, a: float, reaction_s: float) -> Floats:
    """Least distance in each step from a robot at 0 moving at ``v`` (towards is positive)."""
    fine = np.linspace(TIMES[:-1], TIMES[1:], 21)
    person = distance - approach * TIMES[1:]
    robot = np.sign(v) * line(abs(v), a, reaction_s, fine)
    return person - robot.max(0)


def course(
    distance: float, approach: float, a: float, reaction_s: float, direction: float
) -> Course:
    def nearest(least: Floats) -> NearestInTime:
        nobody = np.full(least.shape, -1)
        return NearestInTime(least, nobody, nobody, nobody)

    standing = nearest(distance - approach * TIMES[1:])
    if direction == 0:
        return Course(distance, standing)

    def at_speeds(speeds: Floats, enough: Floats) -> NearestInTime:
        rows = [along(distance, approach, direction * v, a, reaction_s) for v in speeds]
        counts = TIMES[:-1] <= (reaction_s + speeds / a)[:, None]
        return nearest(np.minimum(np.where(counts, rows, np.inf).min(1), enough))

    return Course(distance, standing, at_speeds)


def judged_in_time(
    of: Course,
    v: float,
    curve: StoppingCurve,
    reaction_s: float,
    margins: tuple[float, ...],
) -> Finding:
    """Judged at ``v`` with a clearance of 0.1 m."""
    far = farthest(curve, TIMES, reaction_s)
    judging = TimeByTime(TIMES, v, curve.at(v), curve, reaction_s, 0.1, margins, far)
    return judging.judged(of)


@given(
    st.floats(0.1, 2.5), st.floats(0, 2), st.floats(0, 1.5), st.floats(2, 20), st.floats(0.05, 0.3)
)
def test_a_robot_within_its_limit_keeps_clear_in_any_direction(d, approach, v, a, reaction_s):
    curve = constant(a, 1.5)
    assume(reaction_s + 1.5 / a < TIMES[-1])
    finding = judged_in_time(course(d, approach, a, reaction_s, 0), v, curve, reaction_s, (0, 0.2))
    for limit, margin in zip(finding.limits, (0, 0.2), strict=True):
        t = np.linspace(0, reaction_s + limit / a, 200)
        gap = (d - approach * t - line(limit, a, reaction_s, t)).min()
        assert limit == 0 or gap >= 0.1 + margin - 1e-9
        more = min(limit + 0.2, 1.5)
        if more > limit + 0.1:  # not needlessly low: a step of time and of speed is all it gives up
            t = np.linspace(0, reaction_s + more / a, 200)
            gap = (d - approach * t - line(more, a, reaction_s, t)).min()
            assert gap < 0.1 + margin + (approach + more) / 25 + 0.02


def test_moving_away_permits_more_than_moving_near():
    curve = constant(5.0, 1.5)
    limits = {
        direction: judged_in_time(
            course(0.9, 1.0, 5.0, 0.2, direction), 0.3, curve, 0.2, (0.2, 0.3)
        ).limits
        for direction in (-1.0, 0.0, 1.0)
    }
    assert limits[-1.0] == (1.5, 1.5)
    assert limits[1.0][0] >= limits[0.0][0]
    assert limits[0.0][0] < 1.0


@given(
    st.floats(0, 2.5),
    st.floats(0, 0.5),
    st.floats(0, 2),
    st.floats(0.05, 1.5),
    st.sampled_from([-1.0, 0.0, 1.0]),
)
def test_predictive_nearer_is_never_faster(d, nearer, approach, v, direction):
    curve, margins = constant(5.0, 1.5), (0.25, 0.35, 0.75, 0.85)

    def judged(distance: float):
        return judged_in_time(
            course(distance, approach, 5.0, 0.2, direction), v, curve, 0.2, margins
        )

    far, near = judged(d), judged(d - nearer)
    assert all(a <= b for a, b in zip(near.limits, far.limits, strict=True))
    assert near.near >= far.near


def test_time_to_breach_is_zero_once_the_separation_is_violated():
    curve = constant(5.0, 1.5)
    # the gap is 1.0 - 1.0 t - 1.0 t: 0.1 at 0.45 s, while the robot (reaction 0.5 s) still moves
    finding = judged_in_time(course(1.0, 1.0, 5.0, 0.5, 1.0), 1.0, curve, 0.5, (0.2, 0.3))
    assert finding.slack_m < 0
    assert finding.breach_s == 0.0


@given(st.floats(0, 1.5), st.floats(2, 20), st.floats(0.05, 0.3))
def test_travel_is_that_of_uniform_deceleration(v, a, reaction_s):
    t = np.linspace(0, 1.2, 50)
    exact = line(v, a, reaction_s, t)
    assert np.allclose(travel_m(t, reaction_s, v, v / a, v * v / (2 * a)), exact)
    # a table whose distance is longer is not undercut
    assert (travel_m(t, reaction_s, v, v / a, v * v / a) >= exact - 1e-12).all()
