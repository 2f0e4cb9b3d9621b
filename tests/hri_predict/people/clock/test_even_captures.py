"""Captures of an even rate whose stamps scatter."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hri_predict.contracts.scene import Scene
from hri_predict.people.clock.scene_gate import FEWEST, MOST_NS, WINDOW, EvenCaptures, SceneGate

PERIOD_NS = 33_366_700  # 29.97 Hz
MS = 1_000_000


def moved(sequences, stamps):
    even = EvenCaptures()
    return np.array([even.move(int(k), int(ns)) for k, ns in zip(sequences, stamps, strict=True)])


def late(seed, count, most_ms):
    return np.random.default_rng(seed).uniform(0, most_ms * MS, count).astype(np.int64)


@pytest.mark.parametrize("kept", [1.0, 0.8], ids=["all arrive", "one of five is lost"])
@pytest.mark.parametrize("seed", range(10))
def test_late_stamps_are_moved_to_when_the_camera_looked(seed, kept):
    rng = np.random.default_rng(100 + seed)
    sequences = np.flatnonzero(rng.random(600) < kept)
    true = sequences * PERIOD_NS
    found = moved(sequences, true + late(seed, len(true), 30)) - true
    settled = found[WINDOW:]
    # the slope's error, sigma sqrt(12 / n^3) per scene, reaches the end from the middle: 1.6 ms;
    # the earliest of n is 30 ms / n later than it might be
    assert np.abs(settled - settled.mean()).max() < 5 * 1.6 * MS
    assert settled.std() < 2.5 * MS  # of stamps: 8.7


@pytest.mark.parametrize("rate_hz", [8, 30, 120])
def test_stamps_that_scatter_little_stay_to_the_nanosecond(rate_hz):
    stamps = np.arange(300) * (10**9 // rate_hz) + late(1, 300, 3)
    assert (moved(range(300), stamps) == stamps).all()


def test_captures_that_come_unevenly_stay():
    """A tracker that takes now 20, now 50 ms for a body, and stamps when the camera looked."""
    steps = np.random.default_rng(2).uniform(20 * MS, 50 * MS, 600).astype(np.int64)
    stamps = np.cumsum(steps)
    assert (moved(range(600), stamps) == stamps).mean() > 0.99


def test_another_rate_or_a_pause_moves_nothing():
    slower = np.concatenate([np.arange(200) * 33 * MS, 200 * 33 * MS + np.arange(200) * 66 * MS])
    paused = np.concatenate([np.arange(200) * 33 * MS, 9 * 10**9 + np.arange(200) * 33 * MS])
    for stamps in (slower, paused):
        assert (moved(range(400), stamps) == stamps).all()


def test_the_first_that_is_moved_keeps_its_distance():
    lateness = late(3, 200, 30)
    lateness[FEWEST - 2], lateness[FEWEST - 1] = 30 * MS, 29 * MS
    found = moved(range(200), np.arange(200) * PERIOD_NS + lateness)
    assert np.diff(found[FEWEST - 2 :]).min() > 0.4 * PERIOD_NS


@given(
    steps=st.lists(st.integers(1, 200 * MS), min_size=40, max_size=150),
    gaps=st.lists(st.integers(-3, 4), min_size=150, max_size=150),
)
def test_whatever_comes_no_capture_becomes_newer_nor_much_older_and_all_advance(steps, gaps):
    stamps, sequences = np.cumsum(steps), np.cumsum(gaps[: len(steps)])
    found = moved(sequences, stamps)
    assert ((stamps - MOST_NS <= found) & (found <= stamps)).all()
    assert (np.diff(found) > 0).all()


@pytest.mark.parametrize("even", [True, False])
def test_the_gate_moves_where_the_source_is_said_to_be_even_and_counts(even):
    gate = SceneGate(PERIOD_NS, 0, even_captures=even)
    stamps = np.arange(200) * PERIOD_NS + late(4, 200, 30)
    found = [gate.admit(Scene(int(ns), k, True, ()), int(ns) + MS) for k, ns in enumerate(stamps)]
    assert None not in found
    scatter = np.std(np.array(found)[WINDOW:] - np.arange(200)[WINDOW:] * PERIOD_NS)
    if even:
        assert scatter < 3 * MS
        assert gate.counts()["stamps_evened"] > 100
    else:
        assert scatter > 7 * MS
        assert "stamps_evened" not in gate.counts()


def test_after_a_restart_of_the_source_it_begins_anew():
    even = EvenCaptures()
    for k, ns in enumerate(np.arange(100) * PERIOD_NS + late(5, 100, 30)):
        even.move(k, int(ns))
    assert even.moved
    assert even.move(0, 10**12) == 10**12


@pytest.mark.parametrize("first", [-(10**30), 2**70])
def test_a_source_may_count_further_than_64_bits(first):
    stamps = np.arange(200) * PERIOD_NS + late(6, 200, 30)
    even = EvenCaptures()
    found = [even.move(first + k, int(ns)) for k, ns in enumerate(stamps)]
    assert (moved(range(200), stamps) == found).all()
    even.move(2**90, int(stamps[-1]) + PERIOD_NS)
