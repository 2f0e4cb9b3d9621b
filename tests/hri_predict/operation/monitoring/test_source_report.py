import io
import json
import time
from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

import pytest
from rich.console import Console

from hri_predict.contracts.source import Source, SourceCounters
from hri_predict.operation.monitoring.source_report import source_report, source_table
from hri_predict.people.clock.clock_alignment import ClockEstimate

CLOCK = ClockEstimate(
    offset_ns=-5_000_000_000,
    drift_ppm=12.34,
    jumps=1,
    spikes=2,
    rise_ns=40_000_000,
    wandered_ns=3_000_000,
)


def live_source(stamps_utc: bool = True, **counters: Any) -> Any:
    live = SimpleNamespace(counters=SourceCounters(**counters), stamps_utc=stamps_utc)
    return SimpleNamespace(live=live)


def shown(report: dict[str, Any]) -> str:
    text = io.StringIO()
    Console(width=200, file=text).print(source_table(report))
    return text.getvalue()


def test_a_live_source_tells_its_clock_and_every_counter():
    source = live_source(packets=9, scenes=7, lost=2, last_error="no more")
    report = json.loads(json.dumps(source_report("udp", source, CLOCK, 0)))
    assert report["kind"] == "udp"
    assert report["clock"]["offset_s"] == -5
    assert (report["clock"]["jumps"], report["clock"]["spikes"]) == (1, 2)
    live = report["live"]
    assert (live["packets"], live["lost"], live["replayed"]) == (9, 2, 0)
    text = shown(report)
    assert "lost 2" in text
    assert "no more" in text
    assert "replayed" not in text
    assert "fast by 12.3 ppm; 40.0 ms attributed to drift, 3.0 ms to wander" in text
    assert "late" not in text
    assert "jumps 1, spikes 2" in text


def test_scenes_that_are_all_late_are_told():
    clock = replace(CLOCK, late_ns=250_000_000)
    report = source_report("udp", live_source(), clock, 0)
    assert report["clock"]["late_s"] == 0.25
    assert "scenes late by 250 ms" in shown(report)


def test_a_clock_of_utc_is_compared_with_ours():
    """The sender is 2 s ahead: a stamp is UTC + 2 s, a capture on our clock is its now."""
    now_ns = 77_000_000_000
    offset_ns = now_ns - (time.time_ns() + 2_000_000_000)
    clock = ClockEstimate(offset_ns, None, 0, 0)
    report = source_report("udp", live_source(), clock, now_ns)
    assert report["clock"]["ahead_of_utc_s"] == pytest.approx(2.0, abs=1.0)
    assert "ahead of this machine's UTC by" in shown(report)
    assert "drift not yet known" in shown(report)


@pytest.mark.parametrize("stamps_utc", [False, True])
def test_a_clock_of_its_own_is_not(stamps_utc):
    """Nor is one that should be UTC and was never set."""
    report = source_report("mvn", live_source(stamps_utc), CLOCK, 0)
    assert report["clock"]["ahead_of_utc_s"] is None
    assert "behind the node's clock by -5.000 s" in shown(report)


def test_others_have_no_live_part_and_perhaps_no_clock():
    report = source_report("recording", cast(Source, SimpleNamespace()), None, 0)
    assert report == {"kind": "recording", "clock": None, "live": None}
