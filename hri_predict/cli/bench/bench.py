"""``bench``: measure the node. Compare times only within one run, not between machines."""

import json
import resource
import sys
import timeit
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
from rich.console import Console
from rich.table import Table

from hri_predict import registry
from hri_predict.cli.bench.fleet import fleet
from hri_predict.cli.bench.joint_maps import joint_maps
from hri_predict.cli.bench.links import links
from hri_predict.cli.bench.predictors import predictors
from hri_predict.cli.bench.risk import PEOPLE, SEGMENTS, TITLE, risk_calls
from hri_predict.cli.bench.soak import soak
from hri_predict.cli.bench.trackers import trackers
from hri_predict.clock import VirtualClock
from hri_predict.errors import ConfigError
from hri_predict.node.listeners import Tick
from hri_predict.peers import FaultOutcome
from hri_predict.people.ring_buffer import RingBuffer
from hri_predict.protocol import messages as m
from hri_predict.protocol.can import CanReceiver, CanSender
from hri_predict.protocol.reasons import Reason
from hri_predict.protocol.serial import SerialReceiver, SerialSender
from hri_predict.run import assemble
from hri_predict.run import config as configuration
from hri_predict.run.runtime import run_virtual
from hri_predict.run.session import VIRTUAL_START_NS, Options, View, run
from hri_predict.skeleton import JOINTS

app = typer.Typer(invoke_without_command=True)
app.command()(predictors)
app.command()(links)
app.command()(fleet)
app.command()(joint_maps)
app.command()(trackers)

# Before this, bounded buffers (durations of ticks, round trips, history) are still filling up.
WARM_UP_MINUTES = 6

Json = Annotated[bool, typer.Option("--json", help="Print only JSON.")]


@app.callback()
def bench(context: typer.Context, as_json: Json = False) -> None:
    """Measure the node: time of its parts and links, memory over an hour, reactions to faults.

    Example: hri-predict bench
    """
    if context.invoked_subcommand is not None:
        return
    rows = [*_ring_buffer(), *_codecs(), *_risk(), *_tick_overhead()]
    if as_json:
        print(json.dumps(rows))
        return
    table = Table(title="Cost of the node's parts, microseconds", title_justify="left")
    table.add_column("part")
    for name in ("p50", "p99", "target"):
        table.add_column(name, justify="right")
    for row in rows:
        aim = "" if row["aim_us"] is None else f"< {row['aim_us']:g}"
        table.add_row(row["part"], f"{row['p50_us']:.1f}", f"{row['p99_us']:.1f}", aim)
    Console().print(table)


def _row(part: str, seconds: Any, aim_us: float | None) -> dict[str, Any]:
    micro = np.asarray(seconds) * 1e6
    return {
        "part": part,
        "p50_us": float(np.percentile(micro, 50)),
        "p99_us": float(np.percentile(micro, 99)),
        "aim_us": aim_us,
    }


def _timed(call: Callable[[], object], number: int = 20, repeat: int = 200) -> list[float]:
    return [t / number for t in timeit.repeat(call, number=number, repeat=repeat)]


def _ring_buffer() -> list[dict[str, Any]]:

    buffer = RingBuffer(joints=len(JOINTS), capacity=256, max_gap_ns=100_000_000)
    positions = np.zeros((len(JOINTS), 3))
    observed = np.ones(len(JOINTS), bool)
    stamp = [0]

    def push() -> None:
        stamp[0] += 33_000_000
        buffer.push(stamp[0], positions, observed, stamp[0])

    pushes = _timed(push)
    windows = _timed(lambda: buffer.window(stamp[0], 25, 25.0))
    return [
        _row("ring buffer: push, 21 joints", pushes, 5),
        _row("ring buffer: window of 25 steps", windows, 100),
    ]


def _codecs() -> list[dict[str, Any]]:

    rows = []
    for message in _messages():
        name = type(message).__name__
        for kind in ("classic CAN", "CAN FD", "serial"):
            if kind == "classic CAN" and name in ("Zone", "Pose"):
                continue
            sender: Any
            receiver: Any
            if kind == "serial":
                sender, receiver = SerialSender(), SerialReceiver()
                coded = [sender.encode(message) for _ in range(4000)]
                feed = receiver.feed
            else:
                fd = kind == "CAN FD"
                sender, receiver = CanSender(fd=fd), CanReceiver(fd=fd)
                coded = [sender.encode(message) for _ in range(4000)]

                def feed(frames: Any, receiver: Any = receiver) -> None:
                    for frame in frames:
                        receiver.feed(frame)

            units = iter(coded)
            encode = _timed(lambda s=sender, m=message: s.encode(m))  # type: ignore[misc]
            decode = _timed(lambda f=feed, u=units: f(next(u)))  # type: ignore[misc]
            rows.append(_row(f"encode {name}, {kind}", encode, None))
            rows.append(_row(f"decode {name}, {kind}", decode, None))
    return rows


