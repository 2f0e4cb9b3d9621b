"""A machine that slept is noticed, and one that was only busy is not taken for one."""

import pytest

from hri_predict.base.machine.asleep import AT_ONCE_NS, LEAST_NS, TRIES, Asleep

SECOND = 1_000_000_000


class Clocks:
    """Two clocks of the test's; ``delays`` come between the two readings of the first."""

    def __init__(self) -> None:
        self.now_ns, self.slept_ns = 100 * SECOND, 7 * SECOND
        self.delays: list[int] = []

    def __call__(self) -> tuple[int, int, int]:
        first_ns = self.now_ns
        self.now_ns += self.delays.pop(0) if self.delays else 200
        return first_ns, self.now_ns + self.slept_ns, self.now_ns


def test_sleep_before_the_start_does_not_count() -> None:
    assert Asleep(Clocks()).since_last_s() == 0.0


def test_each_sleep_is_told_once() -> None:
    clocks = Clocks()
    asleep = Asleep(clocks)
    clocks.now_ns += SECOND  # a second awake
    clocks.slept_ns += 600 * SECOND
    # within the 200 ns between the readings, twice
    assert asleep.since_last_s() == pytest.approx(600.0, abs=1e-6)
    assert asleep.since_last_s() == 0.0


@pytest.mark.parametrize("tries", [1, TRIES - 1])
def test_a_process_that_was_stopped_between_the_readings_did_not_sleep(tries: int) -> None:
    clocks = Clocks()
    asleep = Asleep(clocks)
    clocks.delays = [3 * SECOND] * tries
    assert asleep.since_last_s() == 0.0


def test_a_sleep_that_cannot_be_measured_now_is_told_later() -> None:
    clocks = Clocks()
    asleep = Asleep(clocks)
    clocks.slept_ns += SECOND
    clocks.delays = [2 * AT_ONCE_NS] * TRIES
    assert asleep.since_last_s() == 0.0
    assert asleep.since_last_s() == pytest.approx(1.0, abs=1e-6)


def test_what_is_shorter_than_any_sleep_is_none() -> None:
    clocks = Clocks()
    asleep = Asleep(clocks)
    clocks.slept_ns += LEAST_NS - AT_ONCE_NS
    assert asleep.since_last_s() == 0.0


def test_the_systems_clocks_agree_while_it_is_awake() -> None:
    asleep = Asleep()
    assert [asleep.since_last_s() for _ in range(1000)] == [0.0] * 1000
