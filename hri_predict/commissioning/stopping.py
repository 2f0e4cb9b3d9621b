"""The stopping test: robots are stopped at given speeds and measured from their RobotState.

The node runs as always, in an empty cell. At each given speed the test commands a stop (see
``governed_link``) and follows the robot's fastest point until it stops. The delay budget and the
stopping table together set the allowed time and distance.
"""

import math
import threading
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import cast

import numpy as np

from hri_predict.base.clock import Clock
from hri_predict.commissioning.bench import Bench, bench
from hri_predict.commissioning.governed_link import GovernedLink
from hri_predict.commissioning.report import Stop, Stopping
from hri_predict.commissioning.typed_stops import NEAR, curves_of
from hri_predict.contracts.link import Link, Received
from hri_predict.node.listeners import Listener
from hri_predict.protocol.messages import RobotState
from hri_predict.risk.delay_budget import DelayBudget
from hri_predict.robots.model import RobotModel, RobotSettings, StateMotion
from hri_predict.robots.obedience import STANDS_M_S
from hri_predict.run import assemble
from hri_predict.run.config import Config

PARTS = (0.25, 0.5, 0.75, 1.0)
STOPS_WITHIN_S = 10.0
"""A robot that still moves after this time has failed to stop."""
RESTS_S = 0.3
"""Minimum time for which a robot must be slow to count as standing."""
_ONSET = 0.97
"""Braking starts when the speed was last above this fraction of its maximum: noise is ignored."""
SEEN_AGAIN_S = 0.1
"""A RobotState that comes within this time, or two usual intervals, was not missing."""
Sample = tuple[int, float]
"""Receipt time of a RobotState (node's clock, ns), and the speed of the fastest point, m/s."""


@dataclass(frozen=True, slots=True, kw_only=True)
class StoppingTrials:
    """Tests to run: speeds (m/s), runs per speed, and the maximum wait for a robot to reach it.

    Without speeds, ``PARTS`` of each robot's own maximum speed are used.
    """

    speeds_m_s: Sequence[float]
    repeats: int
    wait_s: float

    def speeds_of(self, robot: RobotSettings) -> list[float]:
        """Return the speeds at which this robot is stopped."""
        return list(self.speeds_m_s) or [round(part * robot.max_speed_m_s, 3) for part in PARTS]


@dataclass(slots=True)
class _Trial:
    """One robot at one speed, with the samples recorded after the stop command."""

    robot: int
    stated_m_s: float
    began_ns: int | None = None
    fastest_m_s: float = 0.0
    commanded_ns: int | None = None
    samples: list[Sample] = field(default_factory=list)
    ended: bool = False
    ended_ns: int = 0


