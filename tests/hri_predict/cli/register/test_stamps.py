"""Stamps that count something else than nanoseconds are named, with what to multiply them by."""

import pytest

from hri_predict.cli.register.stamps import stamps_remedy, unit_of_stamps

ARRIVED = [k * 33_000_000 + (k % 5) * 4_000_000 for k in range(60)]  # 30 Hz with 16 ms of jitter


@pytest.mark.parametrize(
    ("unit", "ns", "factor"),
    [("seconds", 1e9, "1,000,000,000"), ("milliseconds", 1e6, "1,000,000"),
     ("microseconds", 1e3, "1,000")],
)  # fmt: skip
@pytest.mark.parametrize("start_ns", [0, 1_790_000_000_000_000_000])
def test_another_unit_is_named(unit, ns, factor, start_ns):
    captured = [int((start_ns + k * 33e6) / ns) for k in range(60)]
    assert unit_of_stamps(captured, ARRIVED) == unit
    assert f"stamps count {unit}" in str(stamps_remedy(captured, ARRIVED))
    assert f"by {factor}" in str(stamps_remedy(captured, ARRIVED))


@pytest.mark.parametrize("rate", [0.5, 0.999, 1.0, 1.001, 2.0])  # a clock, or a replay's factor
def test_nanoseconds_are_right(rate):
    assert stamps_remedy([int(5 + k * 33e6 * rate) for k in range(60)], ARRIVED) is None


def test_stamps_that_stand_still_are_named():
    assert "all stamps are alike" in str(stamps_remedy([7] * 60, ARRIVED))


def test_too_little_says_nothing():
    assert stamps_remedy([], []) is None
    assert stamps_remedy([1, 2, 3], [0, 10, 20]) is None
