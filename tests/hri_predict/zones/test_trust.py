"""What counts as widened: more than chance would."""

import numpy as np
import pytest

from hri_predict.protocol.reasons import Reason
from hri_predict.zones.trust import BY_CHANCE, Trust


def trust(*factors, out_of_distribution=()):
    people = len(factors)
    outside = np.zeros(people, bool)
    outside[list(out_of_distribution)] = True
    widen = np.ones((people, 5))
    widen[:, 3] = factors
    return Trust(
        residual_m=np.zeros(people),
        error_m=np.zeros((people, 2, 21)),
        widen=widen,
        out_of_distribution=outside,
    )


@pytest.mark.parametrize("factor", [1.0, 1.02, BY_CHANCE])
def test_a_little_is_no_news(factor):
    assert not trust(factor).widened.any()
    assert trust(factor).reasons == ()


def test_more_is_said_of_each_person():
    found = trust(1.0, BY_CHANCE + 0.001, 3.0)
    assert found.widened.tolist() == [False, True, True]
    assert found.reasons == (Reason.ZONES_WIDENED,)


def test_a_factor_that_is_no_number_is_no_trust():
    assert trust(np.nan).widened.all()
    assert trust(np.inf).reasons == (Reason.ZONES_WIDENED,)


def test_who_has_physical_limits_is_not_widened_as_well():
    assert trust(3.0, out_of_distribution=[0]).reasons == (Reason.MOTION_UNLIKE,)
    both = trust(3.0, 2.0, out_of_distribution=[0])
    assert both.reasons == (Reason.MOTION_UNLIKE, Reason.ZONES_WIDENED)


def test_the_past_errors_alone_say_nothing():
    assert trust(3.0, out_of_distribution=[0]).residual_alone().reasons == ()
