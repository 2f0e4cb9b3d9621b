"""Lost people as data, and back."""

import numpy as np
import pytest

from hri_predict.people.remembered import lost_as_data, lost_from_data
from hri_predict.people.ring_buffer import RingBuffer


def history():
    return RingBuffer(joints=3, capacity=4, max_gap_ns=10**8, future_tolerance_ns=10**7)


DATA = [{"id": 4, "ago_s": 2.5, "positions": [[1.0, 2.0, 0.5], None, [1.1, 2.0, 1.0]]}]


def test_lost_people_come_back_as_old_as_they_are():
    (track,) = lost_from_data(DATA, history, 10**10)
    assert track.capture_ns == 7_500_000_000
    assert track.id < 0  # a restarted source may give the number to somebody else
    np.testing.assert_allclose(track.centroid, [1.05, 2.0, 0.75])
    (again,) = lost_as_data([track], 11 * 10**9)
    assert again["ago_s"] == pytest.approx(3.5)
    assert again["positions"] == DATA[0]["positions"]


@pytest.mark.parametrize("positions", [[], [None] * 3, [[0.0] * 3] * 2, [[0.0] * 2] * 3, "x"])
def test_what_is_no_person_is_refused(positions):
    with pytest.raises((KeyError, TypeError, ValueError)):
        lost_from_data([{"id": 1, "ago_s": 0.0, "positions": positions}], history, 0)
