"""The outcome of an episode: the numbers of one approach, which the tables sum by recording.

Only the time with a person in the room counts; before that, the robot starts up.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from hri_predict.base.arrays import Bools, Floats
from hri_predict.base.geometry import Capsules, least_distance
from hri_predict.base.skeleton import CANONICAL
from hri_predict.protocol.messages import Level
from hri_predict.robots.model import RobotModel
from hri_sim.referee import Tally, body_capsules
from hri_sim.simulation.bodies import MotionTicks
from hri_sim.simulation.cell import Cell
from hri_sim.simulation.episode import Log
from hri_sim.simulation.harm import Touches
from hri_sim.simulation.scenario import Scenario

HORIZON_S = 1.0
"""Horizon for judging a stop and predicting a touch (one second, as in CHICO)."""
NEAR_M = 0.25
"""A stop was justified if a person would have come this near to a robot that continued."""
JUDGED_EVERY = 5  # ticks between two judged predictions of a touch
_ADVISED = ("stop", "unknown", "fault")  # causes of a stop that are advice, not the wire


@dataclass(kw_only=True)
class Outcome(Tally, Touches):
    """One approach under one variant: the referee's tally, touches, and counts of stops.

    Attributes:
        index, motion: the scenario's number, and the first person's motion.
        seconds: time with a person in the room.
        stops: protective stops, caused by advice.
        wire_stops: stops caused by losses on the wire.
        judged_stops, judged_s: stops followed by a whole recorded horizon, and the time in which a
            stop could be judged.
        false_stops: unnecessary judged stops: all people would have stayed farther than ``NEAR_M``
            from a robot that continued.
        touches: 1 if the unprotected robot would have been touched.
        missed: 1 if, in addition, the advice was *clear* or *warn* until the touch.
        lead_s: if not missed, the time from the first stricter advice to the touch.
        cycles, cycles_empty: work done, and work of an empty cell in the same time.
    """

    index: int
    motion: str
    seconds: float
    stops: int = 0
    wire_stops: int = 0
    judged_stops: int = 0
    judged_s: float = 0.0
    false_stops: int = 0
    touches: int = 0
    missed: int = 0
    lead_s: list[float] = field(default_factory=list)
    cycles: float = 0.0
    cycles_empty: float = 0.0


@dataclass
class Truth:
    """One approach without protection, identical for every variant.

    Attributes:
        bodies, counts: (K, B) capsules of all people at each tick, and which of them count.
        first_touch: robot's name -> tick at which it would first have been touched.
    """

    bodies: Capsules
    counts: Bools
    first_touch: dict[str, int]

    @classmethod
    def of(cls, log: Log, models: Sequence[RobotModel]) -> "Truth":
        """Build it from the log of an episode in which the node saw no person."""
        ids = sorted({i for people in log.people for i in people})
        joints = len(CANONICAL.joints)
        shape = (len(log.people), len(ids), joints)
        positions, known = np.zeros((*shape, 3)), np.zeros(shape, dtype=bool)
        for k, people in enumerate(log.people):
            for person, (at, seen) in people.items():
                positions[k, ids.index(person)], known[k, ids.index(person)] = at, seen
        body, counts = body_capsules(positions, known)
        count = len(log.people)
        truth = cls(
            Capsules(
                body.a.reshape(count, -1, 3),
                body.b.reshape(count, -1, 3),
                body.radius.reshape(count, -1),
            ),
            counts.reshape(count, -1),
            {},
        )
        for model in models:
            gaps = truth.gaps(np.arange(count), model, np.array(log.q[model.name]))
            touching = np.flatnonzero(gaps <= 0)
            if touching.size:
                truth.first_touch[model.name] = int(touching[0])
        return truth

    def gaps(self, ticks: Any, model: RobotModel, q: Floats) -> Floats:
        """Return (M,) metres between all people at ``ticks`` (M,) and the robot at ``q`` (M, N)."""
        return least_distance(self.bodies[ticks], self.counts[ticks], model.capsules(q))


def outcome(*, cell: Cell, scenario: Scenario, log: Log, alone: Log, truth: Truth) -> Outcome:
    """Return the outcome of an episode; ``alone``: the same approach without protection."""
    times = np.array(log.times_s)
    start = first_tick(log)
    found = Outcome(
        index=scenario.index,
        motion=scenario.motions[0],
        seconds=float(times[-1] - times[start]),
        judged_s=max(0.0, float(times[-1] - times[start]) - HORIZON_S),
        **log.tally(),
        **({} if log.harm is None else log.harm.touches()),
    )
    _count_stops(found=found, cell=cell, log=log, truth=truth, times=times, start=start)
    for robot, (model, trajectory) in enumerate(zip(cell.models, cell.trajectories, strict=True)):
        paths, paths_alone = log.path_s[model.name], alone.path_s[model.name]
        found.cycles += (paths[-1] - paths[start]) / trajectory.duration_s
        found.cycles_empty += (paths_alone[-1] - paths_alone[start]) / trajectory.duration_s
        if model.name in truth.first_touch:
            mild = [levels[robot].rank < Level.SLOW.rank for levels in log.levels]
            _count_touch(
                found=found,
                times=times,
                mild=mild,
                start=start,
                touch=truth.first_touch[model.name],
            )
    return found


def first_tick(log: Log) -> int:
    """Return the first tick with a person in the room."""
    return next(k for k, people in enumerate(log.people) if people)


def _count_touch(
    *, found: Outcome, times: Floats, mild: Sequence[bool], start: int, touch: int
) -> None:
    """Count whether the unprotected touch was foreseen, and how early."""
    found.touches += 1
    if mild[touch]:
        found.missed += 1
        return
    since = touch
    while since > start and not mild[since - 1]:
        since -= 1
    found.lead_s.append(float(times[touch] - times[since]))


def _count_stops(
    *, found: Outcome, cell: Cell, log: Log, truth: Truth, times: Floats, start: int
) -> None:
    """Count protective stops, and those after which no person would have come near the robot."""
    drives = {report.robot: report for report in log.controllers if report.role == "drive"}
    for model, trajectory in zip(cell.models, cell.trajectories, strict=True):
        for at_s, cause, limit in drives[model.name].events:
            if limit > 0 or at_s < times[start]:
                continue
            if cause not in _ADVISED:
                found.wire_stops += 1
                continue
            found.stops += 1
            if at_s + HORIZON_S > times[-1]:
                continue
            found.judged_stops += 1
            ticks = np.flatnonzero((times >= at_s) & (times <= at_s + HORIZON_S))
            begin_s = np.interp(at_s, times, log.path_s[model.name])
            q, _ = trajectory.at(begin_s + times[ticks] - at_s)
            found.false_stops += bool(truth.gaps(ticks, model, q).min() > NEAR_M)


@dataclass(kw_only=True)
class Prediction:
    """Numbers of instants by predicted and true touch within the next second (as in CHICO)."""

    index: int
    motion: str
    true_positive: int = 0
    false_positive: int = 0
    false_negative: int = 0
    true_negative: int = 0


def prediction(
    *, cell: Cell, scenario: Scenario, alone: Log, truth: Truth, bodies: MotionTicks
) -> Prediction:
    """Compare predicted touches of bodies (not zones) and the planned robot with the true ones.

    Both assume that the robot continues along its path at full speed.
    """
    found = Prediction(index=scenario.index, motion=scenario.motions[0])
    rate_hz = cell.predictor.rate_hz
    steps = min(cell.predictor.horizon_steps, round(HORIZON_S * rate_hz))
    times = np.array(alone.times_s)
    last = int(np.searchsorted(times, times[-1] - HORIZON_S + 1e-9))
    for k in range(first_tick(alone), last, JUDGED_EVERY):
        forecast, snapshot = bodies.forecasts[k], bodies.snapshots[k]
        if forecast is None or not snapshot.ids:
            continue
        ahead = (np.arange(steps) + 1) / rate_hz
        offsets = (snapshot.capture_ns - snapshot.now_ns) * 1e-9  # (P,)
        window = np.arange(k, int(np.searchsorted(times, times[k] + HORIZON_S + 1e-9)))
        expected = came = False
        for model, trajectory in zip(cell.models, cell.trajectories, strict=True):
            path_s = alone.path_s[model.name][k]
            for person, offset in zip(forecast[:, :steps], offsets, strict=True):
                robot = model.capsules(trajectory.at(path_s + offset + ahead)[0])
                expected |= bool(_gaps(cell, person, robot).min() <= 0)
            q, _ = trajectory.at(path_s + times[window] - times[k])
            came |= bool(truth.gaps(window, model, q).min() <= 0)
        found.true_positive += expected and came
        found.false_positive += expected and not came
        found.false_negative += came and not expected
        found.true_negative += not came and not expected
    return found


def _gaps(cell: Cell, joints: Floats, robot: Capsules) -> Floats:
    """Return (H,) metres between predicted joints (H, J, 3) and the robot's capsules (H, C)."""
    segments = cell.predictor.skeleton.segments
    a = joints[:, [s.joint_a for s in segments]]
    b = joints[:, [s.joint_b for s in segments]]
    radius = np.broadcast_to([s.radius for s in segments], a.shape[:-1])
    bodies = Capsules(a, b, radius)
    return least_distance(bodies, np.ones(radius.shape, dtype=bool), robot)
