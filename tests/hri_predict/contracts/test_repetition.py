"""How often messages are sent, and how many may be lost."""

from math import inf

import pytest

from hri_predict.contracts.link import LinkSettings
from hri_predict.contracts.repetition import (
    HEARD_LATE_S,
    LOST_MESSAGES,
    lost_without_silence,
    messages_hz,
)


def link(**values: object) -> LinkSettings:
    return LinkSettings.model_validate({"name": "a", "kind": "can"} | values)


@pytest.mark.parametrize("silence_timeout_s", [0.04, 0.06, 0.1, 0.15, 0.5])
def test_two_lost_messages_are_not_silence_by_default(silence_timeout_s):
    interval_s = link(silence_timeout_s=silence_timeout_s).repeat_s
    assert lost_without_silence(silence_timeout_s, interval_s) == LOST_MESSAGES
    heard_after_s = (LOST_MESSAGES + 1) * interval_s + HEARD_LATE_S
    assert heard_after_s <= silence_timeout_s + 1e-9


def test_the_default_is_more_than_fifty_a_second():
    assert 1 / link().repeat_s == pytest.approx(66.7, abs=0.1)


@pytest.mark.parametrize(("repeat_hz", "interval_s"), [(0, inf), (50, 0.02), (200, 0.005)])
def test_a_rate_that_is_set_is_used(repeat_hz, interval_s):
    assert link(repeat_hz=repeat_hz).repeat_s == interval_s


def test_a_time_out_below_the_interval_is_known():
    assert lost_without_silence(0.05, 0.04) == -1
    assert lost_without_silence(0.055, 0.04) == 0


@pytest.mark.parametrize(
    ("interval_s", "least_hz", "most_hz", "sent_hz"),
    [
        (inf, 25, 25, 25),  # each cycle's own alone
        (0.05, 25, 25, 25),
        (0.04, 25, 25, 25),
        (0.015, 25, 25, 75),
        (0.02, 25, 25, 50),
        (0.015, 25, 100, 2 / 0.015),  # a cycle just longer than the interval sends two
        (0.005, 25, 100, 3 / 0.01),
        (inf, 25, 100, 100),
    ],
)
def test_the_rate_at_most(interval_s, least_hz, most_hz, sent_hz):
    assert messages_hz(interval_s, least_hz, most_hz) == pytest.approx(sent_hz)


@pytest.mark.parametrize("interval_s", [0.005, 0.013, 0.015, 0.021, 0.05])
def test_no_length_of_cycle_sends_more(interval_s):
    at_most_hz = messages_hz(interval_s, 25, 100)
    for k in range(10_000, 40_000, 7):
        cycle_s = k * 1e-6
        sent = 1 + int((cycle_s - 1e-9) / interval_s)
        assert sent / cycle_s <= at_most_hz + 1e-6
