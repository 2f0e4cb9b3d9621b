"""``bench faults``, ``soak`` and ``memory``: effects of faults, and runs of many hours."""

import sys
import threading
from collections.abc import Callable, Mapping
from dataclasses import asdict
from typing import Annotated, Any

import typer

from hri_predict.base.errors import ConfigError
from hri_predict.cli.common import JsonOption, warn
from hri_predict.node.listeners import Tick
from hri_predict.run import config as configuration
from hri_predict.run.runtime import stop_on_signals
from hri_predict.run.session import Options, View, run
from hri_sim.bench.table import Columns, demand, facts, report
from hri_sim.fault_table.soak import Resident


def _ms(key: str) -> Callable[[Mapping[str, Any]], str]:
    return lambda row: "-" if row[key] is None else f"{row[key]:.0f}"


_COLUMNS: Columns = {
    "fault": "{fault}",
    "expected": "{expected}",
    "acted by": "{acts}",
    "limit ms": _ms("limit_ms"),
    "measured ms": _ms("measured_ms"),
    "recovered ms": _ms("recovered_ms"),
    "reason": lambda row: row["reason"].lower(),
    "": lambda row: "ok" if row["fine"] else "FAIL",
}
_TEXTS = ("expected", "acted by", "reason", "")


def faults(
    only: Annotated[
        str | None, typer.Option(help="Run only faults whose name contains this.")
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Run each fault of the fault table alone, with a person near; exit status 1 if one fails.

    Example: hri-predict bench faults --only monitor
    """
    from hri_sim.fault_table.outcome import FaultOutcome
    from hri_sim.fault_table.table import run_table

    rows: list[FaultOutcome] = []
    with stop_on_signals(stop := threading.Event()):
        for row in run_table(only):
            if stop.is_set():
                warn(f"stopped by a signal in {row.fault}; faults measured before: {len(rows)}")
                raise KeyboardInterrupt
            rows.append(row)
            print(f"{'ok  ' if row.fine else 'FAIL'} {row.fault}", file=sys.stderr)
    if not rows:
        raise ConfigError(
            f"--only {only}: no fault name contains this; run without --only to see all names"
        )
    title = "Each fault alone, with a person near"
    report([asdict(row) for row in rows], as_json, title, _COLUMNS, texts=_TEXTS)
    if not all(row.fine for row in rows):
        raise typer.Exit(1)


def soak(
    hours: Annotated[float, typer.Option(help="Hours of node time.")] = 1.0,
    seed: Annotated[int, typer.Option(min=0, help="Random seed of the faults.")] = 0,
    speed: Annotated[
        float | None,
        typer.Option(
            min=0.1,
            max=20,
            help="Seconds of node time per second, with real threads and clock; default: as "
            "fast as possible on the virtual clock.",
        ),
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Run the demo's cell with random faults and a person always near; exit status 1 if one fails.

    Example: hri-predict bench soak --hours 0.1
    """
    from hri_sim.fault_table.soak import run_soak

    result = run_soak(hours, seed, speed)
    facts(result, as_json)
    if not result["fine"]:
        raise typer.Exit(1)


# -- bench memory: resident memory over hours of node time -----------------------------------------

# Before this, bounded buffers (durations of ticks, round trips, history) are still filling up.
WARM_UP_S = 360.0


class _MemoryView(View):
    """Samples the resident memory once a minute of node time."""

    def __init__(self, warm_up_s: float) -> None:
        self.memory = Resident(60.0, warm_up_s)

    def on_tick(self, tick: Tick) -> None:
        """Take a sample when a minute has passed."""
        self.memory.look(tick.now_ns)


def memory(
    hours: Annotated[
        float, typer.Option(help="Hours of node time to run, as fast as possible.")
    ] = 1.0,
    as_json: JsonOption = False,
) -> None:
    """Measure resident memory over a long run of the demo's cell on the virtual clock.

    The predictor is constant_velocity.

    Example: hri-predict bench memory --hours 1
    """
    demand("--hours", hours, 0.2, 1000.0)
    view = _MemoryView(max(WARM_UP_S, 360.0 * hours))
    config = configuration.load(configuration.shipped("demo.yaml")).quiet()
    config = config.with_predictor("constant_velocity")
    run(config, Options(factor=None, duration_s=hours * 3600.0, view=view))
    facts({"hours": hours} | view.memory.growth(), as_json)
