"""Separation time by time: a robot on a line, simulated finely, keeps clear."""

import numpy as np
from hypothesis import assume, given
from hypothesis import strategies as st

from hri_predict.base.arrays import Floats
from hri_predict.risk.separation.in_time import DistanceCourse, TimeByTime, farthest
from hri_predict.risk.separation.nearest import (
    NearestInTime,
)
from hri_predict.risk.terms import Finding, travel_m
from hri_predict.robots.stopping import StoppingCurve
from tests.hri_predict.risk.separation.curves import constant

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
) -> DistanceCourse:
    def nearest(least: Floats) -> NearestInTime:
        nobody = np.full(least.shape, -1)
        return NearestInTime(least, nobody, nobody, nobody)

    standing = nearest(distance - approach * TIMES[1:])
    if direction == 0:
        return DistanceCourse(distance, standing)

    def at_speeds(speeds: Floats, enough: Floats) -> NearestInTime:
        rows = [along(distance, approach, direction * v, a, reaction_s) for v in speeds]
        counts = TIMES[:-1] <= (reaction_s + speeds / a)[:, None]
        return nearest(np.minimum(np.where(counts, rows, np.inf).min(1), enough))

    return DistanceCourse(distance, standing, at_speeds)


def judged_in_time(
    of: DistanceCourse,
    v: float,
    curve: StoppingCurve,
    reaction_s: float,
    margins: tuple[float, ...],
) -> Finding:
    """Judged at ``v`` with a clearance of 0.1 m."""
    far = farthest(curve, TIMES, reaction_s)
    judging = TimeByTime(
        times_s=TIMES,
        speed_m_s=v,
        stopping=curve.at(v),
        curve=curve,
        reaction_s=reaction_s,
        clearance_m=0.1,
        margins_m=margins,
        farthest_m=far,
    )
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
    assert np.allclose(
        travel_m(
            t, reaction_s=reaction_s, speed_m_s=v, stopping_s=v / a, stopping_m=v * v / (2 * a)
        ),
        exact,
    )
    # a table whose distance is longer is not undercut
    assert (
        travel_m(t, reaction_s=reaction_s, speed_m_s=v, stopping_s=v / a, stopping_m=v * v / a)
        >= exact - 1e-12
    ).all()
