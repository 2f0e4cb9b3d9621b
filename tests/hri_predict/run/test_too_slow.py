"""A machine that cannot keep the rate is named while the node runs, with a remedy that fits."""

import threading
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from hri_predict.base.files import data_path
from hri_predict.base.settings import validated
from hri_predict.contracts import registry
from hri_predict.operation.monitoring.pace import Pace
from hri_predict.run.config import load
from hri_predict.run.runtime import run_real_time
from hri_predict.run.too_slow import TooSlow, _cheaper
from tests.hri_predict.run.fakes import MS, Source, make


def watched(*, predictor="stb", path="cell.yaml", ticks="fixed", rate_hz=25.0, late=0):
    """The watch of a node; ``late`` forecasts."""
    largest_hz = rate_hz if ticks == "fixed" else 100.0
    node = SimpleNamespace(ticks=ticks, rate_hz=rate_hz, largest_rate_hz=largest_hz)
    members = ("mixer", "sinn") if predictor == "of two" else ()
    named = SimpleNamespace(name=predictor, runs=lambda: members, model_fields_set={"name"})
    config: Any = SimpleNamespace(node=node, predictor=named, path=Path(path))
    pace = Pace()
    return TooSlow(config, 30.0, pace, lambda: {"predictor_late": late}), pace


def ran(pace, tick_ms=20.0, *, ticks=1000, late=0, missed=0):
    for _ in range(ticks):
        pace.note(tick_ms * 1e-3)
    pace.late_ticks += late
    pace.missed_ticks += missed


@pytest.mark.parametrize(
    ("late", "missed", "says"), [(0, 0, False), (5, 0, False), (11, 0, True), (3, 8, True)]
)
def test_the_summary_has_the_line_from_one_tick_in_a_hundred(late, missed, says):
    watch, pace = watched()
    ran(pace, ticks=1000 - missed, late=late, missed=missed)
    told = f"too slow: {late} of 1000 ticks were late and {missed} missed, which"
    assert watch.of_run().startswith(told) == says
    assert bool(watch.of_run()) == says


@pytest.mark.parametrize(
    ("predictor", "named"),
    [
        ("of two", "set predictor.name to mixer (or constant_velocity, the cheapest)"),
        ("stb", "set predictor.name to constant_velocity"),
        ("theirs", "set predictor.name to constant_velocity"),
    ],
)
def test_a_late_predictor_is_exchanged_first(predictor, named):
    watch, pace = watched(predictor=predictor, late=74)
    ran(pace, 50.0, late=81)
    said = watch.of_run()
    assert f"most forecasts were late: {named}, or lower rate_hz to 16 in cell.yaml; or" in said


@pytest.mark.parametrize(
    ("given", "to", "gone"),
    [
        ({"name": "average", "members": ["mixer", "sinn"]}, "mixer", ["members"]),
        ({"name": "average", "members": ["mixer", "sinn"]}, "constant_velocity", ["members"]),
        (
            {"name": "sinn", "weights": "mine.safetensors", "horizon_s": 0.8},
            "constant_velocity",
            ["weights"],
        ),
    ],
)
def test_settings_that_the_cheaper_predictor_lacks_are_named(given, to, gone):
    settings = validated(registry.predictor_settings(given["name"]), given, "predictor")
    said = _cheaper(settings)
    assert said.endswith("".join(f" and remove predictor.{key}" for key in gone))
    kept = {key: value for key, value in given.items() if key not in gone} | {"name": to}
    validated(registry.predictor_settings(to), kept, "predictor")


def test_a_late_predictor_is_second_where_ticks_are_late_without_it():
    """A tick of 40 ms waits for a forecast for at most 20."""
    watch, pace = watched(late=74)
    ran(pace, 65.0, late=81)
    assert "ticks took 65 ms (p99): lower rate_hz to 12, or set predictor.name" in watch.of_run()
    watch, pace = watched(late=74)
    ran(pace, 145.0, late=81)
    assert "use a faster machine, or set predictor.name to constant_velocity" in watch.of_run()


@pytest.mark.parametrize("predictor", ["constant_velocity", "kalman", "zero_velocity"])
def test_no_predictor_is_named_that_costs_no_less(predictor):
    watch, pace = watched(predictor=predictor, late=74)
    ran(pace, 50.0, late=81)
    assert "predictor.name" not in watch.of_run()
    assert "lower rate_hz to 16" in watch.of_run()


@pytest.mark.parametrize(
    ("tick_ms", "options", "says"),
    [
        (50.0, {}, "ticks took 50 ms (p99): lower rate_hz to 16 in cell.yaml; or stop other"),
        (33.0, {}, "lower rate_hz to 24 in"),  # they are late only sometimes
        (145.0, {}, "ticks took 145 ms (p99), too long even for 10 Hz, the minimum: stop other"),
        (5.0, {}, "ticks took only 5 ms (p99) but began late: stop other programs"),
        (38.0, {"ticks": "capture"}, "lower rate_hz and max_rate_hz to 21 in"),
        (38.0, {"ticks": "capture", "rate_hz": 10.0}, "lower max_rate_hz to 21 in"),
        (5.0, {"ticks": "capture"}, "ticks took only 5 ms"),
    ],
)
def test_slow_ticks_name_a_rate_that_fits(tick_ms, options, says):
    watch, pace = watched(**options)
    ran(pace, tick_ms, late=100)
    assert says in watch.of_run()


@pytest.mark.parametrize("shipped", ["demo.yaml", "plant_modbus.yaml", "try.yaml"])
def test_a_shipped_configuration_is_changed_in_a_copy(shipped):
    """``try`` makes its configuration up, of the demo's."""
    watch, pace = watched(path=data_path(shipped))
    ran(pace, 50.0, late=100)
    file = data_path("demo.yaml" if shipped == "try.yaml" else shipped)
    assert f"lower rate_hz to 16 in a copy of {file}, which run and replay accept" in watch.of_run()
    assert load(file).path == file


def logged(caplog):
    return [r.getMessage() for r in caplog.records if r.name.endswith("too_slow")]


def test_the_warning_comes_once_a_minute_while_ticks_are_late(caplog):
    watch, pace = watched()
    said = []
    for second in range(0, 131):
        ran(pace, 50.0, ticks=20, late=20, missed=5)
        watch.note(second * 1000 * MS)
        said.append(len(logged(caplog)))
    assert [said.index(n) for n in (1, 2, 3)] == [5, 65, 125]
    assert "too slow: 100 of 125 ticks were late and 25 missed in the last 5 s" in logged(caplog)[1]


def test_few_late_ticks_are_not_warned_of(caplog):
    watch, pace = watched()
    for second in range(0, 60):
        ran(pace, 20.0, ticks=25, late=2)
        watch.note(second * 1000 * MS)
    assert logged(caplog) == []


@pytest.mark.parametrize("took_ms", [15, 30])
def test_the_loop_warns_and_reports(monkeypatch, caplog, took_ms):
    monkeypatch.setattr("hri_predict.run.runtime.gc.collect", lambda: 0)
    assembly = make(source=Source(count=0), virtual=True)
    clock, node = assembly.clock, assembly.node
    node.tick = lambda _: clock.advance_to(clock.now_ns() + took_ms * MS)
    pace = run_real_time(assembly=assembly, stop=threading.Event(), duration_s=6.0)
    assert len(logged(caplog)) == (took_ms == 30)
    assert pace.too_slow.startswith("too slow: ") == (took_ms == 30)
