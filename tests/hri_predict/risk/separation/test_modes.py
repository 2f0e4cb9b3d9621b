"""One robot judged in each mode, against values worked by hand."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hri_predict.base.errors import ConfigError
from hri_predict.base.geometry import Capsules, horizontal_distance
from hri_predict.base.settings import Pose
from hri_predict.contracts.link import LinkSettings
from hri_predict.protocol.messages import Level
from hri_predict.protocol.reasons import Reason
from hri_predict.risk.delay_budget import DelayBudget
from hri_predict.risk.levels.advice import asked_of
from hri_predict.risk.levels.demand import Demand
from hri_predict.risk.levels.detail import where
from hri_predict.risk.robot_constants import RobotConstants
from hri_predict.risk.separation.now import judge_fixed
from hri_predict.risk.separation.receding import link_distances, receding_steps
from hri_predict.risk.separation.stage import Separation
from hri_predict.risk.settings import RiskSettings
from hri_predict.risk.terms import Finding
from hri_predict.robots.model import load_robot
from hri_predict.robots.tracker import RobotNow, RobotTracker
from hri_predict.zones.body_zones import BodyZones
from hri_predict.zones.types import Zones
from tests.arms import arm_settings
from tests.hri_predict.risk.people_speeds import bodies_in, speeds_of

READY = np.array([0.0, -1.2, 1.5, -1.8, -1.57, 0.0])
ROBOT = arm_settings(room_from_robot=Pose(xyz=[1.0, 2.0, 0.5]), payload_kg=2.0)
MODEL = load_robot(ROBOT, None)
LINK = LinkSettings(name="bus", kind="can", delay_s=0.03, silence_timeout_s=0.1, reaction_s=0.1)
BUDGET = DelayBudget.from_settings(25.0, [LINK], stale_s=0.12)
TIMES = np.arange(31) / 25.0


class Cell:
    """One robot and the separation stage of one mode."""

    def __init__(self, mode: str, **risk: Any) -> None:
        settings = RiskSettings.model_validate({"mode": mode, **risk})
        self.robot = RobotConstants.of(RobotTracker(ROBOT, MODEL), settings, BUDGET, 1.2)
        self._stage = Separation(
            settings=settings,
            robots=[self.robot],
            named=[],
            view=None,
            times_s=TIMES,
            horizon_s=1.2,
        )

    def asked(self, robot: RobotNow, bodies: BodyZones) -> tuple[Demand, Finding]:
        """What people who are there ask, and the finding that decides."""
        demand, people = asked_of(self.robot, self._stage(bodies, [robot]).robots[0], bodies)
        assert people is not None
        return demand, people

    def demand(self, robot: RobotNow, bodies: BodyZones) -> Demand:
        return self.asked(robot, bodies)[0]

    def people(self, robot: RobotNow, bodies: BodyZones) -> Finding:
        return self.asked(robot, bodies)[1]


def spheres(*centres, radius=0.2) -> BodyZones:
    """People who are one sphere each and stay where they are."""
    centre = np.broadcast_to(
        np.array(centres, float)[:, None, None], (len(centres), len(TIMES), 1, 3)
    )
    zones = Capsules(centre, centre, np.full(centre.shape[:-1], radius))
    ids = tuple(range(len(centres)))
    return bodies_in(Zones(ids, ("sphere",), TIMES, zones))


def now(qd) -> RobotNow:
    qd = np.asarray(qd, float)
    return RobotNow(q=READY, qd=qd, speed_m_s=float(MODEL.tip_speed(READY, qd)))


def running(bodies: BodyZones, *human_m_s: float) -> BodyZones:
    """The same people, whose v_h is this; 0: as the standard assumes."""
    return replace(bodies, speeds=speeds_of(*human_m_s), as_assumed=np.array(human_m_s) == 0)


CELLS = {mode: Cell(mode) for mode in ("iso", "predictive", "reactive", "fixed")}


# -- fixed -----------------------------------------------------------------------------------------


def test_the_fixed_radius_is_reach_and_protective_distance():
    # T_r: age 0.12, encoding 0.02, cycle 0.04, link 0.03, silence 0.1, reaction 0.1 = 0.41 s.
    # S_p at 1 m/s: S_h = 1.6 (0.41 + T_s), S_r = 0.41, S_s of the table; C + Z_d + Z_r = 0.16 m.
    stopping_s, stopping_m = MODEL.stopping(1.0)
    s_p = 1.6 * (0.41 + stopping_s) + 0.41 + stopping_m + 0.16
    found = Cell("fixed", intrusion_m=0.1).robot
    assert found.fixed_radius_m == pytest.approx(MODEL.reach_m + s_p)
    assert Cell("fixed", fixed_radius_m=1.7).robot.fixed_radius_m == 1.7
    with pytest.raises(ConfigError, match=r"fixed_radius_m: 1\.5 m is less than the reach"):
        Cell("fixed", fixed_radius_m=1.5)


@pytest.mark.parametrize(
    ("x", "level"),
    [(3.19, Level.STOP), (3.21, Level.WARN), (3.69, Level.WARN), (3.71, Level.CLEAR)],
)
def test_fixed_is_a_circle_around_the_base(x, level):
    # the base is at x = 1; the sphere's surface 0.2 m nearer than its centre; warned 0.5 m before
    fixed = Cell("fixed", fixed_radius_m=2.0)
    for height in (0.0, 1.0, 2.5):  # whatever its height
        demand = fixed.demand(now([0.3, 0, 0, 0, 0, 0]), spheres((x, 2.0, height)))
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


@pytest.mark.parametrize(("age_s", "late_s"), [(0.0, 0.0), (0.12, 0.0), (0.2, 0.08), (2.0, 1.88)])
def test_fixed_is_wider_for_a_body_that_the_newest_scenes_lack(age_s, late_s):
    """Both may have moved for longer: the person at 1.6 m/s, the robot at its highest speed."""
    cell = Cell("fixed", fixed_radius_m=2.0)
    people = replace(spheres((4.5, 2.0, 1.0)), age_s=age_s)
    found = cell.people(now(np.zeros(6)), people)
    assert found.slack_m == pytest.approx(1.3 - (1.6 + ROBOT.max_speed_m_s) * late_s)


def test_fixed_releases_beyond_the_band():
    fixed = Cell("fixed", fixed_radius_m=2.0, band_m=0.1)
    for x, release in ((3.25, Level.STOP), (3.35, Level.WARN)):
        demand = fixed.demand(now(np.zeros(6)), spheres((x, 2.0, 1.0)))
        assert (demand.level, demand.release) == (Level.WARN, release)


def test_fixed_names_who_is_nearest_to_the_base():
    fixed = Cell("fixed", fixed_radius_m=2.0)
    people = fixed.people(now(np.zeros(6)), spheres((4.0, 2.0, 1.0), (1.0, 3.5, 0.0)))
    assert people.person == 1
    assert people.slack_m == pytest.approx(1.5 - 0.2 - 2.0)
    assert where(fixed.robot, people) == "1.30 m from the base's axis"


@given(st.floats(0, 5), st.floats(0, 1), st.floats(0, 1))
def test_fixed_nearer_is_never_faster(distance, nearer, speed):
    found = Finding(
        separation_m=1.0, predicted_m=1.0, slack_m=1.0, near=False, breach_s=1.0, limits=(1.0,) * 4
    )
    margins = (0.25, 0.35, 0.75, 0.85)
    far = judge_fixed(
        found=found,
        from_base_m=distance,
        radius_m=2.0,
        max_speed_m_s=1.0,
        margins_m=margins,
        speed_m_s=speed,
    )
    near = judge_fixed(
        found=found,
        from_base_m=distance - nearer,
        radius_m=2.0,
        max_speed_m_s=1.0,
        margins_m=margins,
        speed_m_s=speed,
    )
    assert all(a <= b for a, b in zip(near.limits, far.limits, strict=True))
    assert near.near >= far.near
    assert near.breach_s <= far.breach_s


def test_what_is_not_finite_is_inside_every_circle():
    capsules = Capsules(np.array([[np.nan, 0, 0]]), np.array([[1.0, 0, 0]]), np.array([0.1]))
    assert horizontal_distance(capsules, np.zeros(3)) == -np.inf


# -- people faster than the standard assumes -------------------------------------------------------


def test_iso_counts_a_runner_at_their_own_speed():
    iso, robot = Cell("iso"), now([0.3, 0, 0, 0, 0, 0])
    people = spheres((4.0, 2.0, 1.0), (6.0, 2.0, 1.0))
    walking = iso.people(robot, people)
    # T_r: age 0.05 and 0.29 s after now. S_h at 3.4 m/s is (3.4 - 1.6) (T_r + T_s) more.
    stopping_s, _ = MODEL.stopping(robot.speed_m_s)
    ran = iso.people(robot, running(people, 3.4, 0.0))
    assert walking.slack_m - ran.slack_m == pytest.approx(1.8 * (0.34 + stopping_s))
    assert ran.limits[0] <= walking.limits[0]
    # one who runs behind may ask for more than one who stands in front
    behind = iso.people(robot, running(people, 0.0, 8.0))
    assert (walking.person, behind.person) == (0, 1)
    assert behind.slack_m < walking.slack_m


@given(st.floats(0, 10), st.floats(0, 10), st.floats(1.5, 6))
def test_a_slower_person_never_lowers_the_limit(speed, slower, x):
    iso, robot, people = CELLS["iso"], now([0.3, 0, 0, 0, 0, 0]), spheres((x, 2.0, 1.0))
    fast, slow = (iso.people(robot, running(people, v)) for v in (max(speed, slower), slower))
    assert all(a <= b for a, b in zip(fast.limits, slow.limits, strict=True))
    assert fast.slack_m <= slow.slack_m


def test_the_circle_is_wider_for_a_runner():
    # radius 2 m; 3.4 m/s instead of 1.6 for T_r at worst, 0.41 s, and T_s at 1 m/s
    fixed, robot = Cell("fixed", fixed_radius_m=2.0), now(np.zeros(6))
    wider = 1.8 * (0.41 + MODEL.stopping(1.0)[0])
    for beyond, level in ((-0.01, Level.STOP), (0.01, Level.WARN)):
        people = spheres((3.2 + wider + beyond, 2.0, 1.0), (4.0 + wider, 2.0, 1.0))
        assert fixed.demand(robot, running(people, 3.4, 0.0)).level is level


# -- moving away -----------------------------------------------------------------------------------


SIDE = (1.0, 0.3, 0.9)
"""Beside the base; the turn AWAY takes every link away from there."""
AWAY, NEAR = (-0.5, 0, 0, 0, 0, 0), (0.5, 0, 0, 0, 0, 0)


def test_iso_a_robot_that_gets_away_with_every_link_may_be_fast():
    people = spheres(SIDE)
    away, near = (CELLS["iso"].people(now(qd), people) for qd in (AWAY, NEAR))
    assert away.limits[0] > near.limits[0]
    assert away.limits[2:] == near.limits[2:]  # warnings regard any direction
    # S_r = S_s = 0: what is left over is the distance less 1.6 (T_r + T_s) and 0.06 m
    stopping_s, stopping_m = MODEL.stopping(now(AWAY).speed_m_s)
    left = away.separation_m - 1.6 * (0.34 + stopping_s) - 0.06
    assert away.slack_m == pytest.approx(left)
    assert near.slack_m == pytest.approx(left - 0.34 * now(NEAR).speed_m_s - stopping_m)
    # the limit by hand: the fastest quarter of 1 m/s whose S_h fits into 0.25 m less
    fits = [
        v
        for v in (0.25, 0.5, 0.75, 1.0)
        if away.separation_m - 0.25 >= 1.6 * (0.34 + MODEL.stopping(v)[0]) + 0.06
    ]
    assert away.limits[0] == max(fits)


def test_iso_one_person_or_one_link_that_is_approached_is_enough():
    across = (0.2, 3.6, 0.9)  # where the same turn brings the arm
    both = CELLS["iso"].people(now(AWAY), spheres(SIDE, across))
    alone = CELLS["iso"].people(now(AWAY), spheres(SIDE))
    any_way = CELLS["iso"].people(now(NEAR), spheres(SIDE))
    assert both.limits[0] == any_way.limits[0] < alone.limits[0]
    # the elbow lifts the tool away from somebody before the arm, and lowers the forearm to them
    lift, before = (0, 0, 0.4, 0, 0, 0), (-0.9, 2.0, 0.5)
    robot = MODEL.capsules(READY + np.linspace(0, 0.5, 6)[:, None] * np.array(lift))
    at = np.array([[before]])
    change = np.diff(link_distances(Capsules(at, at, np.full((1, 1), 0.2)), robot)[:, :, 0], axis=0)
    tool = [MODEL.capsule_names.index(name) for name in ("gripper", "payload")]
    assert (change[:, tool] > 0).all()
    assert change.min() < 0
    lifted = CELLS["iso"].people(now(lift), spheres(before))
    standard = CELLS["iso"].people(
        RobotNow(q=READY, qd=np.zeros(6), speed_m_s=0.0), spheres(before)
    )
    assert lifted.limits == standard.limits


@pytest.mark.parametrize("mode", ["predictive", "reactive"])
def test_by_time_every_link_must_keep_clear(mode):
    # shoulder and elbow take the tool away from somebody and bring the upper arm near
    qd, where = np.array([0.5, 0.8, 0.8, -0.5, 0, 0]), (0.57, 1.5, 1.13)
    at = np.array([[where]])
    person = Capsules(at, at, np.full((1, 1), 0.1))
    path = MODEL.capsules(READY + np.linspace(0, 0.5, 40)[:, None] * qd)
    links = link_distances(person, path)[:, :, 0]
    upper_arm, wrist = (MODEL.capsule_names.index(n) for n in ("upper_arm", "wrist_3"))
    needed = (links[0].min() + links.min()) / 2
    assert links[:, wrist:].min() > needed > links[:, upper_arm].min()
    strict = Cell(
        mode, person_uncertainty_m=needed, robot_uncertainty_m=0, slow_margin_m=0, band_m=0
    )
    found = strict.people(now(qd), spheres(where, radius=0.1))
    assert found.limits[0] < 1.0
    assert found.link == upper_arm


def test_receding_follows_every_link_and_every_person():
    def capsules(centres, radius):
        at = np.asarray(centres, float)
        return Capsules(at, at, np.full(at.shape[:-1], radius))

    people = capsules([[[0.0, 0, 0]], [[0.0, 9, 0]]], 0.1)
    # link 0 stands, link 1 goes along x from 1 to 2: farther from the first, hardly from the second
    path = np.zeros((6, 2, 3))
    path[:, 0] = [3.0, 0, 0]
    path[:, 1, 0] = np.linspace(1, 2, 6)
    assert receding_steps(people, capsules(path, 0.1)) == 5
    path[4:, 0, 0] = 2.9  # at step 4 the standing link comes nearer to the first person
    assert receding_steps(people, capsules(path, 0.1)) == 3
    path[:, 0] = [3.0, 0, 0]
    path[1:, 1, 1] = 0.1 * np.arange(1, 6) ** 2  # and now link 1 nears the second at once
    assert receding_steps(people, capsules(path, 0.1)) == 0
    assert receding_steps(people, capsules(path * np.nan, 0.1)) == 0
    # (K, C, P) by hand: 1 m along x and radii of 0.1 m each; sqrt(1 + 81)
    distances = link_distances(people, capsules(path[:1], 0.1))
    np.testing.assert_allclose(distances[0, 1], [0.8, np.sqrt(82) - 0.2])