class StopTest(Listener):
    """Lets one robot at a time move, and stops it at each given speed.

    Attributes:
        trials: all trials started, in order.
        done: set when all trials are over.
    """

    def __init__(
        self,
        models: Sequence[RobotModel],
        plan: StoppingTrials,
        robots: Mapping[int, RobotSettings],
    ) -> None:
        """Prepare the trials of ``robots``, given as indices into ``models``."""
        self._models, self._plan = models, plan
        self._waiting = [
            _Trial(robot, speed)
            for robot, settings in robots.items()
            for speed in plan.speeds_of(settings)
            for _ in range(plan.repeats)
        ]
        self._lock = threading.Lock()
        self._link: dict[int, str] = {}
        self.trials: list[_Trial] = []
        self.done = threading.Event()

    @property
    def longest_s(self) -> float:
        """Maximum duration of the whole test."""
        return 2.0 + len(self._waiting) * (self._plan.wait_s + STOPS_WITHIN_S + 2 * RESTS_S)

    def limit(self, robot: int) -> float:
        """See ``governed_link.Limit``."""
        now = self.trials[-1] if self.trials else None
        if now is None or now.robot != robot or now.commanded_ns is not None or now.ended:
            return 0.0
        return now.stated_m_s

    def on_received(self, link: str, received: Received) -> None:
        """Record a RobotState; if several links report a robot, only the first link is used."""
        state = received.message
        if not isinstance(state, RobotState) or state.robot >= len(self._models):
            return
        if self._link.setdefault(state.robot, link) != link:
            return
        model = self._models[state.robot]
        if not len(state.positions) == len(state.velocities) == model.dof:
            return
        q, qd = np.asarray(state.positions, float), np.asarray(state.velocities, float)
        speed = float(model.tip_speed(q, qd))
        if math.isfinite(speed):
            self._take(state.robot, received.received_ns, speed)

    def each_tick(self, now_ns: int) -> None:
        """Start the next trial when one is over; abandon a trial that times out."""
        now = self.trials[-1] if self.trials else None
        if now is not None and not now.ended:
            self._judge(now, now_ns)
        elif self._waiting:
            trial = self._waiting.pop(0)
            trial.began_ns = now_ns
            self.trials.append(trial)
        else:
            self.done.set()

    def _take(self, robot: int, at_ns: int, speed: float) -> None:
        now = self.trials[-1] if self.trials else None
        if now is None or now.robot != robot or now.ended:
            return
        now.samples.append((at_ns, speed))
        if now.commanded_ns is None:
            del now.samples[:-1]  # only the one before the command counts
            now.fastest_m_s = max(now.fastest_m_s, speed)

    def _judge(self, now: _Trial, now_ns: int) -> None:
        since_s = (now_ns - (now.began_ns or 0)) * 1e-9
        speed = now.samples[-1][1] if now.samples else 0.0
        if now.commanded_ns is None:
            reached = speed >= NEAR * now.stated_m_s
            late = since_s >= self._plan.wait_s and speed >= NEAR * now.fastest_m_s > STANDS_M_S
            if reached or late:
                now.commanded_ns = now_ns
            elif since_s >= 2 * self._plan.wait_s:
                now.ended, now.ended_ns = True, now_ns
            return
        stopping_s = (now_ns - now.commanded_ns) * 1e-9
        now.ended = stopping_s >= STOPS_WITHIN_S or self._rests(now, now_ns)
        now.ended_ns = now_ns

    @staticmethod
    def _rests(now: _Trial, now_ns: int) -> bool:
        since_ns = now_ns - round(RESTS_S * 1e9)
        newest = [speed for at_ns, speed in now.samples if at_ns >= since_ns]
        began = now.commanded_ns is not None and now.commanded_ns <= since_ns
        return began and bool(newest) and max(newest) < STANDS_M_S


def measure_stops(
    config: Config,
    plan: StoppingTrials,
    clock: Clock,
    progress: Callable[[str], None] = lambda _: None,
) -> tuple[Stopping, list[str]]:
    """Stop every robot that reports its state, at each given speed.

    Returns:
        The measurements, and one line for each speed that could not be measured.

    Raises:
        HriPredictError: a link or a controller cannot be started.
    """
    models = assemble.build_robots(config)
    budget = assemble.build_budget(config, assemble.build_source(config))
    moving = {
        i: robot
        for i, robot in enumerate(config.node.robots)
        if isinstance(robot.motion, StateMotion) and _linked(config, robot.name)
    }
    missing = [
        f"robot {robot.name}: no link reports its state, so the node cannot measure its stops"
        for i, robot in enumerate(config.node.robots)
        if i not in moving
    ]
    test = StopTest(models, plan, moving)
    with bench(config, clock) as end:
        _run(end, test, progress)
    stops, unmeasured = _measured(config, models, budget, test.trials)
    return Stopping(stops=stops, curves=curves_of(config, models)), [*missing, *unmeasured]


