"""Sections ``jitter``, ``load`` and ``start``: a running node, as another process observes it.

All three use the same runs; a bench makes each run once.
"""

import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from hri_predict.base.errors import LinkError
from hri_sim.bench.rows import Row, Scope, measured

RATE_HZ = 25.0
WIRES = ("serial pty 921600", "CAN FD udp_multicast", "CAN FD slcan pty")
_JITTER_MS = 1.0  # aim: p99 at the receiver, 25 messages a second, with inference busy
_START_S = 5.0
_RESIDENT_MIB = {"baseline": 300.0, "network": 700.0}
_BARE = (
    "bare loop: another process that only sleeps until deadlines at the same rate, in the same "
    "run; over bare: the node's figure divided by the loop's"
)
_LOOKED_AT = (
    "looked at: with the 3D view and the operator's page, a reader of both, and three alert "
    "hooks that fail slowly; over alone: the node's figure divided by the figure without them"
)
_LOAD = (
    "%: of one core; the figures of the cores include the receiver, the bare loop and "
    "everything else that ran"
)
_COLD = "empty cache: exported networks and compiled loops are rebuilt"


@lru_cache(maxsize=32)
def heard(
    wire: str,
    predictor: str,
    seconds: float,
    *,
    watched: bool = False,
    cache: Path | None = None,
) -> dict[str, Any] | str:
    """Run ``heard.heard``; return one line of text if this machine has no such wire."""
    from hri_sim.bench import heard as other

    try:
        return other.heard(
            wire=wire,
            predictor=predictor,
            rate_hz=RATE_HZ,
            seconds=seconds,
            cache=cache,
            watched=watched,
        )
    except LinkError as error:
        return str(error)


def jitter(scope: Scope) -> Iterator[Row]:
    """Yield deviations of intervals from the period: inference idle, busy, busy while observed."""
    for wire in _wires(scope):
        short, told = short_name(wire), dict[str, Row]()
        for state, predictor in (
            ("inference idle", scope.baseline),
            ("inference busy", scope.network),
            ("looked at", scope.network),
        ):
            part = f"{short}, {state}"
            run = heard(wire, predictor, _heard_s(scope), watched=state == "looked at")
            if isinstance(run, str):
                yield Row(part=part, unit="ms", note=run)
                continue
            told[state] = _deviations(part, predictor, run)
            bare = measured(f"{part}: bare loop", "ms", run["bare_ms"])
            yield from (told[state], bare)
            yield _ratio(f"{part}: over bare", told[state], bare, _BARE)
        if "looked at" in told and "inference busy" in told:
            alone = told["inference busy"]
            yield _ratio(f"{short}, looked at: over alone", told["looked at"], alone, _LOOKED_AT)


def load(scope: Scope) -> Iterator[Row]:
    """Yield processor time over wall time, with a baseline and with a network."""
    for predictor in (scope.baseline, scope.network):
        run = heard(WIRES[0], predictor, _heard_s(scope))
        if isinstance(run, str):
            yield Row(part=predictor, unit="%", note=run)
            continue
        for group, percent in run["cpu_percent"].items():
            name = "whole node" if group == "all" else group
            yield Row(part=f"{predictor}: {name}", unit="%", p50=percent, why=_LOAD)
        for core, percent in enumerate(run["cores_percent"]):
            yield Row(part=f"{predictor}: core {core}, whole machine", unit="%", p50=percent)


def start(scope: Scope) -> Iterator[Row]:
    """Yield the time until a receiver has the first Advice, in s, and the node's memory, in MiB."""
    for kind, predictor, library in (
        ("baseline", scope.baseline, "numpy"),
        ("network", scope.network, "torch"),
    ):
        run = heard(WIRES[0], predictor, _heard_s(scope))
        if isinstance(run, str):
            yield Row(part=predictor, unit="s", note=run)
            continue
        floor = _import_s(library)
        yield Row(
            part=f"{predictor}: first advice",
            unit="s",
            p50=run["first_advice_s"],
            floor=floor,
            aim=_START_S,
            why=f"floor of {predictor}: {floor:.2g} s, for Python and its import of {library}",
        )
        if scope.cold:
            yield _cold(predictor)
        yield Row(
            part=f"{predictor}: resident",
            unit="MiB",
            p50=run["resident_mib"],
            aim=_RESIDENT_MIB[kind],
        )


def short_name(wire: str) -> str:
    """A wire's name in a row."""
    return wire.replace(" pty", "").replace("_multicast", "")


def _heard_s(scope: Scope) -> float:
    """Return the measurement time of a run, in seconds; timing intervals takes longer than timing
    single calls.
    """
    return 2.0 * scope.seconds


def _wires(scope: Scope) -> tuple[str, ...]:
    """Return serial and a CAN bus, over a serial adapter where this machine has no multicast."""
    serial, can, adapter = WIRES
    if scope.wires == 1:
        return (serial,)
    first = heard(can, scope.baseline, _heard_s(scope))
    return (serial, adapter if isinstance(first, str) else can)


def _deviations(part: str, predictor: str, run: dict[str, Any]) -> Row:
    told = ("missing", "stamps", "priority", "seen_bytes", "alerts")
    missing = run["missing"]
    lost = f"{missing} {'message' if missing == 1 else 'messages'} never came" if missing else ""
    return measured(
        part,
        "ms",
        run["deviation_ms"],
        aim=_JITTER_MS,
        aim_of="p99",
        note=lost,
        more={key: run[key] for key in told if key in run} | {"predictor": predictor},
    )


def _ratio(part: str, node: Row, bare: Row, why: str) -> Row:
    figures: dict[str, Any] = {
        key: float(np.divide(over, under))
        for key in ("p50", "p99", "max")
        if (over := getattr(node, key)) is not None and (under := getattr(bare, key))
    }
    return Row(part=part, unit="x", why=why, **figures)


def _cold(predictor: str) -> Row:
    part = f"{predictor}: first advice, empty cache"
    with tempfile.TemporaryDirectory() as folder:
        run = heard(WIRES[0], predictor, 0.0, cache=Path(folder))
    if isinstance(run, str):
        return Row(part=part, unit="s", note=run)
    return Row(part=part, unit="s", p50=run["first_advice_s"], why=_COLD)


def _import_s(library: str) -> float:
    began = time.perf_counter()
    subprocess.run([sys.executable, "-c", f"import {library}"], check=True)
    return time.perf_counter() - began
