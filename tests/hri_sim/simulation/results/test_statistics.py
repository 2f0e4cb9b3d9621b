"""Ratios of sums, resampled by recording, against a case small enough for pen and paper."""

import numpy as np
import pytest

from hri_sim.simulation.results.statistics import Estimate, ratio


def test_two_recordings_by_hand():
    # a: 2 of 2, b: 0 of 2. The ratio is 2 / 4. A resample is aa (1/4), ab (1/2) or bb (1/4), with
    # ratios 1, 1/2 and 0: each end has more than 2.5 %, so the interval is all of [0, 1].
    assert ratio(
        recordings=["a", "a", "b", "b"], numerators=[1, 1, 0, 0], denominators=[1, 1, 1, 1]
    ) == Estimate(0.5, 0.0, 1.0)


def test_approaches_of_one_recording_move_together():
    # As many approaches again say nothing new of recordings: the interval stays as it is.
    once = ratio(recordings=["a", "b", "c"], numerators=[1, 0, 2], denominators=[2, 2, 2])
    tenfold = ratio(
        recordings=["a", "b", "c"] * 10, numerators=[1, 0, 2] * 10, denominators=[2, 2, 2] * 10
    )
    assert tenfold.value == pytest.approx(once.value)
    assert (tenfold.low, tenfold.high) == pytest.approx((once.low, once.high))


def test_a_long_recording_weighs_by_its_denominator():
    # 1 of 1 and 0 of 3: a quarter, not the mean of 1 and 0.
    assert ratio(recordings=["a", "b"], numerators=[1, 0], denominators=[1, 3]).value == 0.25


def test_nothing_to_divide_by_is_neither_0_nor_1():
    assert ratio(recordings=["a", "b"], numerators=[0, 0], denominators=[0, 0]) == Estimate(
        None, None, None
    )


def test_one_recording_has_no_spread():
    assert ratio(recordings=["a", "a"], numerators=[1, 2], denominators=[2, 2]) == Estimate(
        0.75, 0.75, 0.75
    )


def test_the_interval_narrows_with_recordings_and_holds_the_value():
    rng = np.random.default_rng(0)
    hits = (rng.random(400) < 0.3).astype(float)
    few, many = (
        ratio(
            recordings=[str(i) for i in range(n)],
            numerators=hits[:n].tolist(),
            denominators=[1.0] * n,
        )
        for n in (20, 400)
    )
    for estimate in (few, many):
        assert None not in (estimate.low, estimate.high)
        assert (estimate.low or 0.0) <= (estimate.value or 0.0) <= (estimate.high or 0.0)
    widths = [(e.high or 0.0) - (e.low or 0.0) for e in (few, many)]
    assert widths[1] < widths[0]
    # a proportion of 0.3 over 400: 1.96 sqrt(0.3 * 0.7 / 400) = 0.045 each way
    assert widths[1] == pytest.approx(0.09, abs=0.015)