def _measured(
    config: Config, models: Sequence[RobotModel], budget: DelayBudget, trials: Sequence[_Trial]
) -> tuple[list[Stop], list[str]]:
    """Return the stops of these trials, and one line for each speed that was not measured."""
    stops, missing = [], []
    for trial in trials:
        settings, model = config.node.robots[trial.robot], models[trial.robot]
        stop, gap_s = _stop_of(trial, settings, model, budget), _missing_s(trial, settings)
        if gap_s is not None and not _fails(trial, stop, gap_s):
            missing.append(
                f"robot {settings.name}: RobotState was missing for {gap_s:.2g} s during the stop "
                f"from {trial.stated_m_s:g} m/s, so it was not measured; repeat the step"
            )
            continue
        if stop is None or stop.speed_m_s < NEAR * NEAR * trial.stated_m_s:
            missing.append(
                f"robot {settings.name}: never reached {trial.stated_m_s:g} m/s; the fastest was "
                f"{trial.fastest_m_s:.2f} m/s"
            )
        stops += [] if stop is None else [stop]
    return stops, list(dict.fromkeys(missing))


def judge_stops(stopping: Stopping) -> list[str]:
    """Return failures, one line for each stop that exceeded the allowed time or distance."""
    failed = []
    for stop in stopping.stops:
        if stop.passed:
            continue
        at = f"robot {stop.robot}, stopped at {stop.speed_m_s:.2f} m/s"
        if not stop.stood:
            failed.append(f"{at}: did not come to a standstill within {STOPS_WITHIN_S:g} s")
            continue
        whole = stop.total_s is not None and stop.total_m is not None
        took = stop.total_s if stop.total_s is not None else stop.braking_s
        went = stop.total_m if stop.total_m is not None else stop.braking_m
        failed.append(
            f"{at}: {'from the command' if whole else 'from braking'} {took * 1e3:.0f} ms and "
            f"{went * 1e3:.0f} mm (allowed {stop.allowed_s * 1e3:.0f} ms, "
            f"{stop.allowed_m * 1e3:.0f} mm), braking {stop.braking_s * 1e3:.0f} ms and "
            f"{stop.braking_m * 1e3:.0f} mm (table {stop.table_s * 1e3:.0f} ms, "
            f"{stop.table_m * 1e3:.0f} mm)"
        )
    return failed


def _run(end: Bench, test: StopTest, progress: Callable[[str], None]) -> None:
    over = threading.Event()
    said = 0

    def each_tick(now_ns: int) -> None:
        nonlocal said
        test.each_tick(now_ns)
        if len(test.trials) > said:
            said = len(test.trials)
            trial = test.trials[-1]
            name = end.config.node.robots[trial.robot].name
            progress(f"robot {name}: stopping it at {trial.stated_m_s:g} m/s")
        if test.done.is_set():
            over.set()

    advised = assemble.advised_on_links(end.config)
    links = [
        cast(Link, GovernedLink(link, robots, test.limit))  # its attributes are the link's own
        for link, robots in zip(end.links(), advised, strict=True)
    ]
    end.run(seconds=test.longest_s, listeners=[test], links=links, each_tick=each_tick, stop=over)


def _linked(config: Config, robot: str) -> bool:
    return any(not link.robots or robot in link.robots for link in config.links)


