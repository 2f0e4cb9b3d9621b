"""Protective distance and speed limits against closed forms, brute force and simulation."""

import math

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from hri_predict.risk.permitted import by_standard, person_travel
from hri_predict.risk.separation.now import Braking, judge_iso
from hri_predict.risk.terms import protective_distance
from hri_predict.robots.stopping import StoppingCurve
from tests.hri_predict.risk.separation.curves import constant

speeds = st.floats(0, 2.5)
decelerations = st.floats(0.5, 30)
reactions = st.floats(0.01, 0.6)
clearances = st.floats(0, 0.3)


def speed_limit(distance_m, reaction_s, deceleration_m_s2, clearance_m):
    """S_p solved for the speed at constant deceleration, as CNR-STIIMA-IRAS/ssm_safety has it.

    With T_s = v / a and S_s = v^2 / 2a: v = sqrt(v_h^2 + (a T_r)^2 + 2a(d - C)) - a T_r - v_h.
    """
    v_h = 1.6 if distance_m >= 0.5 else 2.0
    a_t = deceleration_m_s2 * reaction_s
    square = v_h**2 + a_t**2 + 2.0 * deceleration_m_s2 * (distance_m - clearance_m)
    return max(0.0, math.sqrt(max(square, 0.0)) - a_t - v_h)


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
    assert s.s_h == pytest.approx(1.6 * (0.3 + 0.25))  # until it stops, not only until it brakes
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
    if abs(d - 0.5) < 1e-9:  # on the plateau several speeds need the same distance
        found = speed_limit(0.5, reaction_s, a, clearance)
        assert found >= v - 1e-6
        assert required(found, a, reaction_s, clearance) <= 0.5 + 1e-6
    else:
        assert speed_limit(d, reaction_s, a, clearance) == pytest.approx(v, abs=1e-6)


def highest(
    curve: StoppingCurve, distance_m: float, reaction_s: float, clearance_m: float
) -> tuple[float, ...]:
    terms = clearance_m, 0.0
    return curve.highest(by_standard(curve.arrays, reaction_s, terms, np.array([distance_m]))[1])


@given(st.floats(-0.5, 4), decelerations, reactions, clearances)
@example(math.nextafter(0.5, 0.0), 5.0, 0.1, 0.0)
def test_the_table_agrees_with_the_closed_form(d, a, reaction_s, clearance):
    curve = constant(a)
    exact = min(speed_limit(d, reaction_s, a, clearance), 2.5)
    (found,) = highest(curve, d, reaction_s, clearance)
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
        (found,) = highest(curve, d + 1e-9, reaction_s, 0.1)
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
    braking = Braking(
        speed_m_s=v,
        stopping=curve.at(v),
        curve=curve,
        reaction_s=0.3,
        clearance_m=0.05,
        margins_m=margins,
    )
    far, near = judge_iso(braking, d), judge_iso(braking, d - nearer)
    assert all(a <= b for a, b in zip(near.limits, far.limits, strict=True))
    assert near.slack_m <= far.slack_m
    assert near.near >= far.near
    assert near.breach_s <= far.breach_s
    assert sorted(far.limits, reverse=True) == list(far.limits)
