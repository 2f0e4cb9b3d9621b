"""A state counts as new when its heartbeat changed, and says no more than was read."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

pytest.importorskip("pymodbus", reason="pymodbus is not installed: the link cannot be used")
from hri_drivers.links.modbus_client.link import RegisterState
from hri_drivers.links.polled.reader import LONGEST_STEP_S, Sample, StateReader
from hri_predict.protocol.messages import RobotMode
from hri_predict.protocol.reception import ReceiveCounters

TWO = {
    "heartbeat": 0,
    "joints": [
        {"position": 10, "velocity": 20, "sign": -1, "offset_rad": 0.5},
        {"position": 12, "velocity": 22, "scale": 0.5},
    ],
    "scale": 0.1,
}
DERIVED = {"heartbeat": 0, "tick_s": 0.01, "joints": [{"position": 10}], "automatic": True}
EPS = 1e-12  # a few operations on numbers around 1


def reader(state, max_age_s=0.1, delay_s=0.0):
    counters = ReceiveCounters()
    return StateReader(RegisterState(**state), max_age_s, delay_s, counters), counters


def read(made, *values, span_s=0.02, why=""):
    return made.read(Sample(values, span_s, why))


def test_the_first_reading_of_a_connection_says_nothing():
    made, counters = reader(TWO)
    assert read(made, 7, 1.0, 2.0, 3.0, 4.0, span_s=None) is None
    assert read(made, 7, 1.0, 2.0, 3.0, 4.0) is None  # the heartbeat has not moved since
    assert read(made, 8, 1.0, 2.0, 3.0, 4.0).counter == 1
    made.restart()
    assert read(made, 9, 1.0, 2.0, 3.0, 4.0) is None
    assert counters.malformed == 0


@pytest.mark.parametrize("gap", [(None, 0.0, 0.0, 0.0, 0.0), (6, 0.0)])
def test_a_change_after_a_gap_may_be_as_old_as_the_gap(gap):
    made, _ = reader(TWO)
    read(made, 5, 0.0, 0.0, 0.0, 0.0)
    assert read(made, 6, 0.0, 0.0, 0.0, 0.0).counter == 1
    assert read(made, *gap) is None
    assert read(made, 7, 0.0, 0.0, 0.0, 0.0) is None
    assert read(made, 8, 0.0, 0.0, 0.0, 0.0).counter == 2


def test_a_velocity_may_decay_to_any_small_number():
    made, counters = reader(TWO)
    read(made, 1, 0.0, 0.0, 0.0, 0.0)
    state = read(made, 2, 0.0, 1e-200, 0.0, 0.0)
    assert math.isclose(state.velocities[0], -1e-201, rel_tol=1e-12)
    assert counters.malformed == 0


def test_derived_velocities_are_those_of_half_a_step_ago():
    made, _ = reader(DERIVED, max_age_s=0.03)  # 20 ms of span, and half of each step
    read(made, 1, 0.0)
    read(made, 2, 0.0)
    assert read(made, 3, 0.01).velocities == pytest.approx((1.0,))
    assert read(made, 6, 0.04) is None
    assert "can be 0.035 s old" in made.refused


def test_scale_sign_and_offset_make_rad():
    made, _ = reader(TWO)
    read(made, 1, 0.0, 0.0, 0.0, 0.0)
    # values in the order of the places: position and velocity of joint 1, then of joint 2
    state = read(made, 2, 3.0, 10.0, 4.0, 6.0)
    assert state.positions == pytest.approx((-0.3 + 0.5, 2.0), abs=EPS)
    assert state.velocities == pytest.approx((-1.0, 3.0), abs=EPS)
    assert state.mode is RobotMode.UNKNOWN


def test_a_heartbeat_that_stands_still_repeats_the_counter():
    made, counters = reader(TWO)
    read(made, 1, 0.0, 0.0, 0.0, 0.0)
    new = read(made, 2, 1.0, 0.0, 1.0, 0.0)
    assert read(made, 2, 9.0, 9.0, 9.0, 9.0) is new
    assert read(made, 1, 1.0, 0.0, 1.0, 0.0).counter == 2  # a bit that toggles is a heartbeat
    assert counters.received == 2


def test_a_state_that_can_be_too_old_is_refused_and_counted():
    made, counters = reader(TWO, max_age_s=0.05, delay_s=0.02)
    read(made, 1, 0.0, 0.0, 0.0, 0.0)
    assert read(made, 2, 0.0, 0.0, 0.0, 0.0, span_s=0.031) is None
    assert counters.malformed == 1
    assert "can be 0.051 s old" in made.refused
    assert read(made, 3, 0.0, 0.0, 0.0, 0.0, span_s=0.029).counter == 1


@pytest.mark.parametrize("absurd", [math.nan, math.inf, -1e30, 1e-30, None])
def test_what_no_robot_reports_is_counted_and_passed_on_as_no_number(absurd):
    made, counters = reader(TWO)
    read(made, 1, 0.0, 0.0, 0.0, 0.0)
    state = read(made, 2, 0.0, 0.0, absurd, 0.0)
    assert math.isnan(state.positions[1])  # so the node finds the state invalid at once
    assert counters.malformed == 1
    assert "joint 2 position" in made.refused


def test_only_the_values_named_are_automatic_mode():
    state = TWO | {"mode": 1, "automatic_values": [1, 5]}
    made, _ = reader(state)
    read(made, 1, 1, 0.0, 0.0, 0.0, 0.0)
    modes = [read(made, 2 + k, mode, 0.0, 0.0, 0.0, 0.0).mode for k, mode in enumerate((5, 2, 0))]
    assert modes == [RobotMode.AUTOMATIC, RobotMode.UNKNOWN, RobotMode.UNKNOWN]


@pytest.mark.parametrize("value", [2**32 - 1, -(2**31), 1_500_000_000])
def test_any_mode_that_the_settings_permit_can_be_automatic(value):
    made, counters = reader(TWO | {"mode": 1, "automatic_values": [value]})
    read(made, 1, value, 0.0, 0.0, 0.0, 0.0)
    assert read(made, 2, value, 0.0, 0.0, 0.0, 0.0).mode is RobotMode.AUTOMATIC
    assert read(made, 3, math.inf, 0.0, 0.0, 0.0, 0.0).mode is RobotMode.UNKNOWN
    assert counters.malformed == 1


def test_nanoradians_reach_the_end_of_32_bits():
    joints = [{"position": 10, "velocity": 20}]
    base = {"x": 30, "y": 32, "yaw": 34, "vx": 36, "vy": 38, "yaw_rate": 40, "scale_m": 1e-9}
    made, counters = reader({"heartbeat": 0, "scale": 1e-9, "joints": joints, "base": base})
    most = 2**31 - 1
    read(made, 1, 0, 0, 0, 0, 0, 0, 0, 0)
    state = read(made, 2, most, -most, most, 0, 0, -most, 0, 0)
    assert state.positions == pytest.approx((most * 1e-9,), rel=EPS)
    assert state.velocities == pytest.approx((-most * 1e-9,), rel=EPS)
    assert (state.base.x_m, state.base.vx_m_s) == pytest.approx((most * 1e-9, -most * 1e-9))
    assert counters.malformed == 0
    state = read(made, 3, 2e18, 0, 0, 0, 0, 0, 0, 0)
    assert math.isnan(state.positions[0])
    assert counters.malformed == 1


def test_without_velocities_they_follow_from_the_change_and_the_ticks():
    made, counters = reader(DERIVED)
    read(made, 10, 1.0, span_s=None)
    state = read(made, 12, 1.05)
    assert state.velocities == pytest.approx((2.5,), abs=1e-9)  # 0.05 rad in two ticks
    assert read(made, 3, 1.1) is None  # counts back: it wrapped
    assert counters.incomplete == 1
    assert read(made, 5, 1.1).velocities == pytest.approx((0.0,), abs=EPS)


def test_positions_too_far_apart_in_time_give_no_velocity():
    made, counters = reader(DERIVED)
    read(made, 10, 1.0, span_s=None)
    assert read(made, 11 + round(LONGEST_STEP_S / 0.01), 1.1) is None
    assert counters.malformed == 1
    assert "tick_s" in made.refused


def test_a_base_turns_the_short_way():
    state = DERIVED | {"base": {"x": 1, "y": 3, "yaw": 5}}
    made, _ = reader(state)
    read(made, 1, 0.0, 1.0, 2.0, 3.1)
    found = read(made, 2, 0.0, 1.01, 2.0, -3.1)
    turned = 2 * math.pi - 6.2
    assert found.base.yaw_rate_rad_s == pytest.approx(turned / 0.01, abs=1e-9)
    assert (found.base.x_m, found.base.vx_m_s) == pytest.approx((1.01, 1.0), abs=1e-9)


values = st.one_of(st.none(), st.floats(), st.integers(-(2**63), 2**63))


@given(readings=st.lists(st.lists(values, max_size=6), max_size=6), span_s=st.floats(0, 1))
def test_any_reading_gives_a_state_or_none_and_what_is_short_is_counted(readings, span_s):
    made, counters = reader(TWO)
    for reading in readings:
        state = made.read(Sample(tuple(reading), span_s))
        assert state is None or len(state.positions) == 2
    assert counters.malformed >= sum(len(reading) != 5 for reading in readings)


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"joints": [{"position": 10}]}, "tick_s"),
        ({"joints": [{"position": 10, "velocity": 12}], "tick_s": 0.1}, "remove it"),
        ({"joints": [{"position": 10, "velocity": 12}, {"position": 14}]}, "of all or of none"),
        ({"mode": 5}, "automatic_values"),
        ({"automatic_values": [1]}, "automatic_values"),
        ({"mode": 5, "automatic_values": [1], "automatic": True}, "remove it"),
        ({"joints": [{"position": 10, "velocity": 10}]}, "both at 10"),
        ({"joints": [{"position": 10, "velocity": 11}]}, "lies in the registers 10 to 11"),
        ({"joints": [{"position": 10, "velocity": 300}]}, "125"),
        ({"joints": [{"position": 65_535, "velocity": 65_533}], "heartbeat": 65_500}, "65535"),
        ({"joints": []}, "joints"),
    ],
)
def test_states_that_make_no_sense_are_refused(changes, said):
    with pytest.raises(ValueError, match=said):
        RegisterState(**(TWO | changes))