def _messages() -> list[Any]:

    capsules = tuple(
        m.ZoneCapsule(i, (0.1 * i, 0.5, 1.0), (0.1 * i, 0.6, 1.3), 0.2) for i in range(17)
    )
    return [
        m.Status(
            node_state=m.NodeState.RUNNING,
            reason=Reason.NONE,
            people=1,
            predictor=0,
            cycle=1,
            age_s=0.03,
        ),
        m.Advice(
            robot=0,
            level=m.Level.SLOW,
            reason=Reason.PERSON_NEAR,
            latch_id=0,
            separation_m=1.2,
            predicted_separation_m=0.8,
            time_to_breach_s=0.5,
            speed_limit_m_s=0.4,
            body_part=3,
            robot_link=5,
            echo=17,
            age_s=0.03,
        ),
        m.Schema(1, 0x12345678),
        m.RobotState(
            robot=0,
            mode=m.RobotMode.AUTOMATIC,
            counter=7,
            positions=(0.1,) * 6,
            velocities=(0.2,) * 6,
        ),
        m.Acknowledge(3, 9),
        m.Zone(person=1, step=12, horizon_s=0.48, capsules=capsules, age_s=0.03),
        m.Pose(
            person=1,
            step=12,
            horizon_s=0.48,
            joints=tuple((i, 0.1 * i, 0.5, 1.0) for i in range(21)),
            age_s=0.03,
        ),
    ]


def _risk() -> list[dict[str, Any]]:
    """Time the slowest branch: people are so near that several speeds of each robot are tried."""
    zones, judge = risk_calls()
    return [
        _row(TITLE, _timed(judge, number=5, repeat=100), 3000),
        _row(f"zones of {PEOPLE} people x {SEGMENTS} segments", _timed(zones, 5, 100), None),
    ]


def _tick_overhead() -> list[dict[str, Any]]:
    """Time the demo's ticks on the virtual clock, without the time spent in the predictor."""

    config = configuration.load(configuration.shipped("demo.yaml")).with_predictor("zero_velocity")
    clock = VirtualClock(VIRTUAL_START_NS)
    cell = registry.load("cells", "mock")(
        links=[link for link in config.links if link.simulate],
        robots=config.node.robots,
        base_dir=config.base_dir,
        clock=clock,
    )
    assembly = assemble.build(config, clock, transports=cell.transports(), deadline=False)
    inference: list[float] = []
    predict = assembly.prediction.predictor.predict

    def timed(*arguments: Any) -> Any:
        began = timeit.default_timer()
        forecast = predict(*arguments)
        inference.append(timeit.default_timer() - began)
        return forecast

    assembly.prediction.predictor.predict = timed  # type: ignore[assignment,method-assign]
    pace = run_virtual(assembly, cell, duration_s=20.0)
    cell.stop()
    ticks = np.asarray(pace.tick_ms)[5:] * 1e-3
    mean_inference = float(np.mean(inference)) if inference else 0.0
    return [_row("tick of the demo, without inference", ticks - mean_inference, 2000)]


class _MemoryView(View):
    """Samples the resident memory once a minute of node time."""

    def __init__(self) -> None:
        self.samples: list[float] = []
        self._due_ns = 0

    def on_tick(self, tick: Tick) -> None:
        """Take a sample when a minute has passed."""
        if tick.now_ns >= self._due_ns:
            self._due_ns = tick.now_ns + 60_000_000_000
            pages = int(Path("/proc/self/statm").read_text().split()[1])
            self.samples.append(pages * resource.getpagesize() / 2**20)


@app.command()
def faults(
    only: Annotated[
        str | None, typer.Option(help="Run only faults whose name contains this.")
    ] = None,
    as_json: Json = False,
) -> None:
    """Run each fault of the fault table alone, with a person near; exit status 1 if one fails.

    Example: hri-predict bench faults --only monitor
    """
    rows = []
    for row in registry.load("faults", "table")(only):
        rows.append(row)
        print(f"{'ok  ' if row.fine else 'FAIL'} {row.fault}", file=sys.stderr)
    if not rows:
        raise ConfigError(
            f"--only {only}: no fault's name contains this; run without --only to see all names"
        )
    if as_json:
        print(json.dumps([asdict(row) for row in rows]))
    else:
        Console(width=None if sys.stdout.isatty() else 150).print(_fault_table(rows))
    if not all(row.fine for row in rows):
        raise typer.Exit(1)


def _fault_table(rows: list[FaultOutcome]) -> Table:
    table = Table(title="Each fault alone, with a person near", title_justify="left")
    for name in ("fault", "expected", "acted by"):
        table.add_column(name)
    for name in ("limit ms", "measured ms", "recovered ms"):
        table.add_column(name, justify="right")
    table.add_column("reason")
    table.add_column("")
    for row in rows:
        times = (row.limit_ms, row.measured_ms, row.recovered_ms)
        shown = ["-" if t is None else f"{t:.0f}" for t in times]
        verdict = "ok" if row.fine else "FAIL"
        table.add_row(row.fault, row.expected, row.acts, *shown, row.reason.lower(), verdict)
    return table


@app.command()
def memory(
    hours: Annotated[
        float, typer.Option(help="Hours of node time to run, as fast as possible.")
    ] = 1.0,
    as_json: Json = False,
) -> None:
    """Measure resident memory over a long run of the demo's cell on the virtual clock.

    The predictor is constant_velocity.

    Example: hri-predict bench memory --hours 1
    """
    if not 0.2 <= hours <= 1000:
        raise ConfigError(f"--hours {hours}: give 0.2 to 1000")
    view = _MemoryView()
    config = configuration.load(configuration.shipped("demo.yaml")).quiet()
    config = config.with_predictor("constant_velocity")
    run(config, Options(factor=None, duration_s=hours * 3600.0, view=view))
    warm = max(WARM_UP_MINUTES, len(view.samples) // 10)
    early, late = view.samples[warm], view.samples[-1]
    result = {
        "hours": hours,
        "rss_mib_early": round(early, 2),
        "rss_mib_end": round(late, 2),
        "growth_percent": round(100.0 * (late / early - 1.0), 2),
    }
    if as_json:
        print(json.dumps(result))
        return
    for name, value in result.items():
        print(f"{name.replace('_', ' ')}: {value}")


app.command()(soak)
