"""Predictive mode permits the milder of two: the zones over time, and the standard's separation."""

from dataclasses import replace
from typing import NamedTuple

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hri_predict.base.geometry import Capsules
from hri_predict.contracts.link import LinkSettings
from hri_predict.protocol.messages import Level
from hri_predict.protocol.reasons import Reason
from hri_predict.risk.delay_budget import DelayBudget
from hri_predict.risk.levels.advice import asked_of
from hri_predict.risk.levels.demand import Demand
from hri_predict.risk.robot_constants import RobotConstants
from hri_predict.risk.separation.stage import Separation
from hri_predict.risk.settings import RiskSettings
from hri_predict.risk.terms import Finding
from hri_predict.robots.model import load_robot
from hri_predict.robots.tracker import RobotNow, RobotTracker
from hri_predict.zones.types import Zones
from tests.arms import arm_settings
from tests.hri_predict.risk.demands import asks
from tests.hri_predict.risk.people_speeds import bodies_in, speeds_of

# -- demands ---------------------------------------------------------------------------------------

LEVELS = st.sampled_from(list(Level))
SPEEDS = st.floats(0, 2)
DEMANDS = st.builds(
    Demand,
    level=LEVELS,
    release=LEVELS,
    limit_m_s=SPEEDS,
    release_limit_m_s=SPEEDS,
    reason=st.sampled_from([Reason.NONE, Reason.PERSON_NEAR, Reason.PERSON_LOST]),
)


def ranks(demand):
    return demand.level.rank, demand.release.rank


def limits(demand):
    return demand.limit_m_s, demand.release_limit_m_s


@given(DEMANDS, DEMANDS)
def test_milder_is_the_lower_level_and_the_higher_limit_of_each(one, other):
    both = one.milder(other)
    assert ranks(both) == tuple(map(min, ranks(one), ranks(other)))
    assert limits(both) == tuple(map(max, limits(one), limits(other)))
    # its level and reason are those of one of them, together
    assert (both.level, both.reason) in {(d.level, d.reason) for d in (one, other)}


@given(DEMANDS, DEMANDS)
def test_milder_has_no_order(one, other):
    both, turned = one.milder(other), other.milder(one)
    assert (ranks(both), limits(both)) == (ranks(turned), limits(turned))
    if one.level.rank != other.level.rank or one.limit_m_s != other.limit_m_s:
        assert (both.level, both.reason) == (turned.level, turned.reason)


@given(DEMANDS, DEMANDS)
def test_milder_permits_nothing_that_neither_permits(one, other):
    both = one.milder(other)
    assert both.limit_m_s in (one.limit_m_s, other.limit_m_s)
    assert both.release_limit_m_s in (one.release_limit_m_s, other.release_limit_m_s)
    assert both.level in (one.level, other.level)
    assert both.release in (one.release, other.release)
    assert one.milder(one) == one


@given(DEMANDS, DEMANDS)
def test_milder_lies_between_what_both_ask_and_nothing(one, other):
    both, all_of_it = one.milder(other), one | other
    assert all(a <= b for a, b in zip(ranks(both), ranks(all_of_it), strict=True))
    assert all(a >= b for a, b in zip(limits(both), limits(all_of_it), strict=True))


def test_milder_by_hand():
    zones = asks(Level.STOP, 0.0)
    standard = asks(Level.SLOW, 0.3, Reason.PERSON_NEAR, release=Level.STOP, release_limit_m_s=0.0)
    assert zones.milder(standard) == standard
    # of the same level the higher limit gives the reason
    slower = replace(zones, level=Level.SLOW, limit_m_s=0.2, release_limit_m_s=0.1)
    assert slower.milder(standard) == replace(standard, release_limit_m_s=0.1)


# -- one robot -------------------------------------------------------------------------------------

READY = np.array([0.0, -1.2, 1.5, -1.8, -1.57, 0.0])
ROBOT = arm_settings(payload_kg=2.0)
MODEL = load_robot(ROBOT, None)
LINK = LinkSettings(name="bus", kind="can", delay_s=0.03, silence_timeout_s=0.1, reaction_s=0.1)
BUDGET = DelayBudget.from_settings(25.0, [LINK], stale_s=0.12)
TIMES = np.arange(31) / 25.0


class Judged(NamedTuple):
    demand: Demand
    people: Finding | None


def judged(mode, bodies):
    """What is asked of the robot, and the finding that decides."""
    settings = RiskSettings.model_validate({"mode": mode})
    robot = RobotConstants.of(RobotTracker(ROBOT, MODEL), settings, BUDGET, 1.2)
    stage = Separation(
        settings=settings, robots=[robot], named=[], view=None, times_s=TIMES, horizon_s=1.2
    )
    qd = np.array([0.3, 0, 0, 0, 0, 0])
    now = RobotNow(q=READY, qd=qd, speed_m_s=float(MODEL.tip_speed(READY, qd)))
    return Judged(*asked_of(robot, stage(bodies, [now]).robots[0], bodies))


def sphere(x, speed_m_s=0.0, radius_m=0.2, growth_m_s=0.0):
    """Somebody who is a sphere on the x axis that moves away along it and grows."""
    centre = np.zeros((1, len(TIMES), 1, 3))
    centre[0, :, 0, 0] = x + speed_m_s * TIMES
    centre[..., 2] = 1.0
    radius = (radius_m + growth_m_s * TIMES).reshape(1, -1, 1)
    capsules = Capsules(centre, centre, radius)
    return bodies_in(Zones((7,), ("sphere",), TIMES, capsules))


PLACES = np.arange(0.6, 5.0, 0.2)


