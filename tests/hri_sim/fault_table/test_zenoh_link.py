"""A zenoh link with faults, through a real router; how soon it reacts, ``bench`` measures."""

from dataclasses import replace

import pytest

from hri_sim.fault_table.link_cell import run_cases
from hri_sim.fault_table.zenoh_link import CASES, ZenohCell

pytestmark = pytest.mark.realtime


@pytest.mark.long
def test_the_view_is_silent_while_the_router_is_gone_and_comes_back():
    case = next(case for case in CASES if case.name == "router gone")
    outcome = ZenohCell(replace(case, limit_ms=None)).run(case.name)
    assert outcome.fine, outcome
    assert outcome.reason == "silent"
    assert outcome.recovered_ms is not None


def test_no_case_of_that_name_gives_no_row():
    assert list(run_cases("zenoh", ZenohCell, CASES, "nothing has this name")) == []
