"""Section ``age``: from a capture to the last byte of its Advice and Status, by stage."""

import itertools
from collections.abc import Iterator
from typing import Any, get_args

from hri_predict.run.config import NodeSettings
from hri_sim.bench.rows import Row, Scope
from hri_sim.bench.running import WIRES, short_name

_STAGES = {"wait": "wait", "inference": "inference", "node": "node", "link": "link", "total": "age"}
_AIM_MS = 15.0  # p99 of what the node adds, from capture to last byte
_WAIT = "floor of wait: at a fixed rate a capture waits half a period on average, at best"
_AGE = "aim of age: 15 ms, and at a fixed rate a period more"


def rows(scope: Scope) -> Iterator[Row]:
    """Milliseconds by stage: waiting for the tick, in the node, in the predictor, in the link."""
    from hri_sim.bench.links import delay

    modes = get_args(NodeSettings.model_fields["ticks"].annotation)
    predictors = (scope.baseline, scope.network)
    for wire, rate_hz, predictor, ticks in itertools.product(
        WIRES[: scope.wires], scope.age_rates_hz, predictors, modes
    ):
        name = f"{short_name(wire)}, {rate_hz:g} Hz, {predictor}"
        if ticks != "fixed":
            name += f", ticks: {ticks}"
        found = delay(wire, rate_hz, scope.seconds, ticks=ticks, predictor=predictor)
        if "not_here" in found:
            yield Row(part=name, unit="ms", note=str(found["not_here"]))
            continue
        period_ms = 1e3 / rate_hz if ticks == "fixed" else 0.0
        for stage, told in _STAGES.items():
            yield _row(f"{name}: {told}", stage, found, period_ms)


def _row(part: str, stage: str, found: dict[str, Any], period_ms: float) -> Row:
    spread = found.get(f"{stage}_ms")
    if spread is None:
        return Row(part=part, unit="ms", note="no scene was measured")
    beside: dict[str, Any] = {}
    if stage == "wait" and period_ms:
        beside = {"floor": 0.5 * period_ms, "why": _WAIT}
    if stage == "total":
        beside = {"aim": _AIM_MS + period_ms, "aim_of": "p99", "why": _AGE}
        beside["more"] = {"scenes": found["scenes"], "missed": found["missed"]}
        if found["missed"]:
            beside["note"] = f"{found['missed']} Statuses were replaced by newer ones"
    return Row(part=part, unit="ms", **spread, **beside)
