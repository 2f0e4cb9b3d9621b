"""Section ``parts``: the ring buffer, the codecs, the risk stage, and a tick without inference."""

import contextlib
import functools
import timeit
from collections.abc import Callable, Iterator
from typing import Any
from unittest import mock

import numpy as np

from hri_predict.base.clock import VirtualClock
from hri_predict.base.skeleton import JOINTS
from hri_predict.contracts import registry
from hri_predict.people.ring_buffer import RingBuffer
from hri_predict.protocol.can import CanReceiver, CanSender
from hri_predict.protocol.serial import SerialReceiver, SerialSender
from hri_predict.run import assemble
from hri_predict.run import config as configuration
from hri_predict.run.runtime import run_virtual
from hri_predict.run.session import VIRTUAL_START_NS
from hri_sim.bench.rows import Row, Scope, measured
from hri_sim.bench.samples import one_of_each
from hri_sim.bench.walkers import TITLE, risk_calls

_STAGES = ("zones", "separation", "levels")
_LONG = ("Zone", "Pose")  # they go over classic CAN by ISO-TP alone


def rows(scope: Scope) -> Iterator[Row]:
    """Microseconds of one call of each part, hot."""
    repeat = max(5, round(20 * scope.seconds))
    yield from _ring_buffer(repeat)
    yield from _codecs(repeat)
    yield from _risk(repeat)
    yield _tick(2.0 * scope.seconds)


def _row(part: str, seconds: Any, **beside: Any) -> Row:
    return measured(part, "µs", np.asarray(seconds) * 1e6, **beside)


def _timed(call: Callable[[], object], repeat: int, number: int = 20) -> list[float]:
    return [t / number for t in timeit.repeat(call, number=number, repeat=repeat)]


def _ring_buffer(repeat: int) -> Iterator[Row]:
    buffer = RingBuffer(joints=len(JOINTS), capacity=256, max_gap_ns=100_000_000)
    positions = np.zeros((len(JOINTS), 3))
    observed = np.ones(len(JOINTS), bool)
    stamp = [0]

    def push() -> None:
        stamp[0] += 33_000_000
        buffer.push(stamp[0], positions, observed, stamp[0])

    pushes = _timed(push, max(repeat, 10))  # a window needs a history
    windows = _timed(lambda: buffer.window(stamp[0], 25, 25.0), repeat)
    yield _row("ring buffer: push, 21 joints", pushes, aim=5.0)
    yield _row("ring buffer: window of 25 steps", windows, aim=100.0)


def _codecs(repeat: int) -> Iterator[Row]:
    for message in one_of_each():
        name = type(message).__name__
        for kind in ("classic CAN", "CAN FD", "serial"):
            if kind == "classic CAN" and name in _LONG:
                continue
            encode, decode = _codec(kind, message, repeat)
            yield _row(f"encode {name}, {kind}", encode)
            yield _row(f"decode {name}, {kind}", decode)


def _codec(kind: str, message: Any, repeat: int) -> tuple[list[float], list[float]]:
    """Seconds of encoding, and of decoding, one message."""
    if kind == "serial":
        sender, receiver = SerialSender(), SerialReceiver()
        coded: Iterator[Any] = iter([sender.encode(message) for _ in range(20 * repeat)])
        decode = _timed(lambda: receiver.feed(next(coded)), repeat)
        return _timed(lambda: sender.encode(message), repeat), decode
    fd = kind == "CAN FD"
    can_sender, can_receiver = CanSender(fd=fd), CanReceiver(fd=fd)
    frames: Iterator[Any] = iter([can_sender.encode(message) for _ in range(20 * repeat)])

    def feed() -> None:
        for frame in next(frames):
            can_receiver.feed(frame)

    decode = _timed(feed, repeat)
    return _timed(lambda: can_sender.encode(message), repeat), decode


def _risk(repeat: int) -> Iterator[Row]:
    """Time the slowest branch, stage by stage: people near enough that several speeds are tried."""
    from hri_predict.risk.engine import RiskEngine

    zones, judge = risk_calls()
    taken: dict[str, list[float]] = {stage: [] for stage in _STAGES}
    with contextlib.ExitStack() as stack:
        for stage in _STAGES:
            watched = _watched(getattr(RiskEngine, stage), taken[stage])
            stack.enter_context(mock.patch.object(RiskEngine, stage, watched))
        for _ in range(repeat + 1):
            zones()
            judge()
    whole = np.sum([taken[stage][1:] for stage in _STAGES], axis=0)  # the first call is cold
    for stage in _STAGES:
        yield _row(f"risk, {stage}", taken[stage][1:])
    why = f"risk: {TITLE.removeprefix('risk: ')}; each stage once a tick"
    yield _row("risk, all stages", whole, aim=1000.0, why=why)


def _watched(stage: Callable[..., Any], seconds: list[float]) -> Callable[..., Any]:
    """The stage, with its seconds noted."""

    @functools.wraps(stage)
    def watched(*arguments: Any, **named: Any) -> Any:
        began = timeit.default_timer()
        try:
            return stage(*arguments, **named)
        finally:
            seconds.append(timeit.default_timer() - began)

    return watched


def _tick(seconds: float) -> Row:
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
    predictor = assembly.prediction.predictor
    predictor.predict = _watched(predictor.predict, inference)  # type: ignore[method-assign]
    pace = run_virtual(assembly, cell, duration_s=max(1.0, seconds))
    cell.stop()
    ticks = np.asarray(pace.tick_ms)[5:] * 1e-3 - (np.mean(inference) if inference else 0.0)
    return _row("tick of the demo, without inference", ticks, aim=2000.0, aim_of="p99")
