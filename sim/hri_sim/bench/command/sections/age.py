"""Section ``age``: from a capture to the last byte of its Advice and Status, by stage."""

from collections.abc import Iterator
from typing import Any

from hri_sim.bench.command.report.rows import Row, Scope
from hri_sim.bench.command.sections import runs

_FIXED = "fixed"
_STAGES = {"wait": "wait", "inference": "inference", "node": "node", "link": "link", "total": "age"}
_AIM_MS = 15.0  # p99 of what the node adds, from capture to last byte
_WAIT = "floor of wait: at a fixed rate a capture waits half a period on average, at best"
_AGE = "aim of age: 15 ms, and at a fixed rate a period more"


def rows(scope: Scope) -> Iterator[Row]:
    """Milliseconds by stage: waiting for the tick, in the node, in the predictor, in the link."""
    from hri_sim.bench import node as bench

    for case in bench.ages(
        wires=tuple(bench.AGE_WIRES)[: scope.wires],
        rates_hz=scope.age_rates_hz,
        predictors=(scope.baseline, scope.network),
        seconds=scope.seconds,
    ):
        name = f"{runs.short(case['link'])}, {case['rate_hz']:g} Hz, {case['predictor']}"
        if case["ticks"] != _FIXED:
            name += f", ticks: {case['ticks']}"
        if "not_here" in case:
            yield Row(part=name, unit="ms", note=str(case["not_here"]))
            continue
        for stage, told in _STAGES.items():
            yield _row(f"{name}: {told}", stage, case)


def _row(part: str, stage: str, case: dict[str, Any]) -> Row:
    spread = case.get(f"{stage}_ms")
    if spread is None:
        return Row(part=part, unit="ms", note="no scene was measured")
    period_ms = 1e3 / case["rate_hz"] if case["ticks"] == _FIXED else 0.0
    beside: dict[str, Any] = {}
    if stage == "wait" and period_ms:
        beside = {"floor": 0.5 * period_ms, "why": _WAIT}
    if stage == "total":
        beside = {"aim": _AIM_MS + period_ms, "aim_of": "p99", "why": _AGE}
        beside["more"] = {"scenes": case["scenes"], "missed": case["missed"]}
        if case["missed"]:
            beside["note"] = f"{case['missed']} Statuses were replaced by newer ones"
    return Row(part=part, unit="ms", **spread, **beside)
