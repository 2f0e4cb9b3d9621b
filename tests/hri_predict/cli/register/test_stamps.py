"""Stamps of another unit are named, with the factor that makes them right."""

import pytest

from hri_predict.cli.register.sight import stamps_remedy

ARRIVED = [k * 33_000_000 + (k % 5) * 4_000_000 for k in range(60)]  # 30 Hz with 16 ms of jitter


@pytest.mark.parametrize(
    ("unit", "ns", "factor"),
    [("seconds", 1e9, "1,000,000,000"), ("milliseconds", 1e6, "1,000,000"),
     ("microseconds", 1e3, "1,000")],
)  # fmt: skip
@pytest.mark.parametrize("start_ns", [0, 1_790_000_000_000_000_000])
def test_another_unit_is_named(unit, ns, factor, start_ns):
    captured = [int((start_ns + k * 33e6) / ns) for k in range(60)]
    assert f"stamps count {unit}" in str(stamps_remedy(captured, ARRIVED))
    assert f"multiply the time of capture by {factor}" in str(stamps_remedy(captured, ARRIVED))


@pytest.mark.parametrize(
    ("unit", "factor"),
    [("milliseconds", 1000), ("microseconds", 1_000_000), ("nanoseconds", 1_000_000_000)],
)
def test_another_unit_in_place_of_seconds_is_named(unit, factor):
    captured = [5 + k * 33_000_000 * factor for k in range(60)]
    assert f"stamps count {unit}" in str(stamps_remedy(captured, ARRIVED))
    assert f"divide the time of capture by {factor:,}" in str(stamps_remedy(captured, ARRIVED))


def test_stamps_that_run_backwards_or_race_are_named():
    backwards = [-k * 33_000_000 for k in range(60)]
    assert "run backwards" in str(stamps_remedy(backwards, ARRIVED))
    assert "times as fast as time passes" in str(
        stamps_remedy([k * 660_000_000 for k in range(60)], ARRIVED)
    )


@pytest.mark.parametrize("rate", [0.5, 0.999, 1.0, 1.001, 2.0])  # a clock, or a replay's factor
def test_nanoseconds_are_right(rate):
    assert stamps_remedy([int(5 + k * 33e6 * rate) for k in range(60)], ARRIVED) is None


def test_stamps_that_stand_still_are_named():
    assert "all stamps are alike" in str(stamps_remedy([7] * 60, ARRIVED))


def test_too_little_says_nothing():
    assert stamps_remedy([], []) is None
    assert stamps_remedy([1, 2, 3], [0, 10, 20]) is None
