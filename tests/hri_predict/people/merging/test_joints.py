"""The better-seen joint wins; where two sensors contradict each other, none is believed."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from hri_predict.base.skeleton import JOINTS
from hri_predict.people.merging.joints import LEAD_MORE, leading, merged
from hri_predict.people.track import Body

J = len(JOINTS)
MASKS = arrays.arrays(np.bool_, J)
PLACES = arrays.arrays(np.float64, (J, 3), elements=st.floats(-5, 5))


def body(positions, observed):
    return Body(1, np.where(observed[:, None], positions, 0.0), observed)


@given(a=PLACES, b=PLACES, seen_a=MASKS, seen_b=MASKS, limit_m=st.floats(0.05, 0.4))
def test_each_joint_is_one_sensors_own_and_never_a_contradicted_one(a, b, seen_a, seen_b, limit_m):
    positions, observed, disputed, _ = merged(0, {0: body(a, seen_a), 1: body(b, seen_b)}, limit_m)
    far = seen_a & seen_b & (np.linalg.norm(a - b, axis=1) > limit_m)
    near_limit = np.isclose(np.linalg.norm(a - b, axis=1), limit_m)
    assert np.array_equal(observed, (seen_a | seen_b) & ~far) or near_limit.any()
    assert disputed == np.count_nonzero((seen_a | seen_b) & ~observed)
    want = np.where(seen_a[:, None], a, b)
    assert np.array_equal(positions[observed], want[observed])
    assert not positions[~observed].any()


@pytest.mark.parametrize(
    ("seen_first", "seen_second", "error_m"),
    [
        (slice(None), slice(None), 0.9),
        (slice(2, None), slice(None), 0.9),
        (slice(None), slice(0), 0.2),
        (slice(0), slice(0), 0.0),
    ],
)
def test_the_error_is_that_of_the_worst_sensor_that_sees_the_person(
    seen_first, seen_second, error_m
):
    first, second = np.zeros((2, J), np.bool_)
    first[seen_first], second[seen_second] = True, True
    places = np.ones((J, 3))
    seen = {0: Body(1, places, first, 0.2), 1: Body(4, places, second, 0.9)}
    assert merged(0, seen, 0.3).error_m == error_m


def test_the_leading_sensor_stays_until_another_sees_clearly_more():
    few, more = np.zeros(J, np.bool_), np.zeros(J, np.bool_)
    few[:8], more[: 8 + LEAD_MORE - 1] = True, True
    seen = {0: body(np.ones((J, 3)), few), 1: body(np.ones((J, 3)), more)}
    assert leading(0, seen) == 0
    assert leading(None, seen) == 1
    more[8 + LEAD_MORE - 1] = True
    assert leading(0, seen | {1: body(np.ones((J, 3)), more)}) == 1


@pytest.mark.parametrize("lead", [0, 2, None])
def test_a_sensor_that_lost_the_person_does_not_lead(lead):
    seen = {0: body(np.ones((J, 3)), np.zeros(J, np.bool_)), 1: body(np.ones((J, 3)), MASK_ALL)}
    assert leading(lead, seen) == 1


MASK_ALL = np.ones(J, np.bool_)
