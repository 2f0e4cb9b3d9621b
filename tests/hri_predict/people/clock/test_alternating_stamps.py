"""Stamps that alternate for four seconds, about as far as a jump begins, are soon forgotten."""

import numpy as np
import pytest

from hri_predict.people.clock.clock_alignment import ClockAlignment

RECOVERS_S = 12.0
BEGIN_S, LENGTH_S, END_S = 60.0, 4.0, 120.0


@pytest.mark.parametrize(
    ("rate_hz", "apart_ms", "both_sides", "jitter_ms"),
    [
        (30, 99, True, 2),  # these were stale for 49 to more than 236 s before
        (30, 101, False, 10),
        (60, 51, True, 10),
        (60, 101, False, 2),
        (100, 51, True, 10),
        (100, 101, False, 10),
    ],
)
def test_input_is_fresh_again_within_seconds(rate_hz, apart_ms, both_sides, jitter_ms):
    rng = np.random.default_rng(2 if jitter_ms > 2 else 1)
    period_ns = round(1e9 / rate_hz)
    alignment, stale_ns, last_s = ClockAlignment(period_ns, 0), 3 * period_ns + 20_000_000, 0.0
    for k in range(int(END_S * rate_hz)):
        capture_ns, seconds = k * period_ns, k / rate_hz
        stamp_ns = capture_ns + 7 * 10**15
        if BEGIN_S <= seconds < BEGIN_S + LENGTH_S:
            stamp_ns += (apart_ms if k % 2 else -apart_ms * both_sides) * 1_000_000
        receipt_ns = capture_ns + round(rng.uniform(2, 2 + jitter_ms) * 1e6)
        found_ns = alignment.align(stamp_ns, k + 1, receipt_ns)
        if seconds >= BEGIN_S + LENGTH_S:
            assert found_ns <= capture_ns + round((2 + jitter_ms) * 1e6)  # never younger than it is
            if receipt_ns - found_ns > stale_ns:
                last_s = seconds - BEGIN_S - LENGTH_S
    assert last_s < RECOVERS_S
