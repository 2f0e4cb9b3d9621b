"""The soak: its faults are as drawn, and what it judges by can fail."""

import itertools
import types
from typing import Any

import pytest

from hri_predict.base.errors import ConfigError
from hri_predict.contracts.link import LinkCounters
from hri_sim.baseline_demo import baseline_demo
from hri_sim.fault_table.soak import SoakResult, _Posts, draw_faults, draw_lies, run_soak

FINE = SoakResult(
    hours=1.0, faults=1, ticks=10, clear_ticks=0, contacts=0, posted=5, unaccounted=0,
    rss_mib_early=100.0, rss_mib_end=101.0, growth_percent=1.0, counted={},
)  # fmt: skip


def test_faults_are_drawn_for_source_and_links_alike_and_every_one_is_valid():
    faults = draw_faults(1, 7200.0, ["drive", "monitor"])
    assert faults == draw_faults(1, 7200.0, ["drive", "monitor"])
    assert faults != draw_faults(2, 7200.0, ["drive", "monitor"])
    assert 250 < len(faults) < 470  # one in 20 s on average: 360
    targets = {fault.partition(":")[0] for fault in faults}
    assert {"drive", "monitor"} < targets
    assert {"made_up", "alternate", "rename", "zero"} < {f.partition("@")[0] for f in faults}
    baseline_demo().with_faults(faults)  # refuses what is none


def test_one_controller_lies_at_a_time():
    lies = draw_lies(1, 7200.0, ["drive", "monitor"])
    assert lies == draw_lies(1, 7200.0, ["drive", "monitor"])
    assert all(lies.values())
    times = sorted(
        (lie["start_s"], lie["start_s"] + lie["duration_s"]) for of in lies.values() for lie in of
    )
    assert 80 < len(times) < 150  # a minute after the one before it, on average: 116
    for (_, end_s), (start_s, _) in itertools.pairwise(times):
        assert end_s <= start_s + 0.02  # both are rounded to 0.01


@pytest.mark.long
def test_a_short_soak_holds():
    hours = 0.002
    result: dict[str, Any] = run_soak(hours, seed=3)
    assert result["ticks"] > 80_000 * hours
    assert result["posted"] > 200_000 * hours
    assert (result["clear_ticks"], result["contacts"], result["unaccounted"]) == (0, 0, 0)


@pytest.mark.parametrize(
    "broken",
    [
        {"clear_ticks": 1},
        {"contacts": 1},
        {"unaccounted": 1},
        {"growth_percent": 2.1},
        {"ticks": 0},
    ],
)
def test_each_thing_that_must_hold_can_fail(broken):
    assert FINE.fine
    assert not SoakResult(**(vars(FINE) | broken)).fine


def test_a_message_that_is_neither_sent_nor_counted_is_found():
    link = types.SimpleNamespace(counters=LinkCounters(), post=lambda message: None)
    posts = _Posts(link)
    for _ in range(10):
        link.post(None)
    assert posts.unaccounted == 10
    link.counters = LinkCounters(messages_sent=6, superseded=2, decimated=1, write_errors=1)
    assert posts.unaccounted == 0
    link.counters = LinkCounters(messages_sent=11)
    assert posts.unaccounted == 1  # counted twice


def test_hours_out_of_range_are_refused():
    with pytest.raises(ConfigError, match="--hours"):
        run_soak(0.0)
