"""``bench trackers``: walks, their settings, and one case through the whole node."""

import json
import math

import pytest
from hypothesis import given
from hypothesis import strategies as st
from typer.testing import CliRunner

from hri_predict.base.errors import ConfigError
from hri_predict.base.settings import validated
from hri_sim.bench.command.bench import app
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


def test_a_case_that_does_not_exist_is_refused_with_those_there_are():
    done = CliRunner().invoke(app, ["trackers", "--only", "coco18"])
    assert isinstance(done.exception, ConfigError)
    assert "coco17 white 2 cm" in str(done.exception)


@pytest.mark.long
def test_a_case_as_json():
    arguments = ["trackers", "--only", "coco17 none", "--walks", "1", "--json"]
    done = CliRunner().invoke(app, [*arguments, "--predictor", "constant_velocity"])
    assert done.exit_code == 0, done.output
    (row,) = json.loads(done.stdout)
    assert (row["tracker"], row["noise"], row["walks"]) == ("coco17", "none", 1)
    assert row["ticks"] > 100
    assert 0 <= row["unlike_percent"] <= 100
    assert row["ratio"] == pytest.approx(row["predictive_m_s"] / row["iso_m_s"], rel=0.01)
    assert row["clear_too_near"] == row["contacts"] == 0
