"""Report on a run's source: its clock and, for a live source, messages received and lost."""

import time
from collections.abc import Mapping
from dataclasses import asdict
from typing import Any

from rich.table import Table

from hri_predict.contracts.source import Source, live_part
from hri_predict.people.clock.clock_alignment import ClockEstimate
from hri_predict.people.clock.offset_line import LOCK_NS
from hri_predict.people.merging.source import MergedSource

UTC_WITHIN_S = 86_400.0
"""A clock with a larger offset was never set; then only its offset is meaningful."""
LATE_S = LOCK_NS * 1e-9
_COUNTS = ("packets", "bytes_received", "scenes")  # all other counters count trouble


def source_report(
    kind: str, source: Source, clock: ClockEstimate | None, now_ns: int
) -> dict[str, Any]:
    """Return plain data for ``--json``; its keys are a contract.

    Args:
        kind: the source's kind.
        source: the source at the end of the run.
        clock: the estimate of its clock by ``people``.
        now_ns: the node's clock now.

    Returns:
        ``kind``; ``clock`` (``None`` if no scene arrived): ``offset_s``, ``drift_ppm``, ``jumps``,
        ``spikes``, ``rise_s``, ``wandered_s``, ``late_s`` as in ``ClockEstimate``, and
        ``ahead_of_utc_s``, the sender's lead over this machine's clock, less the minimum latency
        (``None`` if it is not UTC); ``live`` (``None`` if the source is not live): all of
        ``SourceCounters``.
    """
    live = live_part(source)
    return {
        "kind": kind,
        "clock": None
        if clock is None
        else {
            "offset_s": clock.offset_ns * 1e-9,
            "ahead_of_utc_s": _ahead_of_utc_s(clock, now_ns)
            if live is not None and live.stamps_utc
            else None,
            "drift_ppm": clock.drift_ppm,
            "jumps": clock.jumps,
            "spikes": clock.spikes,
            "rise_s": clock.rise_ns * 1e-9,
            "wandered_s": clock.wandered_ns * 1e-9,
            "late_s": clock.late_ns * 1e-9,
        },
        "live": None if live is None else asdict(live.counters),
    }


def source_counts(source: object) -> dict[str, int]:
    """Return the counters of a source of several sensors; empty for any other."""
    return source.counts() if isinstance(source, MergedSource) else {}


def source_table(report: Mapping[str, Any]) -> Table:
    """Return the report of a live source as a table; error counters at 0 are left out."""
    table = Table(title=f"Source: {report['kind']}", title_justify="left", show_header=False)
    clock, live = report["clock"], report["live"]
    if clock is not None:
        table.add_row("clock", _clock(clock))
    for name in _COUNTS:
        table.add_row(name.replace("_", " "), str(live[name]))
    trouble = {
        name.replace("_", " "): count
        for name, count in live.items()
        if name not in (*_COUNTS, "last_error") and count
    }
    table.add_row("trouble", ", ".join(f"{n} {c}" for n, c in trouble.items()) or "-")
    if live["last_error"]:
        table.add_row("last error", live["last_error"])
    return table


def _clock(clock: Mapping[str, Any]) -> str:
    if clock["ahead_of_utc_s"] is not None:
        ahead_ms = clock["ahead_of_utc_s"] * 1e3
        offset = f"ahead of this machine's UTC by {ahead_ms:.1f} ms (if min_latency_s is right)"
    else:
        offset = f"not UTC; behind the node's clock by {clock['offset_s']:.3f} s"
    drift = clock["drift_ppm"]
    fast = "drift not yet known" if drift is None else f"fast by {drift:.1f} ppm"
    believed = (
        f"{clock['rise_s'] * 1e3:.1f} ms attributed to drift, {clock['wandered_s'] * 1e3:.1f} ms "
        "to "
        f"wander"
    )
    late = f", scenes late by {clock['late_s'] * 1e3:.0f} ms" if clock["late_s"] > LATE_S else ""
    return f"{offset}, {fast}; {believed}{late}; jumps {clock['jumps']}, spikes {clock['spikes']}"


def _ahead_of_utc_s(clock: ClockEstimate, now_ns: int) -> float | None:
    ahead_s = (now_ns - clock.offset_ns - time.time_ns()) * 1e-9
    return ahead_s if abs(ahead_s) < UTC_WITHIN_S else None