def test_where_zones_are_larger_it_asks_for_what_iso_does():
    # what an arm can do, 4.5 m/s, is so much more than the standard's 1.6 m/s that nothing else
    # counts, such as that zones know where the robot goes
    differs = 0
    for x in PLACES:
        bodies = sphere(x, growth_m_s=4.5)
        iso, zones = judged("iso", bodies).demand, judged("reactive", bodies).demand
        found = judged("predictive", bodies).demand  # where both stop, the zones give the reason
        assert (ranks(found), limits(found)) == (ranks(iso), limits(iso))
        differs += (zones.level, zones.limit_m_s) != (iso.level, iso.limit_m_s)
    assert differs > 5  # by zones alone it would ask for more


def test_it_permits_more_than_iso_where_somebody_walks_away():
    permitted = 0
    for x in PLACES:
        bodies = sphere(x, speed_m_s=1.2, growth_m_s=0.2)  # forecast well: 0.2 m wider in a second
        iso, predictive = judged("iso", bodies).demand, judged("predictive", bodies).demand
        assert predictive.level.rank <= iso.level.rank
        assert predictive.limit_m_s >= iso.limit_m_s
        permitted += predictive.limit_m_s > iso.limit_m_s
    assert permitted > 3


@pytest.mark.long
@given(st.floats(0.5, 5), st.floats(-1.5, 1.5), st.floats(0, 4.5))
def test_it_is_never_more_than_either(x, speed, growth):
    bodies = sphere(x, speed, growth_m_s=growth)
    iso, zones = judged("iso", bodies).demand, judged("reactive", bodies).demand
    found = judged("predictive", bodies).demand
    assert (ranks(found), limits(found)) == (ranks(zones.milder(iso)), limits(zones.milder(iso)))


def test_the_finding_is_the_one_that_decides():
    wide = sphere(2.0, growth_m_s=4.5)
    assert judged("predictive", wide).people == judged("iso", wide).people
    away = sphere(1.6, speed_m_s=1.2, growth_m_s=0.2)
    by_zones, by_standard = judged("reactive", away), judged("iso", away)
    assert by_zones.demand.limit_m_s > by_standard.demand.limit_m_s
    assert judged("predictive", away).people == by_zones.people
    assert by_zones.people != by_standard.people


@pytest.mark.parametrize("nonsense", [np.nan, np.inf, -np.inf])
def test_zones_that_are_no_numbers_stop_it_however_far_somebody_is(nonsense):
    bodies = sphere(4.5)
    bodies.zones.capsules.a[0, 5] = nonsense  # a later step: the distance now is fine
    assert judged("iso", bodies).demand.level is Level.CLEAR
    assert judged("predictive", bodies).demand.level is Level.STOP


# -- people who do not move as the standard assumes ------------------------------------------------


def two(x, other_x, *, assumed):
    """Two such people, and whether each moves as the standard assumes."""
    one, other = sphere(x, growth_m_s=4.5), sphere(other_x, growth_m_s=4.5)
    parts = [one.zones.capsules, other.zones.capsules]
    capsules = Capsules(
        np.concatenate([c.a for c in parts]),
        np.concatenate([c.b for c in parts]),
        np.concatenate([c.radius for c in parts]),
    )
    return replace(
        one,
        zones=Zones((7, 8), ("sphere",), TIMES, capsules),
        paths=capsules,
        lost=np.zeros(2, bool),
        speeds=speeds_of(0.0, 0.0),
        as_assumed=np.array(assumed),
    )


def test_zones_alone_decide_about_who_does_not_move_as_assumed():
    strict = 0
    for x in PLACES:
        odd = replace(sphere(x, growth_m_s=4.5), as_assumed=np.zeros(1, bool))
        zones, found = judged("reactive", odd).demand, judged("predictive", odd).demand
        assert (ranks(found), limits(found)) == (ranks(zones), limits(zones))
        strict += found.limit_m_s < judged("iso", odd).demand.limit_m_s
    assert strict > 5


def test_who_moves_as_assumed_is_judged_mildly_beside_somebody_odd_who_is_far():
    # the odd one is so far away that even these zones permit the highest speed
    relaxed = two(2.4, 9.0, assumed=[True, False])
    alone = judged("predictive", sphere(2.4, growth_m_s=4.5)).demand
    assert limits(judged("predictive", relaxed).demand) == limits(alone)
    assert limits(alone) > limits(judged("reactive", relaxed).demand)


def test_somebody_odd_beside_who_moves_as_assumed_keeps_the_zones():
    beside = two(2.4, 2.6, assumed=[True, False])
    odd = replace(sphere(2.6, growth_m_s=4.5), as_assumed=np.zeros(1, bool))
    found = judged("predictive", beside)
    by_zones = judged("predictive", odd).demand
    assert limits(found.demand) <= limits(by_zones)
    assert found.demand.level.rank >= by_zones.level.rank


@pytest.mark.long
@given(st.floats(0.5, 5), st.floats(0.5, 5), st.booleans(), st.booleans())
def test_with_two_people_it_lies_between_the_zones_and_each_alone(x, other_x, first, second):
    both = judged("predictive", two(x, other_x, assumed=[first, second])).demand
    zones = judged("reactive", two(x, other_x, assumed=[first, second])).demand
    assert both.limit_m_s >= zones.limit_m_s
    for place, assumed in ((x, first), (other_x, second)):
        alone = replace(sphere(place, growth_m_s=4.5), as_assumed=np.array([assumed]))
        assert both.limit_m_s <= judged("predictive", alone).demand.limit_m_s
