"""The verdict of ``bench predictors``: which rates a predictor's forecasts are in time for."""

import json

import pytest
from typer.testing import CliRunner

from hri_sim.bench import forecasts
from hri_sim.bench.command import app


@pytest.mark.parametrize(
    ("p99_ms", "fits_hz"), [(0.1, 100), (5.0, 100), (18.4, 27), (20.0, 25), (50.0, 10), (50.1, 0)]
)
def test_a_forecast_has_half_a_cycle(p99_ms, fits_hz):
    assert forecasts.fits_hz(p99_ms) == fits_hz


def row(predictor, engine, people, p99_ms):
    return {
        "predictor": predictor,
        "engine": engine,
        "people": people,
        "p50_ms": p99_ms / 2,
        "p99_ms": p99_ms,
        "max_ms": p99_ms * 2,
        "forecasts": 100,
        "differs_mm": 0.0,
        "floor_ms": None,
        "fits_hz": forecasts.fits_hz(p99_ms),
    }


@pytest.fixture
def asked(monkeypatch):
    """Measure nothing, and note what was asked."""
    found = []

    def measure(names, people, _):
        found.extend(names)
        for count in people:
            yield [
                row("sinn", "torch", count, 18.0 * count),
                row("sinn", "onnxruntime", count, 9.0 * count),
                row("constant_velocity", "–", count, 0.1),
            ]

    monkeypatch.setattr(forecasts, "measure", measure)
    return found


def test_what_fits_the_default_rate_is_said_for_each_number_of_people(asked):
    said = CliRunner().invoke(app, ["predictors", "--people", "1", "--people", "4"]).stdout
    one, four = said.splitlines()[-2:]
    limit = "within 20 ms (p99), half a cycle at rate_hz 25"
    assert one == f"1 person: {limit}: sinn torch, sinn onnxruntime, constant_velocity"
    assert four == f"4 people: {limit}: constant_velocity"
    assert "to 27" in said
    assert "to 13" in said
    assert "none" in said


def test_json_has_the_rate_and_no_other_line(asked):
    done = CliRunner().invoke(app, ["predictors", "--people", "4", "--json"])
    assert [each["fits_hz"] for each in json.loads(done.stdout)] == [0, 13, 100]


def test_the_default_and_the_cheapest_are_measured_unless_others_are_named(asked):
    CliRunner().invoke(app, ["predictors", "--json"])
    assert {"sinn", "average", "constant_velocity"} <= set(asked)
    asked.clear()
    CliRunner().invoke(app, ["predictors", "--predictor", "sinn", "--json"])
    assert asked == ["sinn"]
