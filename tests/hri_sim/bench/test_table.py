"""Tables on the screen: legible at 80 columns, with what stands beside a figure."""

import io

import pytest
from rich.console import Console

from hri_sim.bench import links, table
from hri_sim.bench.rows import Row
from hri_sim.bench.saved import Change

ROWS = [
    Row(part="serial 921600, 25 Hz, constant_velocity: inference", unit="ms", p50=1.5, p99=2, max=3,
        aim=1.0, aim_of="p99", why="aim: as asked"),
    Row(part="wait", unit="ms", p50=40.0, floor=20.0, why="floor: half a period"),
    Row(part="speed", unit="x", p50=10.0, aim=20.0, more_is_better=True),
    Row(part="bus", unit="ms", note="no such wire here"),
]  # fmt: skip


def shown(width: int) -> str:
    out = io.StringIO()
    table.show(Console(file=out, width=width), "age: from capture", ROWS)
    return out.getvalue()


@pytest.mark.parametrize("width", [80, 120])
def test_every_figure_is_whole(width):
    text = shown(width)
    assert all(len(line) <= width for line in text.splitlines())
    for whole in ("p99 < 1.00", "floor 20.0", "> 20.0", "1.50", "40.0"):
        assert whole in text
    assert "- aim: as asked" in text
    assert "- bus: no such wire here" in text


def test_times_is_the_figure_over_what_stands_beside_it():
    lines = shown(120).splitlines()
    assert [line.split()[-1] for line in lines if " < " in line or "floor 20" in line] == [
        "2.00",
        "2.00",
    ]


@pytest.mark.parametrize(
    ("value", "text"),
    [(None, ""), (0.0, "0"), (0.001, "0.001"), (0.5, "0.50"), (12.34, "12.3"), (12345.6, "12346"),
     (-0.55, "-0.55")],
)  # fmt: skip
def test_numbers(value, text):
    assert table.number(value) == text


@pytest.mark.parametrize(
    ("verdict", "told"),
    [
        ("worse", "1 of 1 got worse by"),
        ("as before", "nothing of 1"),
        ("new", "1 of 1 were not compared:\n  a: tick: new"),
    ],
)
def test_what_got_worse_is_listed(verdict, told):
    out = io.StringIO()
    change = Change(section="a", part="tick", p50=2.0, p99=None, verdict=verdict)
    table.show_changes(Console(file=out, width=80), [change], 1.5)
    assert told in out.getvalue()


def test_rows_of_figures_are_formatted_by_column(capsys):
    rows = [{"by": "router", "us": {"p50": 1.25}, "n": 3, "of": 4}]
    table.figures(
        "Figures", {"by": "{by}", "p50": "{us[p50]:.1f}", "received": "{n} of {of}"}, rows
    )
    printed = capsys.readouterr().out
    assert all(text in printed for text in ("Figures", "router", " 1.2 ", "3 of 4"))


@pytest.mark.parametrize(("as_json", "text"), [(True, '{"rss_mib": 3}'), (False, "rss mib: 3")])
def test_a_single_result(capsys, as_json, text):
    table.facts({"rss_mib": 3}, as_json)
    assert capsys.readouterr().out == text + "\n"


def test_the_table_of_delays_names_each_kind_of_link(capsys):
    ms = {"p50": 1.25, "p99": 2.5}
    rows = [
        {"link": "CAN", "rate_hz": 25.0, "link_ms": ms, "scenes": 3},
        {"link": "UDP", "rate_hz": 25.0, "not_here": "no multicast"},
    ]
    table.figures("Delays", links._DELAYS, rows)
    printed = capsys.readouterr().out
    assert all(text in printed for text in ("CAN", "1.25 / 2.50", "UDP", "not available"))
