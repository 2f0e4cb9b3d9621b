"""One robot judged in each mode, against values worked by hand."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hri_predict.link import LinkSettings
from hri_predict.protocol.messages import Level
from hri_predict.reasons import Reason
from hri_predict.risk.delay_budget import DelayBudget
from hri_predict.risk.geometry import horizontal_distance
from hri_predict.risk.robot import RobotSettings, load_robot
from hri_predict.risk.robot_judge import RobotJudge
from hri_predict.risk.robot_tracker import RobotNow, RobotTracker
from hri_predict.risk.separation import Finding
from hri_predict.risk.separation_now import judge_fixed
from hri_predict.risk.settings import RiskSettings
from hri_predict.risk.types import Capsules, Zones
from hri_predict.risk.zones import BodyZones
from hri_predict.settings import Pose

READY = np.array([0.0, -1.2, 1.5, -1.8, -1.57, 0.0])
ROBOT = RobotSettings(
    name="arm",
    model="ur5e",
    room_from_robot=Pose(xyz=[1.0, 2.0, 0.5]),
    payload_kg=2.0,
    max_speed_m_s=1.0,
)
MODEL = load_robot(ROBOT, None)
LINK = LinkSettings(name="bus", kind="can", delay_s=0.03, silence_timeout_s=0.1, reaction_s=0.1)
BUDGET = DelayBudget.from_settings(25.0, [LINK], stale_s=0.12)
TIMES = np.arange(31) / 25.0


def judge(mode: str, **risk) -> RobotJudge:
    settings = RiskSettings.model_validate({"mode": mode, **risk})
    return RobotJudge(settings, RobotTracker(ROBOT, MODEL), BUDGET, None, 1.2)


def balls(*centres, radius=0.2) -> BodyZones:
    """People who are one ball each and stay where they are."""
    centre = np.broadcast_to(
        np.array(centres, float)[:, None, None], (len(centres), len(TIMES), 1, 3)
    )
    zones = Capsules(centre, centre, np.full(centre.shape[:-1], radius))
    ids = tuple(range(len(centres)))
    return BodyZones(
        Zones(ids, ("ball",), TIMES, zones), zones, np.zeros(len(ids), bool), 0.05, 10**9
    )


def now(qd) -> RobotNow:
    qd = np.asarray(qd, float)
    return RobotNow(READY, qd, float(MODEL.tip_speed(READY, qd)))


# -- fixed -----------------------------------------------------------------------------------------


def test_the_fixed_radius_is_reach_and_protective_distance():
    # T_r: age 0.12, encoding 0.02, cycle 0.04, link 0.03, silence 0.1, reaction 0.1 = 0.41 s.
    # S_p at 1 m/s: S_h = 1.6 (0.41 + T_s), S_r = 0.41, S_s of the table; C + Z_d + Z_r = 0.16 m.
    stopping_s, stopping_m = MODEL.stopping(1.0)
    s_p = 1.6 * (0.41 + stopping_s) + 0.41 + stopping_m + 0.16
    found = judge("fixed", intrusion_m=0.1)
    assert found.fixed_radius_m == pytest.approx(MODEL.reach_m + s_p)
    assert judge("fixed", fixed_radius_m=1.5).fixed_radius_m == 1.5


@pytest.mark.parametrize(
    ("x", "level"),
    [(3.19, Level.STOP), (3.21, Level.WARN), (3.69, Level.WARN), (3.71, Level.CLEAR)],
)
def test_fixed_is_a_circle_around_the_base(x, level):
    # the base is at x = 1; the ball's surface 0.2 m nearer than its centre; warned 0.5 m before
    fixed = judge("fixed", fixed_radius_m=2.0)
    for height in (0.0, 1.0, 2.5):  # whatever its height
        demand = fixed.judge(now([0.3, 0, 0, 0, 0, 0]), balls((x, 2.0, height))).demand
        assert demand.level is level
        assert demand.limit_m_s == (0.0 if level is Level.STOP else 1.0)
        assert (
            demand.reason
            is {
                Level.STOP: Reason.PERSON_NEAR,
                Level.WARN: Reason.PERSON_APPROACHING,
                Level.CLEAR: Reason.NONE,
            }[level]
        )


def test_fixed_releases_beyond_the_band():
    fixed = judge("fixed", fixed_radius_m=2.0, band_m=0.1)
    for x, release in ((3.25, Level.STOP), (3.35, Level.WARN)):
        demand = fixed.judge(now(np.zeros(6)), balls((x, 2.0, 1.0))).demand
        assert (demand.level, demand.release) == (Level.WARN, release)


def test_fixed_names_who_is_nearest_to_the_base():
    fixed = judge("fixed", fixed_radius_m=2.0)
    people = fixed.judge(now(np.zeros(6)), balls((4.0, 2.0, 1.0), (1.0, 3.5, 0.0))).people
    assert people.person == 1
    assert people.slack_m == pytest.approx(1.5 - 0.2 - 2.0)
    assert fixed.where(people) == "1.30 m from the base's axis"


@given(st.floats(0, 5), st.floats(0, 1), st.floats(0, 1))
def test_fixed_nearer_is_never_faster(distance, nearer, speed):
    found = Finding(1.0, 1.0, 1.0, False, 1.0, (1.0,) * 4)
    margins = (0.25, 0.35, 0.75, 0.85)
    far = judge_fixed(found, distance, 2.0, 1.0, margins, speed)
    near = judge_fixed(found, distance - nearer, 2.0, 1.0, margins, speed)
    assert all(a <= b for a, b in zip(near.limits, far.limits, strict=True))
    assert near.near >= far.near
    assert near.breach_s <= far.breach_s


def test_what_is_not_finite_is_inside_every_circle():
    capsules = Capsules(np.array([[np.nan, 0, 0]]), np.array([[1.0, 0, 0]]), np.array([0.1]))
    assert horizontal_distance(capsules, np.zeros(3)) == -np.inf
