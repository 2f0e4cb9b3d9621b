"""What the bench of the page counts as a delay."""

import json

import pytest

pytest.importorskip("zenoh", reason="zenoh is an extra")

from hri_sim.bench.fleet_page import CHANGES_S, RATE_HZ, WARM_S, _figures, is_change

PERIOD_NS = 1_000_000_000 // RATE_HZ
START = 10**12


def event(now_ns: int, *numbers: int) -> tuple[int, bytes]:
    """An event that shows these cycles; -1: no level."""
    cells = [
        {
            "name": f"cell-{i}",
            "level": "GONE" if number < 0 else "CLEAR",
            "robots": [{"separation_m": max(number, 0) * 1e-3}],
        }
        for i, number in enumerate(numbers)
    ]
    return now_ns, b"data: " + json.dumps({"cells": cells}).encode()


def posted(cycles: int) -> list[int]:
    return [START + cycle * PERIOD_NS for cycle in range(cycles)]


def test_a_message_is_shown_by_the_first_event_with_it_or_a_newer_one():
    cycles = WARM_S * RATE_HZ + 20
    times = posted(cycles)
    events = [event(times[c] + 7_000_000, c, c) for c in range(0, cycles, 4)]
    row = _figures([times, times], events)
    # of four in a row, the first waits 7 ms, the others for the next event: 127, 87, 47 ms
    assert row["number_ms"]["max"] == pytest.approx(127.0)
    assert row["number_ms"]["p50"] == pytest.approx(47.0)  # 5 times 7, 5 times 47, 4 times 87, 127
    assert row["change_ms"] is None
    assert row["unshown"] == 2 * ((cycles - 1) % 4)
    assert row["gone"] == 0


def test_tiles_without_a_level_are_counted_and_show_nothing():
    times = posted(WARM_S * RATE_HZ + 10)
    last = len(times) - 1
    row = _figures([times], [event(times[last - 5] + 1, -1), event(times[last] + 1, last)])
    assert row["gone"] == 1
    assert row["unshown"] == 0
    assert row["number_ms"]["max"] == pytest.approx(360.0)


def test_each_cells_level_changes_once_in_its_time():
    for index in range(40):
        changes = [c for c in range(4 * CHANGES_S * RATE_HZ) if is_change(index, c)]
        assert len(changes) == 4
