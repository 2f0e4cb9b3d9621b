"""The live view: legible on the smallest common terminal, and it tells what is wrong."""

import io

import pytest
from rich.console import Console

from hri_predict.cli.terminal.view import trouble
from hri_predict.contracts.source import SourceCounters
from tests.hri_predict.cli.terminal.shown import demo, view_after


@pytest.fixture(scope="module")
def shown():
    """The demo after nine seconds: a person is near."""
    return view_after(demo().with_predictor("constant_velocity", horizon_s=1.2), 9.0)[0]


def page_of(view, width, height):
    console = Console(file=io.StringIO(), width=width, height=height, record=True)
    view._console = console
    console.print(view.page())
    return console.export_text().rstrip("\n").split("\n")


@pytest.mark.parametrize(("width", "height"), [(80, 24), (100, 30), (160, 60)])
@pytest.mark.long
def test_the_page_fits_the_terminal_and_names_level_reason_and_speed(shown, width, height):
    lines = page_of(shown, width, height)
    assert len(lines) < height
    assert max(len(line) for line in lines) <= width
    page = "\n".join(lines)
    for words in ("STOP", "nearest", "m/s allowed", "drive", "monitor"):
        assert words in page
    assert "12:00:08Z" in page
    assert "█" in page
    assert "o" in page.split("zone")[1]


@pytest.mark.parametrize(("width", "height"), [(80, 24), (160, 60)])
def test_a_footer_stands_below_the_page_and_fits_too(shown, width, height, monkeypatch):
    monkeypatch.setattr(shown, "_footer", lambda: "viewer: http://127.0.0.1:8090  Ctrl-C ends it")
    lines = page_of(shown, width, height)
    assert lines[-1].strip() == "viewer: http://127.0.0.1:8090  Ctrl-C ends it"
    assert len(lines) < height
    assert max(len(line) for line in lines) <= width


def test_trouble_at_a_live_source_is_told_while_the_node_runs():
    counters = SourceCounters(unknown_joints=12, lost=3)
    counters.note("joint 'Hand_L' is not in the joint map coco17")
    assert trouble(counters) == [
        "12 joints with unknown names",
        "3 lost",
        "joint 'Hand_L' is not in the joint map coco17",
    ]
    assert trouble(SourceCounters()) == []
