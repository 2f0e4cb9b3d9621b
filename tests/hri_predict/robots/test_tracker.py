"""Where the robot is, and every way of not knowing it."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from hri_predict.base.arrays import Floats
from hri_predict.base.errors import RobotError
from hri_predict.base.files import data_path
from hri_predict.base.settings import Pose
from hri_predict.protocol.messages import RobotMode, RobotState
from hri_predict.protocol.reasons import Reason
from hri_predict.robots.model import RobotModel, RobotSettings, load_robot
from hri_predict.robots.tracker import RobotNow, RobotTracker
from hri_predict.robots.trajectory import load_trajectory

MS = 1_000_000
Q = (0.1, -1.2, 1.5, -1.8, -1.5, 0.2)
QD = (0.5, 0.1, -0.2, 0.0, 0.0, 1.0)


def settings_of(motion: dict[str, Any] | None = None, **more: Any) -> RobotSettings:
    data = {"name": "arm", "model": "ur5e", "room_from_robot": Pose(), "max_speed_m_s": 1.0}
    return RobotSettings.model_validate(
        {**data, "motion": motion or {"kind": "state", "stale_s": 0.1}, **more}
    )


MODEL: RobotModel = load_robot(settings_of(), None)


def tracker(motion: dict[str, Any] | None = None, **more: Any) -> RobotTracker:
    return RobotTracker(settings_of(motion, **more), MODEL)


def state(
    counter: int = 0, q: Any = Q, qd: Any = QD, mode: Any = RobotMode.AUTOMATIC
) -> RobotState:
    return RobotState(robot=0, mode=mode, counter=counter, positions=tuple(q), velocities=tuple(qd))


def known(now: RobotNow) -> tuple[Floats, Floats]:
    assert now.q is not None
    assert now.qd is not None
    return now.q, now.qd


def test_nothing_received_yet() -> None:
    now = tracker().at(0)
    assert now.q is None
    assert now.qd is None
    assert now.reasons == (Reason.ROBOT_STATE_STALE,)


def test_a_good_state_is_carried_on_by_its_velocity() -> None:
    followed = tracker()
    followed.update(state(), 1000 * MS)
    now = followed.at(1040 * MS)
    assert now.reasons == ()
    assert now.q is not None
    np.testing.assert_allclose(known(now)[0], np.array(Q) + 0.04 * np.array(QD))
    np.testing.assert_array_equal(known(now)[1], QD)
    assert now.age_s == pytest.approx(0.04)
    assert now.speed_m_s == pytest.approx(float(MODEL.tip_speed(now.q, np.array(QD))))
    assert now.uncertainty_m == pytest.approx(5.0 * 0.04**2 / 2)


def test_a_state_is_carried_on_over_its_links_delay_too() -> None:
    followed = tracker({"kind": "state", "stale_s": 0.1, "delay_s": 0.1})
    followed.update(state(), 1000 * MS)
    now = followed.at(1040 * MS)
    assert now.reasons == ()  # it is as fresh as it can be
    np.testing.assert_allclose(known(now)[0], np.array(Q) + 0.14 * np.array(QD))
    assert now.uncertainty_m == pytest.approx(5.0 * 0.14**2 / 2)


def test_it_goes_stale_and_recovers() -> None:
    followed = tracker()
    followed.update(state(1), 0)
    assert followed.at(100 * MS).reasons == ()
    late = followed.at(100 * MS + 1)
    assert late.reasons == (Reason.ROBOT_STATE_STALE,)
    much_later = followed.at(10_000 * MS)
    np.testing.assert_allclose(known(much_later)[0], np.array(Q) + 0.1 * np.array(QD))  # no runaway
    followed.update(state(2), 10_000 * MS)
    assert followed.at(10_010 * MS).reasons == ()


def test_a_repeated_counter_does_not_refresh() -> None:
    followed = tracker()
    for k in range(20):
        followed.update(state(7), k * 20 * MS)
    assert followed.at(400 * MS).reasons == (Reason.ROBOT_STATE_STALE,)
    assert followed.counters == {
        "accepted": 1, "repeated": 19, "invalid": 0, "velocity_wrong": 0, "jumped": 0,
        "miscounted": 0, "frozen": 0, "contradicted": 0,
    }  # fmt: skip
    followed.update(state(8), 400 * MS)
    assert followed.at(410 * MS).reasons == ()


def test_links_count_apart() -> None:
    # A frozen sender on one link must not look alive because another link's counter differs.
    followed = tracker()
    followed.update(state(3, q=Q), 0, "serial")
    for k in range(1, 20):
        followed.update(state(k, q=np.array(Q) + 0.01), k * 20 * MS, "can")
        followed.update(state(3, q=Q), k * 20 * MS, "serial")
    assert followed.counters["repeated"] == 19
    now = followed.at(380 * MS)
    np.testing.assert_allclose(known(now)[0], np.array(Q) + 0.01)


@pytest.mark.parametrize("mode", [m for m in RobotMode if m is not RobotMode.AUTOMATIC])
def test_any_other_mode_is_a_reason_of_its_own(mode: RobotMode) -> None:
    followed = tracker()
    followed.update(state(mode=mode), 0)
    now = followed.at(0)
    assert now.reasons == (Reason.ROBOT_NOT_AUTOMATIC,)
    assert now.q is not None


def changed(values: tuple[float, ...], i: int, value: Any) -> tuple[Any, ...]:
    return (*values[:i], value, *values[i + 1 :])


INVALID = {
    "too few joints": state(1, q=Q[:5], qd=QD[:5]),
    "too many joints": state(1, q=(*Q, 0.0), qd=(*QD, 0.0)),
    "velocities missing": state(1, qd=()),
    "NaN position": state(1, q=changed(Q, 2, float("nan"))),
    "NaN velocity": state(1, qd=changed(QD, 2, float("nan"))),
    "infinite": state(1, q=changed(Q, 2, float("inf"))),
    "not available": state(1, q=changed(Q, 2, None)),
    "not a number": state(1, q=changed(Q, 2, "x")),
    "beyond a position limit": state(1, q=changed(Q, 2, 6.4)),
    "beyond the lower limit": state(1, q=changed(Q, 2, -6.4)),
    "beyond a velocity limit": state(1, qd=changed(QD, 2, -3.6)),
}


@pytest.mark.parametrize("case", INVALID, ids=list(INVALID))
def test_an_impossible_state_makes_the_position_unknown(case: str) -> None:
    followed = tracker()
    followed.update(state(0), 0)
    followed.update(INVALID[case], 10 * MS)
    now = followed.at(11 * MS)
    assert now.q is None
    assert now.reasons == (Reason.ROBOT_STATE_INVALID,)
    assert followed.counters["invalid"] == 1
    followed.update(state(2), 20 * MS)
    assert followed.at(21 * MS).reasons == ()


def test_a_rounding_error_beyond_a_limit_is_no_fault() -> None:
    followed = tracker()
    followed.update(state(q=changed(Q, 0, 6.285), qd=changed(QD, 0, 3.15)), 0)
    now = followed.at(50 * MS)
    assert now.reasons == ()
    assert now.q is not None
    assert now.q[0] == pytest.approx(6.285)  # not carried past the limit


numbers = st.one_of(st.floats(), st.none(), st.floats(-7, 7))


@given(
    st.lists(
        st.tuples(
            st.lists(numbers, max_size=8),
            st.lists(numbers, max_size=8),
            st.integers(0, 3),
            st.sampled_from(list(RobotMode)),
        ),
        max_size=6,
    ),
    st.integers(0, 10**10),
)
def test_whatever_comes_the_result_is_finite_or_unknown_with_a_reason(
    states: list[Any], now_ns: int
) -> None:
    followed = tracker()
    for i, (q, qd, counter, mode) in enumerate(states):
        followed.update(state(counter, q, qd, mode), i * 20 * MS)
    now = followed.at(now_ns)
    if now.q is None:
        assert now.reasons
    else:
        assert now.qd is not None
        assert np.isfinite([*now.q, *now.qd, now.speed_m_s, now.uncertainty_m]).all()
    assert sum(followed.counters.values()) == len(states)


@given(st.floats(-5, 5), st.floats(0, 0.1))
def test_uncertainty_covers_a_change_of_speed(acceleration: float, age_s: float) -> None:
    # The base alone turns; the tip speeds up or brakes at up to 5 m/s2 after the state was sent.
    followed = tracker()
    followed.update(state(qd=(0.5, 0, 0, 0, 0, 0)), 0)
    now = followed.at(int(age_s * 1e9))
    assert now.q is not None
    at_one = float(MODEL.tip_speed(np.array(Q), np.array([1.0, 0, 0, 0, 0, 0])))
    angle = acceleration / at_one * age_s**2 / 2
    true = MODEL.capsules(now.q + np.array([angle, 0, 0, 0, 0, 0]))
    shift = np.linalg.norm(true.b - MODEL.capsules(now.q).b, axis=-1)
    assert shift.max() <= now.uncertainty_m + 1e-8


def test_a_trajectory_starts_with_the_first_tick() -> None:
    motion = {"kind": "trajectory", "file": "pick_and_place", "start_s": 0.3}
    followed = tracker(motion)
    path = load_trajectory("pick_and_place", MODEL, None)
    for start, later in ((5000 * MS, 0.0), (5700 * MS, 0.7)):
        now = followed.at(start)
        q, qd = path.at(later + 0.3)
        np.testing.assert_allclose(known(now)[0], q, atol=1e-12)
        np.testing.assert_allclose(known(now)[1], qd, atol=1e-12)
        assert now.reasons == ()
        assert now.speed_m_s == pytest.approx(float(MODEL.tip_speed(q, qd)))
    given_start = RobotTracker(settings_of(motion), MODEL, None, start_ns=4000 * MS)
    np.testing.assert_allclose(known(given_start.at(5000 * MS))[0], path.at(1.3)[0], atol=1e-12)


def test_a_trajectory_faster_than_the_robot_is_said_to_be_is_refused() -> None:
    with pytest.raises(RobotError, match=r"'arm'.*0\.952 m/s.*max_speed_m_s 0\.8"):
        tracker({"kind": "trajectory", "file": "pick_and_place"}, max_speed_m_s=0.8)


def test_a_trajectory_beside_the_configuration(tmp_path: Path) -> None:
    data = yaml.safe_load(data_path("trajectories", "pick_and_place.yaml").read_text())
    (tmp_path / "mine.yaml").write_text(yaml.safe_dump(data))
    motion = {"kind": "trajectory", "file": "mine.yaml"}
    assert RobotTracker(settings_of(motion), MODEL, tmp_path).at(0).q is not None
    with pytest.raises(RobotError, match="cannot be read"):
        RobotTracker(settings_of(motion), MODEL, tmp_path / "elsewhere")


def test_standing() -> None:
    followed = tracker({"kind": "standing", "positions": list(Q)})
    now = followed.at(123)
    np.testing.assert_array_equal(known(now)[0], Q)
    assert now.reasons == ()
    assert now.speed_m_s == 0.0
    with pytest.raises(RobotError, match=r"^motion.positions: 5 values.*6 joints"):
        tracker({"kind": "standing", "positions": list(Q[:5])})
    with pytest.raises(
        RobotError, match=r"^motion.positions: robot 'arm': joint 'elbow' at 7 rad is outside"
    ):
        tracker({"kind": "standing", "positions": list(changed(Q, 2, 7.0))})
