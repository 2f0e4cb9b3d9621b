"""Lost people as data, and back."""

import numpy as np
import pytest

from hri_predict.base.skeleton import JOINTS
from hri_predict.people.lost.remembered import lost_as_data, lost_from_data

PLACES = [[1.0, 2.0, 0.5], None, [1.1, 2.0, 1.0], *[None] * (len(JOINTS) - 3)]
DATA = [{"id": 4, "ago_s": 2.5, "speed_m_s": 3.0, "positions": PLACES}]


def test_lost_people_come_back_as_old_and_as_fast_as_they_are():
    (lost,) = lost_from_data(DATA, 10**10)
    assert lost.capture_ns == 7_500_000_000
    assert lost.id < 0  # a restarted source may give the number to somebody else
    assert lost.speed_m_s == 3.0
    np.testing.assert_allclose(lost.centroid, [1.05, 2.0, 0.75])
    (again,) = lost_as_data([lost], 11 * 10**9)
    assert again["ago_s"] == pytest.approx(3.5)
    assert again["positions"] == PLACES


def test_the_error_of_a_place_is_remembered_and_one_of_0_leaves_the_data_as_they_were():
    (lost,) = lost_from_data([DATA[0] | {"error_m": 0.75}], 10**10)
    assert lost.error_m == 0.75
    assert lost_as_data([lost], 10**10)[0]["error_m"] == 0.75
    (exact,) = lost_from_data(DATA, 10**10)
    assert exact.error_m == 0.0
    assert lost_as_data([exact], 10**10)[0].keys() == DATA[0].keys()


def test_what_was_hidden_before_the_loss_and_fast_limbs_are_remembered():
    """Otherwise the zone would be smaller after a restart."""
    rest = len(JOINTS) - 3
    ages, limbs = [30.0, 0.0, 0.5] + rest * [0.0], [0.0, 1.2, 0.0] + rest * [0.3]
    (lost,) = lost_from_data([DATA[0] | {"joint_age_s": ages, "limbs_m_s": limbs}], 10**10)
    np.testing.assert_allclose(lost.joint_age_s, [30.0, np.inf, 0.5] + rest * [np.inf])
    np.testing.assert_allclose(lost.limbs_m_s, limbs)
    (again,) = lost_as_data([lost], 10**10)
    assert (again["joint_age_s"], again["limbs_m_s"]) == (ages, limbs)


@pytest.mark.parametrize(
    "wrong",
    [
        {"positions": []},
        {"positions": [None] * len(JOINTS)},
        {"positions": [[0.0] * 3] * 2},
        {"positions": [[0.0] * 2] * len(JOINTS)},
        {"positions": "x"},
        {"speed_m_s": None},
        {"speed_m_s": -1.0},
        {"speed_m_s": float("nan")},
        {"error_m": -1.0},
        {"error_m": float("nan")},
        {"error_m": 21.0},
        {"joint_age_s": [0.0]},
        {"joint_age_s": [-1.0] * len(JOINTS)},
        {"limbs_m_s": [float("nan")] * len(JOINTS)},
        {"limbs_m_s": [None] * len(JOINTS)},
    ],
    ids=str,
)
def test_what_is_no_person_is_refused(wrong):
    with pytest.raises((KeyError, TypeError, ValueError)):
        lost_from_data([DATA[0] | wrong], 0)
