"""Section ``jitter``: how evenly messages come, compared with a bare loop of the same rate."""

from collections.abc import Iterator
from typing import Any

import numpy as np

from hri_sim.bench.command.report.rows import Row, Scope, measured
from hri_sim.bench.command.sections import runs

_AIM_MS = 1.0  # p99 at the receiver, 25 messages a second, with inference busy
_LOOK_WHY = (
    "looked at: with the 3D view and the operator's page, a reader of both, and three alert "
    "hooks that fail slowly; over alone: the node's figure divided by that without them"
)
_WHY = (
    "bare loop: another process that only sleeps to deadlines of the same rate, in the same run; "
    "over bare: the node's figure divided by the loop's"
)


def rows(scope: Scope) -> Iterator[Row]:
    """Deviations of intervals from the period: inference idle, busy, and busy and looked at."""
    for wire in _wires(scope):
        short, seconds, told = runs.short(wire), runs.seconds_of(scope.seconds), dict[str, Row]()
        for state, predictor in (
            ("inference idle", scope.baseline),
            ("inference busy", scope.network),
            ("looked at", scope.network),
        ):
            part = f"{short}, {state}"
            run = runs.heard(wire, predictor, seconds, watched=state == "looked at")
            if isinstance(run, str):
                yield Row(part=part, unit="ms", note=run)
                continue
            told[state], bare = _measured(part, predictor, run)
            yield from (told[state], bare)
            yield _ratio(f"{part}: over bare", told[state], bare, _WHY)
        if "looked at" in told and "inference busy" in told:
            alone = told["inference busy"]
            yield _ratio(f"{short}, looked at: over alone", told["looked at"], alone, _LOOK_WHY)


def _measured(part: str, predictor: str, run: dict[str, Any]) -> tuple[Row, Row]:
    """The node's row and the bare loop's."""
    told = ("missing", "stamps", "priority", "seen_bytes", "alerts")
    node = measured(
        part,
        "ms",
        run["deviation_ms"],
        aim=_AIM_MS,
        aim_of="p99",
        note=_lost(run["missing"]),
        more={key: run[key] for key in told if key in run} | {"predictor": predictor},
    )
    return node, measured(f"{part}: bare loop", "ms", run["bare_ms"])


def _lost(missing: int) -> str:
    return f"{missing} {'message' if missing == 1 else 'messages'} never came" if missing else ""


def _wires(scope: Scope) -> tuple[str, ...]:
    """Serial, and a CAN bus: over a serial adapter where this machine has no multicast."""
    serial, can, adapter = runs.wires()
    if scope.wires == 1:
        return (serial,)
    first = runs.heard(can, scope.baseline, runs.seconds_of(scope.seconds))
    return (serial, adapter if isinstance(first, str) else can)


def _ratio(part: str, node: Row, bare: Row, why: str) -> Row:
    figures: dict[str, Any] = {
        key: float(np.divide(over, under))
        for key in ("p50", "p99", "max")
        if (over := getattr(node, key)) is not None and (under := getattr(bare, key))
    }
    return Row(part=part, unit="x", why=why, **figures)
