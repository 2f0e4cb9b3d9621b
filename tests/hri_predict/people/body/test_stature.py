"""How tall people are by their limbs, in any posture, and which unit was meant."""

import numpy as np
import pytest

from hri_predict.base.skeleton import JOINTS
from hri_predict.contracts.joint_map import METRES_PER_UNIT
from hri_predict.people.body.stature import fitting_unit, is_adult, stature_m
from hri_sim.people.body import Body

SEEN = np.ones(len(JOINTS), bool)


def bodies(height=1.75):
    who = Body(height)
    return [(who.joints(who.standing(np.array([x, 0.0]), x)), SEEN) for x in (0.0, 1.0)]


@pytest.mark.parametrize("height", [1.5, 1.75, 2.0])
def test_limbs_say_the_stature(height):
    # bodies differ from Drillis and Contini's means by a few hundredths
    assert stature_m(bodies(height)) == pytest.approx(height, rel=0.05)


def test_arms_alone_say_it_and_less_says_nothing():
    arms = np.array([name[2:] in ("shoulder", "elbow", "wrist") for name in JOINTS])
    assert stature_m([(b, arms) for b, _ in bodies()]) == pytest.approx(1.75, rel=0.1)
    hands = np.array([name[2:] == "wrist" for name in JOINTS])
    assert stature_m([(b, hands) for b, _ in bodies()]) is None
    assert stature_m([]) is None


@pytest.mark.parametrize("real", list(METRES_PER_UNIT))
@pytest.mark.parametrize("stated", list(METRES_PER_UNIT))
def test_the_unit_is_named_whatever_was_stated(real, stated):
    seems = 1.72 * METRES_PER_UNIT[stated] / METRES_PER_UNIT[real]
    assert is_adult(seems) == (real == stated)
    assert fitting_unit(seems, METRES_PER_UNIT[stated]) == (METRES_PER_UNIT[real], real)


def test_no_unit_makes_a_child_or_a_giant_an_adult():
    assert fitting_unit(1.05, 1.0) is None
    assert fitting_unit(2.6, 1.0) is None
