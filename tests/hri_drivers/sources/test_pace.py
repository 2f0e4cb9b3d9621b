"""A sender slower than rate_hz is one note with the measured rate, not a line for each gap."""

import pytest

from hri_drivers.sources.pace import AGAIN_NS, WINDOW_NS, SenderPace

S = 1_000_000_000


def notes(rate_hz, configured_hz, seconds, connected=lambda k: True):
    pace = SenderPace(configured_hz)
    said = (
        pace.note(int(k * 0.1 * rate_hz), connected(k), k * S // 10) for k in range(seconds * 10)
    )
    return [line for line in said if line]


def test_a_slow_sender_is_one_note_with_its_rate_and_the_remedy():
    (line,) = notes(8, 30, 60)
    assert line.startswith("8.0 scenes per second arrive, and source.rate_hz is 30")
    assert "set source.rate_hz to 8" in line


def test_it_is_said_again_after_ten_minutes():
    assert len(notes(8, 30, (AGAIN_NS + 2 * WINDOW_NS) // S)) == 2


@pytest.mark.parametrize("rate_hz", [22, 30, 60])
def test_a_sender_that_loses_a_few_is_not_slow(rate_hz):
    assert notes(rate_hz, 30, 60) == []


def test_silence_and_a_lost_connection_are_not_slowness():
    assert notes(0, 30, 60) == []
    assert notes(8, 30, 60, connected=lambda k: k % 50 != 0) == []


def test_a_sender_that_is_started_late_or_stopped_for_a_while_is_not_slow():
    for silent in ((0, 4), (12, 16), (0, 30)):
        pace, scenes, said = SenderPace(30), 0, []
        for k in range(600):
            scenes += 0 if silent[0] <= k * 0.1 < silent[1] else 3
            said.append(pace.note(scenes, True, k * S // 10))
        assert not any(said)
