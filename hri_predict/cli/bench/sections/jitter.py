"""Section ``jitter``: how even published messages come, beside a bare loop of the same rate."""

from collections.abc import Iterator
from typing import Any

import numpy as np

from hri_predict.cli.bench.report.rows import Row, Scope, measured
from hri_predict.cli.bench.sections import runs

_AIM_MS = 1.0  # p99 at the receiver, 25 messages a second, with inference busy
_WHY = (
    "bare loop: another process that only sleeps to deadlines of the same rate, in the same run; "
    "over bare: the node's figure divided by the loop's"
)


def rows(scope: Scope) -> Iterator[Row]:
    """Deviations of intervals from the period, with inference idle and busy, and their ratio."""
    for wire in _wires(scope):
        for predictor, busy in ((scope.baseline, "idle"), (scope.network, "busy")):
            part = f"{runs.short(wire)}, inference {busy}"
            run = runs.heard(wire, predictor, runs.seconds_of(scope.seconds))
            if isinstance(run, str):
                yield Row(part=part, unit="ms", note=run)
                continue
            node = measured(
                part,
                "ms",
                run["deviation_ms"],
                aim=_AIM_MS,
                aim_of="p99",
                note=f"{run['missing']} messages never came" if run["missing"] else "",
                more={key: run[key] for key in ("missing", "stamps", "priority")}
                | {"predictor": predictor},
            )
            bare = measured(f"{part}: bare loop", "ms", run["bare_ms"])
            yield node
            yield bare
            yield _ratio(f"{part}: over bare", node, bare)


def _wires(scope: Scope) -> tuple[str, ...]:
    """Serial, and a CAN bus: over a serial adapter where this machine has no multicast."""
    serial, can, adapter = runs.wires()
    if scope.wires == 1:
        return (serial,)
    first = runs.heard(can, scope.baseline, runs.seconds_of(scope.seconds))
    return (serial, adapter if isinstance(first, str) else can)


def _ratio(part: str, node: Row, bare: Row) -> Row:
    figures: dict[str, Any] = {
        key: float(np.divide(over, under))
        for key in ("p50", "p99", "max")
        if (over := getattr(node, key)) is not None and (under := getattr(bare, key))
    }
    return Row(part=part, unit="x", why=_WHY, **figures)