def _stop_of(
    trial: _Trial, settings: RobotSettings, model: RobotModel, budget: DelayBudget
) -> Stop | None:
    """Measure one stop; ``None`` if no stop was commanded or no RobotState followed."""
    if trial.commanded_ns is None or len(trial.samples) < 2:
        return None
    command_ns, samples = trial.commanded_ns, trial.samples
    peak = max(speed for _, speed in samples)
    rest = next(
        (i for i in range(len(samples)) if max(s for _, s in samples[i:]) < STANDS_M_S),
        len(samples) - 1,
    )
    stood = samples[-1][1] < STANDS_M_S
    onset = max(i for i, (_, speed) in enumerate(samples[: rest + 1]) if speed >= _ONSET * peak)
    # a gap says nothing about the robot, so it buys no time: see _missing_s
    resolution_s = min(_longest_gap_s(trial), _usual_s(trial, settings))
    braking_s = (samples[rest][0] - samples[onset][0]) * 1e-9
    braking_m = _travel(samples[onset : rest + 1])
    first = [(command_ns, samples[0][1]), *(each for each in samples if each[0] > command_ns)]
    total_s = (samples[rest][0] - command_ns) * 1e-9
    total_m = _travel([each for each in first if each[0] <= samples[rest][0]])
    table_s, table_m = model.stopping(peak)
    terms = budget.terms(settings.name)
    state_s = settings.motion.delay_s if isinstance(settings.motion, StateMotion) else 0.0
    # the command goes out within the tick; RobotState tells of the rest a sample late
    late_s = terms["encoding"] + terms["link_delay"] + terms["reaction"] + state_s + resolution_s
    allowed_s, allowed_m = late_s + table_s, peak * late_s + table_m
    stop = Stop(
        robot=settings.name,
        stated_m_s=trial.stated_m_s,
        speed_m_s=round(peak, 4),
        total_s=round(total_s, 4),
        total_m=round(total_m, 4),
        braking_s=round(braking_s, 4),
        braking_m=round(braking_m, 4),
        table_s=round(table_s, 4),
        table_m=round(table_m, 4),
        allowed_s=round(allowed_s, 4),
        allowed_m=round(allowed_m, 4),
        resolution_s=round(resolution_s, 4),
        measured_by="node",
        stood=stood,
        passed=False,
    )
    return stop.model_copy(update={"passed": stood and _is_within(stop)})


def _is_within(stop: Stop, more_s: float = 0.0) -> bool:
    """Whether a stop is within what is allowed, with times known ``more_s`` less exactly."""
    more_m, unsure_s = stop.speed_m_s * more_s, stop.resolution_s + more_s
    return (
        (stop.total_s or 0.0) <= stop.allowed_s + more_s
        and (stop.total_m or 0.0) <= stop.allowed_m + more_m
        # the onset is known to one sample, and so is the rest
        and stop.braking_s <= stop.table_s + 2 * unsure_s
        and stop.braking_m <= stop.table_m + 2 * stop.speed_m_s * unsure_s
    )


def _longest_gap_s(trial: _Trial) -> float:
    return max((b - a for (a, _), (b, _) in pairwise(trial.samples)), default=0) * 1e-9


def _usual_s(trial: _Trial, settings: RobotSettings) -> float:
    """Return the longest time without a RobotState that is usual for this robot."""
    between = [b - a for (a, _), (b, _) in pairwise(trial.samples)]
    usual_s = max(SEEN_AGAIN_S, 2e-9 * float(np.median(between or [0])))
    stale_s = settings.motion.stale_s if isinstance(settings.motion, StateMotion) else usual_s
    return min(usual_s, stale_s)


def _missing_s(trial: _Trial, settings: RobotSettings) -> float | None:
    """Return for how long RobotState was missing during a stop; ``None``: it was not."""
    if trial.commanded_ns is None or not trial.samples:
        return None
    gap_s = max(_longest_gap_s(trial), (trial.ended_ns - trial.samples[-1][0]) * 1e-9)
    return gap_s if gap_s > _usual_s(trial, settings) else None


def _fails(trial: _Trial, stop: Stop | None, gap_s: float) -> bool:
    """Whether a stop fails however the robot moved while RobotState was missing."""
    if stop is None:
        return False
    if not stop.stood:
        return (trial.ended_ns - trial.samples[-1][0]) * 1e-9 < gap_s  # it was seen to move on
    return not _is_within(stop, gap_s - stop.resolution_s)


def _travel(samples: Sequence[Sample]) -> float:
    """Return the distance travelled by the fastest point, at the higher speed of each interval."""
    return sum(max(u, v) * (b - a) * 1e-9 for (a, u), (b, v) in pairwise(samples))
