"""The live view: legible on the smallest common terminal, and it tells what is wrong."""

import io

import pytest
from rich.console import Console

from hri_predict import registry
from hri_predict.cli.terminal.view import TerminalView, trouble
from hri_predict.clock import VirtualClock
from hri_predict.run import assemble
from hri_predict.run import config as configuration
from hri_predict.run.runtime import run_virtual
from hri_predict.source import SourceCounters


@pytest.fixture(scope="module")
def shown():
    """The demo after nine seconds: a person is near. Returns the view; sizes are set by tests."""
    config = configuration.load(configuration.shipped("demo.yaml")).quiet()
    config = config.with_predictor("constant_velocity", horizon_s=1.2)
    clock = VirtualClock(10**9)
    cell = registry.load("cells", "mock")(
        links=list(config.links), robots=config.node.robots, base_dir=config.base_dir, clock=clock
    )
    view = TerminalView(Console(file=io.StringIO(), width=80, height=24))
    assembly = assemble.build(
        config, clock, transports=cell.transports(), deadline=False, listeners=[view]
    )
    view.bind(assembly)
    newest = []
    run_virtual(assembly, cell, duration_s=9.0, each_tick=lambda _: newest.append(view._tick))
    cell.stop()
    assert newest[-1] is not None
    view.on_tick(newest[-1])  # not the one that says that the node stops
    return view


def page_of(view, width, height):
    console = Console(file=io.StringIO(), width=width, height=height, record=True)
    view._console = console
    console.print(view.page())
    return console.export_text().rstrip("\n").split("\n")


@pytest.mark.parametrize(("width", "height"), [(80, 24), (100, 30), (160, 60)])
def test_the_page_fits_the_terminal_and_names_level_reason_and_speed(shown, width, height):
    lines = page_of(shown, width, height)
    assert len(lines) < height
    assert max(len(line) for line in lines) <= width
    page = "\n".join(lines)
    for words in ("STOP", "nearest", "m/s allowed", "drive", "monitor"):
        assert words in page
    assert "█" in page
    assert "o" in page.split("zone")[1]


def test_trouble_at_a_live_source_is_told_while_the_node_runs():
    counters = SourceCounters(unknown_joints=12, lost=3)
    counters.note("joint 'Hand_L' is not in the joint map coco17")
    assert trouble(counters) == [
        "12 joints of unknown names",
        "3 lost",
        "joint 'Hand_L' is not in the joint map coco17",
    ]
    assert trouble(SourceCounters()) == []
