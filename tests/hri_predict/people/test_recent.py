"""The newest captures as they came: of a time, or a number of them."""

import numpy as np
import pytest

from hri_predict.people.recent import LEAST, SPAN_S, recent_captures
from hri_predict.people.ring_buffer import RingBuffer


def ring(count: int, rate_hz: float) -> RingBuffer:
    found = RingBuffer(joints=2, capacity=200, max_gap_ns=10**8)
    for k in range(count):
        stamp = round((k + 1) * 1e9 / rate_hz)
        found.push(stamp, np.full((2, 3), float(k)), np.array([True, k % 2 == 0]), stamp)
    return found


@pytest.mark.parametrize("rate_hz", [5.0, 8.0, 30.0, 120.0, 240.0])
def test_they_span_the_time_or_are_few(rate_hz):
    recent = recent_captures([ring(150, rate_hz)], 2)
    count = recent.age_s.shape[1]
    assert count == max(LEAST, int(SPAN_S * rate_hz + 1e-6) + 1)
    np.testing.assert_allclose(recent.age_s[0], np.arange(count - 1, -1, -1) / rate_hz, atol=1e-8)
    assert recent.positions[0, -1, 0, 0] == 149
    assert recent.observed[0, -1].tolist() == [True, False]


def test_who_has_few_is_filled_up_in_front():
    recent = recent_captures([ring(2, 30.0), ring(40, 30.0)], 2)
    assert np.isinf(recent.age_s[0, :-2]).all()
    assert not recent.observed[0, :-2].any()
    assert recent.age_s[:, -1].tolist() == [0.0, 0.0]
    assert np.isfinite(recent.positions).all()


def test_nobody_has_none():
    assert recent_captures([], 2).age_s.shape == (0, 0)
