"""Section ``parts``: the ring buffer, the codecs, the risk stage, and a tick without inference."""

import contextlib
import functools
import itertools
import timeit
from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any
from unittest import mock

import numpy as np

from hri_predict.base.clock import VirtualClock
from hri_predict.base.settings import Pose
from hri_predict.base.skeleton import CANONICAL, JOINTS
from hri_predict.contracts import registry
from hri_predict.contracts.link import LinkSettings
from hri_predict.contracts.predictor import Forecast
from hri_predict.people.body.standing import standing_body
from hri_predict.people.ring_buffer import RingBuffer
from hri_predict.people.snapshot import PeopleSnapshot
from hri_predict.protocol.can import CanReceiver, CanSender
from hri_predict.protocol.messages import RobotMode, RobotState
from hri_predict.protocol.serial import SerialReceiver, SerialSender
from hri_predict.risk.delay_budget import DelayBudget
from hri_predict.risk.engine import RiskEngine
from hri_predict.risk.settings import RiskSettings
from hri_predict.risk.types import Assessment
from hri_predict.robots.model import RobotSettings, StateMotion, load_robot
from hri_predict.robots.tracker import RobotTracker
from hri_predict.robots.trajectory import load_trajectory
from hri_predict.run import assemble
from hri_predict.run import config as configuration
from hri_predict.run.runtime import run_virtual
from hri_predict.run.session import VIRTUAL_START_NS
from hri_predict.zones.calibration import load_calibration, shipped_calibration
from hri_sim.bench.rows import Row, Scope, measured
from hri_sim.wires.samples import one_of_each

_STAGES = ("zones", "separation", "levels")
_LONG = ("Zone", "Pose")  # they go over classic CAN by ISO-TP alone


def rows(scope: Scope) -> Iterator[Row]:
    """Yield the duration of one call of each part in a hot loop, in us."""
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
    """Return the times to encode and to decode one message, in seconds."""
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
    """Time the slowest branch, stage by stage: people so close that several speeds are tried."""
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
    """Return the stage, wrapped to record its duration."""

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


# -- the slowest case of the risk judgement: several people near moving robots, all horizons -------

RATE_HZ, STEPS, SEGMENTS, PEOPLE = 25.0, 25, 20, 4
TITLE = f"risk: {PEOPLE} people x {SEGMENTS} segments x {STEPS} horizons x 2 robots x 8 capsules"
NOW_NS = 10**10
TICK_NS = 40_000_000
AGE_NS = 10_000_000
_STATES = 40
_PHASES_S = (1.6, 4.8)  # phases of the two arms on their trajectories
_PEOPLE_AT = ((1.45, 3.9), (2.05, -3.9), (-1.65, -3.7), (3.9, 3.7))
_WALK_TICKS = 50  # people come into view and walk up; then the next people come


def risk_calls() -> tuple[Callable[[], object], Callable[[], object]]:
    """Return two calls to time: the zones of people who walk up to two arms, and their judgement.

    The first call computes the zones of the next tick, with the shipped calibration and the
    self-check. The second judges the last tick. The plan of only one arm is known. The
    delays are so long that all horizons are used.
    """
    link = LinkSettings(name="bus", kind="can", silence_timeout_s=0.15, reaction_s=0.41)
    engine = RiskEngine(
        settings=RiskSettings(mode="predictive"),
        robots=[_arm("planned", (0.0, 0.0), 0), _arm("unplanned", (2.2, 0.0), 1)],
        # three segments twice, as some skeletons have more
        skeleton=replace(CANONICAL, segments=(*CANONICAL.segments, *CANONICAL.segments)[:SEGMENTS]),
        absent_parts=[],
        named_zones=[],
        field_of_view=None,
        budget=DelayBudget.from_settings(RATE_HZ, [link], stale_s=AGE_NS * 1e-9),
        forecast_rate_hz=RATE_HZ,
        horizon_steps=STEPS,
        calibration=load_calibration(shipped_calibration("constant_velocity")),
    )
    ticks = [_walkers(tick) for tick in range(_WALK_TICKS)]
    walks = itertools.count()

    def walk() -> Iterator[tuple[PeopleSnapshot, Forecast]]:
        for number in walks:
            for snapshot, forecast in ticks:
                yield _later(snapshot, number), forecast

    walking = walk()
    bodies = [engine.zones(*next(walking)) for _ in ticks][-1]
    snapshot = ticks[-1][0]

    def judge() -> Assessment:
        findings = engine.separation(bodies, engine.robots(snapshot.now_ns))
        return engine.levels(snapshot, bodies, findings)

    return lambda: engine.zones(*next(walking)), judge


def _later(snapshot: PeopleSnapshot, walk: int) -> PeopleSnapshot:
    """Return the snapshot of a later walk, with other ids and later times."""
    later_ns = walk * _WALK_TICKS * TICK_NS
    return replace(
        snapshot,
        now_ns=snapshot.now_ns + later_ns,
        capture_ns=snapshot.capture_ns + later_ns,
        ids=tuple(i + walk * PEOPLE for i in snapshot.ids),
    )


def _arm(name: str, at: tuple[float, float], which: int) -> RobotTracker:
    settings = RobotSettings(
        name=name,
        model="ur5e",
        room_from_robot=Pose(xyz=[*at, 0.0]),
        payload_kg=0.0,  # without the payload's capsule it has 8
        max_speed_m_s=1.5,
        motion=StateMotion(plan="pick_and_place" if name == "planned" else None),
    )
    model = load_robot(settings, None)
    tracker = RobotTracker(settings, model)
    trajectory = load_trajectory("pick_and_place", model, None)
    for counter in range(_STATES):  # enough to prove its direction
        before_s = (_STATES - 1 - counter) * 0.02
        q, qd = trajectory.at_phase(_PHASES_S[which] - 0.5 * before_s, 0.5)
        state = RobotState(
            robot=which,
            mode=RobotMode.AUTOMATIC,
            counter=counter,
            positions=tuple(q.tolist()),
            velocities=tuple(qd.tolist()),
        )
        tracker.update(state, NOW_NS - round(before_s * 1e9))
    return tracker


def _walkers(tick: int) -> tuple[PeopleSnapshot, Forecast]:
    """Return people who walk to the arms at 0.5 m/s, and their true future as the forecast."""
    start = standing_body() + np.array([(*at, 0.0) for at in _PEOPLE_AT])[:, None]
    towards = -np.array([(*at, 0.0) for at in _PEOPLE_AT])
    velocity = 0.5 * towards / np.linalg.norm(towards, axis=1, keepdims=True)
    before = tick + 1 - _WALK_TICKS
    times = (np.arange(1 - STEPS, STEPS + 1) + before) / RATE_HZ
    path = start[:, None] + times[:, None, None] * velocity[:, None, None]  # (P, T + H, J, 3)
    people, now_ns = len(start), NOW_NS + before * TICK_NS
    snapshot = PeopleSnapshot(
        now_ns=now_ns,
        ids=tuple(range(people)),
        history=path[:, :STEPS],
        observed=np.ones((people, STEPS, len(JOINTS)), bool),
        capture_ns=np.full(people, now_ns - AGE_NS, np.int64),
        last_positions=path[:, STEPS - 1],
        joint_age_s=np.zeros((people, len(JOINTS))),
        lost=(),
        reasons=(),
        newest_capture_ns=now_ns - AGE_NS,
        captures=1,
        counters={},
    )
    return snapshot, Forecast(path[:, STEPS:], None)
