"""A zenoh link with faults, through a real router; how soon it reacts, ``bench`` measures."""

from dataclasses import replace

import pytest

from hri_sim.fault_table.zenoh_link import CASES, run_zenoh_case, run_zenoh_faults

pytestmark = pytest.mark.realtime


@pytest.mark.long
def test_the_view_is_silent_while_the_router_is_gone_and_comes_back():
    case = next(case for case in CASES if case.name == "router gone")
    outcome = run_zenoh_case(case.name, replace(case, limit_ms=None))
    assert outcome.fine, outcome
    assert outcome.reason == "silent"
    assert outcome.recovered_ms is not None


def test_no_case_of_that_name_gives_no_row():
    assert list(run_zenoh_faults("nothing has this name")) == []
