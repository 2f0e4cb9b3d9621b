"""The search for a working distance always ends, and finds what a plain scan finds."""

from unittest import mock

import numpy as np
import pytest

from hri_predict.run.working_distance import waterfall as parts
from hri_predict.run.working_distance.measure import FARTHEST_M, NEAREST_M, STEP_M, Measure

MOST_TRIED = 200  # of (FARTHEST_M - NEAREST_M) / STEP_M = 285 steps, a plain scan's number


class Threshold(Measure):
    """The robot works from one distance on."""

    def __init__(self, from_m):
        self._from_m = from_m
        self.tried = []

    def works(self, distance_m):
        self.tried.append(distance_m)
        assert NEAREST_M <= distance_m <= FARTHEST_M
        assert len(self.tried) <= MOST_TRIED
        return distance_m >= self._from_m


def scanned(from_m, step):
    """Return the first of all steps at which the robot works."""
    steps = np.append(np.arange(NEAREST_M, FARTHEST_M, step), FARTHEST_M)
    return next((at_m for at_m in steps if at_m >= from_m), None)


PLACES = (-3.0, 0.0, NEAREST_M, 0.31, 1.0, 1.001, 1.5, 2.7, 5.99, FARTHEST_M, 9.0)


@pytest.mark.parametrize("step", [0.01, STEP_M, 0.3])
@pytest.mark.parametrize("from_m", [0.0, NEAREST_M, 0.32, 1.0, 1.5001, 3.3, 5.985, FARTHEST_M, 6.5])
def test_from_wherever_it_starts_it_ends_at_what_a_scan_finds(from_m, step):
    expected = scanned(from_m, step)
    for low in PLACES:
        for high in PLACES:  # equal, and swapped, too
            found = Threshold(from_m).distance_m(low=low, high=high, step=step)
            if expected is None:
                assert found is None
            else:
                # both lie at most a step above the true distance; 1e-9: rounding of the steps
                assert found == pytest.approx(expected, abs=step + 1e-9)
                assert found >= from_m


def test_a_cell_whose_speed_is_not_monotone_does_not_stop_the_search():
    class Striped(Threshold):
        def works(self, distance_m):
            return super().works(distance_m) and round(distance_m * 10) % 3 > 0

    for low in PLACES:
        for high in PLACES:
            found = Striped(0.5).distance_m(low=low, high=high, step=STEP_M)
            assert found is None or NEAREST_M <= found <= FARTHEST_M


COSTS = {
    "no term costs anything": {},
    "one term costs all": {"stopping": 0.8},
    "the first one does": {"silence_timeout": 0.8},
    "the last one does": {"robot_state": 0.8},
    "each costs less than a step": {term.key: 0.003 for term in parts.TERMS},
    "one makes it worse": {"stopping": 0.5, "seen": -0.4},
    "all make it worse": {term.key: -0.1 for term in parts.TERMS},
    "more than there is": {term.key: 0.5 for term in parts.TERMS},
}


@pytest.mark.parametrize("total_m", [NEAREST_M, 0.9, 2.0, FARTHEST_M])
@pytest.mark.parametrize("costs", COSTS.values(), ids=COSTS)
def test_terms_that_cost_nothing_end_the_waterfall_at_once(monkeypatch, costs, total_m):
    tried = []

    class Cells:
        def __init__(self, *_):
            pass

        def counts(self, _):
            return True

        def measure(self, taken):
            made = Threshold(total_m - sum(costs.get(key, 0.0) for key in taken))
            tried.append(made)
            return made

    monkeypatch.setattr(parts, "_Cells", Cells)
    found = parts.waterfall(mock.Mock(), np.zeros(2), step=0.01)
    assert found.total_m is not None
    assert sum(found.costs_m.values()) + found.rest_m == pytest.approx(found.total_m)
    assert found.rest_m <= found.total_m
    if not costs:
        assert max(map(abs, found.costs_m.values())) <= 0.02
