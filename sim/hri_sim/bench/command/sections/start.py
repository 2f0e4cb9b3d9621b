"""Section ``start``: from starting the process to the first advice, and the memory it holds."""

import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

from hri_predict.base.errors import LinkError
from hri_sim.bench.command.report.rows import Row, Scope
from hri_sim.bench.command.sections import runs

_START_S = 5.0
_RESIDENT_MIB = {"baseline": 300.0, "network": 700.0}
_COLD = "empty cache: exported networks and compiled loops are built again"


def rows(scope: Scope) -> Iterator[Row]:
    """Seconds until a receiver has the first Advice of a running node; MiB of its processes."""
    wire = runs.wires()[0]
    for kind, predictor, library in (
        ("baseline", scope.baseline, "numpy"),
        ("network", scope.network, "torch"),
    ):
        run = runs.heard(wire, predictor, runs.seconds_of(scope.seconds))
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
            yield _cold(wire, predictor)
        yield Row(
            part=f"{predictor}: resident",
            unit="MiB",
            p50=run["resident_mib"],
            aim=_RESIDENT_MIB[kind],
        )


def _cold(wire: str, predictor: str) -> Row:
    part = f"{predictor}: first advice, empty cache"
    from hri_sim.bench import node as bench

    with tempfile.TemporaryDirectory() as folder:
        try:
            run = bench.heard(
                wire=wire, predictor=predictor, rate_hz=runs.RATE_HZ, seconds=0, cache=Path(folder)
            )
        except LinkError as error:
            return Row(part=part, unit="s", note=str(error))
    return Row(part=part, unit="s", p50=run["first_advice_s"], why=_COLD)


def _import_s(library: str) -> float:
    began = time.perf_counter()
    subprocess.run([sys.executable, "-c", f"import {library}"], check=True)
    return time.perf_counter() - began
