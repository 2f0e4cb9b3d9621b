"""Which clock a stamp is of."""

import pytest

from hri_predict.protocol.ros.stamps import clock_of

UTC, BOOT, S = 1_790_000_000 * 10**9, 90_000 * 10**9, 10**9


@pytest.mark.parametrize(
    ("at_ns", "clock"),
    [
        (UTC - S, "utc"),
        (UTC + 60 * S, "utc"),
        (BOOT - S, "boot"),
        (BOOT + S, "other"),  # this machine has not been up for so long
        (12 * S, "other"),  # a simulation's
        (-S, "other"),
        (UTC - 5 * 3600 * S, "other"),  # a wrong time zone
    ],
)
def test_a_stamp_is_of_the_clock_that_it_is_near(at_ns, clock):
    assert clock_of(at_ns, UTC, BOOT) == clock
