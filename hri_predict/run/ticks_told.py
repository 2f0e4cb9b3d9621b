"""Notes on a configuration's ticks: rates, and waiting times of captures."""

from typing import Any

from hri_predict.run.config import NodeSettings

RACE = 0.9
"""Ratio to the source's period from which a period, if not much longer, races with captures."""


def ticks_facts(node: NodeSettings, source_rate_hz: float) -> dict[str, Any]:
    """Return the tick rates, and the time that a capture waits for a tick.

    If several captures arrive between two ticks, only the newest is counted. The source's delay and
    the tick's duration are not included.
    """
    apart_s, gap_s = 1.0 / source_rate_hz, 1.0 / node.largest_rate_hz
    if node.ticks == "fixed":
        most_s = min(gap_s, apart_s)
        mean_s = most_s / 2
    else:
        most_s, mean_s = gap_s, apart_s / 2 if apart_s < gap_s else 0.0
    return {
        "ticks": node.ticks,
        "rate_hz": node.rate_hz,
        "largest_rate_hz": node.largest_rate_hz,
        "source_rate_hz": source_rate_hz,
        "wait_s": {"mean": mean_s, "most": most_s},
    }


def ticks_line(facts: dict[str, Any]) -> str:
    """Format the result of ``ticks_facts`` as one line."""
    rates = f"{facts['rate_hz']:g} per second"
    if facts["ticks"] == "capture":
        rates = f"{facts['rate_hz']:g} to {facts['largest_rate_hz']:g} per second"
    wait = facts["wait_s"]
    return (
        f"ticks: {facts['ticks']}, {rates}; a capture of the source's "
        f"{facts['source_rate_hz']:.4g} per second waits {wait['mean'] * 1e3:.0f} ms on average "
        f"and {wait['most'] * 1e3:.0f} ms at most"
    )


def race_notes(node: NodeSettings, source_rate_hz: float) -> list[str]:
    """Return a note if ticks without a capture occur just before captures."""
    if node.ticks == "fixed" or node.rate_hz <= RACE * source_rate_hz:
        return []
    if node.rate_hz > source_rate_hz / RACE:
        return [
            f"rate_hz {node.rate_hz:g} is above the source's {source_rate_hz:.4g}: many ticks "
            f"have no new capture, and only shorten the cycle in T_r; unless you want that, "
            f"{RACE * source_rate_hz:.3g} is enough with ticks: capture"
        ]
    return [
        f"rate_hz {node.rate_hz:g} is about the source's {source_rate_hz:.4g}: a slightly late "
        "capture just misses a tick, and waits for 1 / max_rate_hz; rate_hz up to "
        f"{RACE * source_rate_hz:.3g} avoids it"
    ]
