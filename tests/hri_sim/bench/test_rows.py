"""Rows: their percentiles, and those of a command's table; and the machine they stand for."""

import json
from typing import Any

from hri_sim.bench import saved
from hri_sim.bench.rows import QUICK, Row, Scope, measured, rows_of


def test_percentiles_of_a_row():
    row = measured("a", "ms", list(range(101)), aim=60.0)
    assert (row.p50, row.p99, row.max, row.aim) == (50.0, 99.0, 100.0, 60.0)


def test_nothing_measured_is_said():
    row = measured("a", "ms", [])
    assert (row.p50, row.note) == (None, "nothing was measured")


def test_each_figure_of_a_line_is_a_row_named_by_the_line():
    spread: dict[str, Any] = {"p50": 1.0, "p99": 2.0, "max": 3.0}
    lines: list[dict[str, Any]] = [
        {"link": "bus", "rate_hz": 25.0, "total_ms": spread, "speed_m_s": 0.5, "sent": 3},
        {"link": "wire", "rate_hz": 25.0, "not_here": "no such wire"},
        {"link": "port", "rate_hz": 25.0, "age_ms": None},
        {"link": "node", "rate_hz": 25.0, "cpu_percent": {"all": 9.0, "loop": 7.0}},
    ]
    assert list(rows_of(lines, "link", "rate_hz", more_is_better=("speed_m_s",))) == [
        Row(part="bus, 25 Hz: total", unit="ms", **spread),
        Row(part="bus, 25 Hz: speed", unit="m/s", p50=0.5, more_is_better=True),
        Row(part="wire, 25 Hz", unit="", note="no such wire"),
        Row(part="node, 25 Hz: cpu, all", unit="%", p50=9.0),
        Row(part="node, 25 Hz: cpu, loop", unit="%", p50=7.0),
    ]


def test_a_quick_scope_asks_no_more_than_the_whole():
    whole = Scope()
    assert QUICK.seconds < whole.seconds
    for name in ("batches", "people", "joint_maps", "horizons_s", "robots", "rates_hz"):
        assert set(getattr(QUICK, name)) <= set(getattr(whole, name)), name


def test_the_machine_is_stated():
    facts = saved.machine()
    assert facts["cores"] >= 1
    assert facts["processor"]
    assert facts["yardstick_us"] > 0
    assert facts["libraries"]["numpy"]
    assert json.loads(json.dumps(facts)) == facts
    assert facts["processor"] in saved.described(facts)


def test_a_busy_machine_is_told():
    assert saved.busy(0.5) == ""
    assert "load average 0.6, over 0.5" in saved.busy(0.6)
