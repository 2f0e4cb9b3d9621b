"""Clamping against another robot."""

from dataclasses import replace

import numpy as np
import pytest

from hri_predict.base.geometry import Capsules, capsule_distance
from hri_predict.base.settings import Pose
from hri_predict.base.skeleton import CANONICAL
from hri_predict.protocol.reasons import Reason
from hri_predict.risk.contact.clamping import robot_gaps
from hri_predict.risk.contact.judges import contact_judges
from hri_predict.risk.levels.advice import asked_of
from hri_predict.risk.robot_constants import RobotConstants
from hri_predict.risk.separation.stage import Separation
from hri_predict.robots.model import load_robot
from hri_predict.robots.tracker import RobotNow, RobotTracker
from tests.hri_predict.risk.contact.cell import (
    BUDGET,
    CONSTANTS,
    HYBRID,
    LIMITS,
    MODEL,
    READY,
    ROBOT,
    SEGMENTS,
    TIMES,
    beside,
    people,
    rung_below,
    standing,
)

NO_FIXTURES = HYBRID.model_copy(
    update={"contact": HYBRID.contact.model_copy(update={"fixtures": []})}
)
CLAMPED = rung_below(float(LIMITS.clamped_m_s[list(SEGMENTS).index("l_hand")]) / 1.1)


def limit_beside(other_x: float, other: RobotNow | None = None) -> float | None:
    """The limit beside a hand of a robot with another one at this x."""
    second = ROBOT.model_copy(
        update={"name": "other", "contact": None, "room_from_robot": Pose(xyz=[other_x, 0, 0.75])}
    )
    tracker = RobotTracker(second, load_robot(second, None))
    robots = [replace(CONSTANTS, risk=NO_FIXTURES)]
    robots.append(RobotConstants.of(tracker, NO_FIXTURES, BUDGET, 1.2))
    judges = contact_judges(
        settings=NO_FIXTURES, robots=robots, segments=list(CANONICAL.segments), floor_m=0.0
    )
    stage = Separation(
        settings=NO_FIXTURES,
        robots=robots,
        named=[],
        view=None,
        times_s=TIMES,
        horizon_s=1.2,
        contact=judges,
    )
    bodies = people({"l_hand": beside(0.1)}, growth=0.0)
    found = stage(bodies, [standing(), other or standing()])
    return asked_of(robots[0], found.robots[0], bodies)[0].limit_m_s


def test_a_hand_between_two_robots_bears_only_the_quasi_static_limit():
    assert limit_beside(-1.2) == pytest.approx(CLAMPED)
    slower = limit_beside(-1.5)  # so slow, the two stand before the gap is narrow
    assert slower is not None
    assert CLAMPED < slower < 1.0


def test_a_robot_far_away_clamps_nobody():
    assert limit_beside(6.0) == 1.0


def test_a_robot_that_nobody_knows_may_be_anywhere():
    lost = RobotNow(q=None, qd=None, speed_m_s=0.0, reasons=(Reason.ROBOT_STATE_INVALID,))
    assert limit_beside(6.0, lost) == pytest.approx(CLAMPED)


def test_a_robot_faster_than_its_highest_speed_may_be_anywhere():
    qd = np.array([2.0, 0, 0, 0, 0, 0])
    fast = RobotNow(q=READY, qd=qd, speed_m_s=float(MODEL.tip_speed(READY, qd)))
    assert fast.speed_m_s > 1.1
    assert limit_beside(6.0, fast) == pytest.approx(CLAMPED)


def test_a_hand_that_counts_as_thicker_is_clamped_in_wider_gaps():
    thick = NO_FIXTURES.model_copy(update={"region_margins_m": {"hand": 0.2}})
    plain_m, thick_m = (
        contact_judges(
            settings=risk, robots=[CONSTANTS], segments=list(CANONICAL.segments), floor_m=0.0
        )[0]._clamping.thickness_m
        for risk in (NO_FIXTURES, thick)
    )
    more = [0.4 if name in ("l_hand", "r_hand") else 0.0 for name in SEGMENTS]
    np.testing.assert_allclose(thick_m - plain_m, more, atol=1e-12)


def test_gaps_are_those_of_the_nearest_capsule():
    rng = np.random.default_rng(4)
    some = Capsules(rng.normal(size=(3, 2, 3)), rng.normal(size=(3, 2, 3)), rng.random((3, 2)))
    robot = Capsules(rng.normal(size=(4, 3)), rng.normal(size=(4, 3)), rng.random(4))
    gap = robot_gaps(some, [robot, None])
    assert gap.shape == (3, 2, 2)
    for i in np.ndindex(3, 2):
        one = Capsules(some.a[i], some.b[i], some.radius[i])
        nearest = min(
            float(capsule_distance(one, Capsules(robot.a[j], robot.b[j], robot.radius[j])))
            for j in range(4)
        )
        assert gap[i][0] == pytest.approx(nearest)
        assert gap[i][1] == -np.inf
    broken = Capsules(np.full((4, 3), np.nan), robot.b, robot.radius)
    assert (robot_gaps(some, [broken]) == -np.inf).all()
