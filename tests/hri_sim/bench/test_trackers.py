"""``bench trackers``: walks, and which cases are chosen."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hri_predict.base.settings import validated
from hri_sim.bench.trackers import NOISES, TRACKERS, cases, walk
from hri_sim.people.procedural import ProceduralSettings, ProceduralSource


def test_every_tracker_meets_every_noise():
    assert len(cases()) == len(TRACKERS) * len(NOISES)
    assert cases("zed34 white") == [("zed34", "white 2 cm")]
    assert cases("nobody") == []


@given(seed=st.integers(0, 10_000))
def test_a_walk_comes_near_and_goes_away_again(seed):
    person = walk(seed)
    ProceduralSource(
        validated(ProceduralSettings, {"kind": "procedural", "people": [person]}, "walk")
    )
    there, _, back = person["script"]
    assert 1.0 <= math.hypot(*there["to"]) <= 2.4
    assert math.hypot(*person["start"]) == pytest.approx(5.0, abs=2e-3)  # rounded to millimetres
    assert math.hypot(*back["to"]) == pytest.approx(5.0, abs=2e-3)
    assert walk(seed) == person
