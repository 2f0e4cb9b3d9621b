"""Permitted speed over distance: how close a person may work while the robot runs.

The *working distance* is the distance from the robot's base to the person's mean position at which
the robot may run at nine tenths of its maximum speed or faster for nine tenths of the time. The
robot follows its path at full speed; its states, zones, separation and levels pass through the
node's own stages. The person's motion is unchanged, only moved and turned on the floor so that the
mean position is in the direction in which the robot works.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cache, cached_property
from math import atan2, ceil, cos, sin
from typing import Any

import numpy as np

from hri_predict.base.arrays import Floats
from hri_predict.base.errors import ConfigError, nearest
from hri_predict.contracts.predictor import Predictor
from hri_predict.contracts.source import Source
from hri_predict.protocol.messages import RobotMode, RobotState
from hri_predict.risk.delay_budget import DelayBudget
from hri_predict.risk.engine import RiskEngine
from hri_predict.risk.separation.stage import Findings
from hri_predict.robots.model import RobotModel, StandingMotion, StateMotion
from hri_predict.robots.tracker import RobotNow, RobotTracker
from hri_predict.robots.trajectory import Trajectory, load_trajectory, shipped_for
from hri_predict.run import assemble
from hri_predict.run.config import Config
from hri_predict.run.session import VIRTUAL_START_NS
from hri_predict.run.working_distance.seen import Seen, moved_zones, shifted_zones
from hri_predict.zones.body_zones import BodyZones
from hri_predict.zones.calibration import Calibration

FAST = 0.9
"""Share of the robot's maximum speed from which on it counts as working."""
HELD = 0.9
"""Share of the time for which that speed must be permitted."""
WARM_S = 2.5
"""Time for levels and self-check to settle; excluded from the measurement."""
NEAREST_M, FARTHEST_M = 0.3, 6.0
STEP_M = 0.02
STATE_S = 0.02
"""Time between two RobotStates."""
_PHASES = 64
_TRIED = 2  # times the ticks that may be slow are tried first
_UR5 = ("ur5", "ur5e")  # the robots of the plan pick_and_place
_AHEAD_M = 0.05  # a robot whose parts are nearer to its axis than this on average faces nowhere


@dataclass(frozen=True, kw_only=True)
class Situation:
    """A cell without people.

    Attributes:
        config: the cell, see ``alone``.
        source: gives the rate of captures.
        predictor: computes the forecasts.
        robot: index of the measured robot.
        budget: the delays.
        calibration: calibration of the zones; ``None`` without one.
        stretch: factor of the robots' stopping times and distances.
        state_s: time between two RobotStates; 0: one at each tick.
    """

    config: Config
    source: Source
    predictor: Predictor
    robot: int
    budget: DelayBudget
    calibration: Calibration | None
    stretch: float = 1.0
    state_s: float = STATE_S

    @classmethod
    def of(cls, config: Config, source: Source, predictor: Predictor, robot: int) -> "Situation":
        """The situation as configured."""
        return cls(
            config=config,
            source=source,
            predictor=predictor,
            robot=robot,
            budget=assemble.build_budget(config, source),
            calibration=assemble.build_calibration(config),
        )

    @property
    def max_speed_m_s(self) -> float:
        """Maximum speed of the robot."""
        return self.config.node.robots[self.robot].max_speed_m_s

    def engine(self, trackers: Sequence[RobotTracker]) -> RiskEngine:
        """Return a new risk stage."""
        return assemble.build_risk(
            self.config,
            self.source,
            self.predictor,
            trackers,
            budget=self.budget,
            calibration=self.calibration,
        )

    @cached_property
    def models(self) -> tuple[RobotModel, ...]:
        """The robots."""
        models = assemble.build_robots(self.config)
        for model in models:
            model.stretch = self.stretch
        return models

    def trackers(self, start_ns: int) -> list[RobotTracker]:
        """Return new trackers of all robots."""
        return list(assemble.build_trackers(self.config, self.models, start_ns))

    def zones(self, seen: Seen) -> list[BodyZones]:
        """Return the zones (K) of people, in their own frame."""
        engine = self.engine(self.trackers(seen.snapshots[0].now_ns))
        return [engine.zones(*tick) for tick in seen.ticks()]

    @cached_property
    def paths(self) -> list[Trajectory | None]:
        """Return the path of each robot, if it is known."""
        return [known_path(self.config, model, i) for i, model in enumerate(self.models)]

    @property
    def path(self) -> Trajectory:
        """Return the path of the measured robot.

        Raises:
            ConfigError: the path is not known.
        """
        return path_of(self.config, self.models[self.robot], self.robot)

    def robots(self, seen: Seen) -> list[list[RobotNow]]:
        """Return all robots at each tick (K): they work at full speed and report it."""
        start_ns = seen.snapshots[0].now_ns
        trackers = self.trackers(start_ns)
        engine = self.engine(trackers)
        period_ns, counter, next_ns = round(self.state_s * 1e9), 0, start_ns
        found = []
        for snapshot in seen.snapshots:
            now_ns = snapshot.now_ns
            while next_ns <= now_ns:
                at_ns = next_ns if period_ns else now_ns
                for tracker, path in zip(trackers, self.paths, strict=True):
                    _report(tracker, path, (at_ns, start_ns), counter)
                counter = (counter + 1) % 65536
                next_ns = at_ns + (period_ns or 1)
            found.append(engine.robots(now_ns))
        return found


def alone(config: Config) -> Config:
    """Return the cell without rules that do not depend on distance.

    Doors, named zones and the sensor's field of view define where people are expected, and latches
    wait for a person to press a button.
    """
    node = config.node
    source: dict[str, Any] = {"field_of_view": None, "sees_free_space": False, "shadows": []}
    source |= {"viewpoints": [], "faults": []}
    empty = config.with_node(
        people=node.people.model_copy(update={"exits": [], "entrances": None}),
        risk=node.risk.model_copy(update={"latch": [], "restart": "automatic", "sets": []}),
        zones=[],
    )
    return replace(empty, source=config.source.model_copy(update=source))


def robot_of(config: Config, name: str | None) -> int:
    """Return the index of the robot with this name; by default the first moving robot.

    Raises:
        ConfigError: the robot does not exist, or its base moves.
    """
    names = [robot.name for robot in config.node.robots]
    if name is not None and name not in names:
        raise ConfigError(
            f"--robot {name}: unknown{nearest(name, names)} (known: {', '.join(names)})"
        )
    moving = [r.name for r in config.node.robots if not isinstance(r.motion, StandingMotion)]
    chosen = name or next(iter(moving), names[0])
    robot = config.node.robots[names.index(chosen)]
    if robot.base is not None:
        raise ConfigError(
            f"robot {chosen}: its base moves, but a working distance is measured from a fixed "
            "base; name another robot with --robot"
        )
    return names.index(chosen)


class Measure:
    """One robot, and people at any distance from its base.

    Args:
        situation: the cell.
        seen: people in their own frame.
        zones: (K) zones, see ``Situation.zones``.
        robots: (K) all robots, see ``Situation.robots``.
        middle: (2,) mean position of the people in that frame.

    Attributes:
        known: distance -> (N,) measured permitted speeds.
    """

    def __init__(
        self,
        situation: Situation,
        seen: Seen,
        *,
        zones: Sequence[BodyZones],
        robots: Sequence[Sequence[RobotNow]],
        middle: Floats,
    ) -> None:
        self._situation, self._seen, self._middle = situation, seen, middle
        self._engine = situation.engine(situation.trackers(seen.snapshots[0].now_ns))
        self._asked_m_s = self._engine.new_levels().asked_m_s
        self._robots = robots
        model = situation.models[situation.robot]
        assert model.base is not None  # robot_of has checked it
        self._base = model.base
        # the turn is the same at every distance
        ahead_rad = _ahead_rad(model, situation.path)
        c, s = cos(ahead_rad), sin(ahead_rad)
        turn = np.eye(4)
        turn[:2, :2] = self._turn = np.array([[c, -s], [s, c]])
        self._zones = [moved_zones(bodies, turn) for bodies in zones]
        self._counts = np.array(
            [(s.now_ns - VIRTUAL_START_NS) * 1e-9 >= WARM_S for s in seen.snapshots]
        )
        self._slow_at_m = np.zeros(len(self._counts))  # the farthest distance known so far
        self.known: dict[float, Floats] = {}

    def limits(self, distance_m: float) -> Floats:
        """Return the permitted speeds (N,) in m/s of all counted ticks, with people at this
        distance.
        """
        if distance_m not in self.known:
            self.known[distance_m] = np.array(list(self._limits(self._ticks_at(distance_m))))
        return self.known[distance_m]

    def works(self, distance_m: float) -> bool:
        """Return whether the robot may work with people at this distance."""
        fast_m_s = FAST * self._situation.max_speed_m_s - 1e-9
        ticks, there = np.flatnonzero(self._counts), self._ticks_at(distance_m)
        count, fast, slow = max(1, len(ticks)), 0, 0
        if distance_m not in self.known:  # first, and in any order, whether any memory is too much
            first = ticks[np.argsort(-self._slow_at_m[ticks], kind="stable")]
            for k in first[: ceil(_TRIED * (1 - HELD) * count)].tolist():
                if self._asked_m_s(self._situation.robot, *there(k)) < fast_m_s:
                    self._slow_at_m[k] = max(self._slow_at_m[k], distance_m)
                    slow += 1
                    if (count - slow) / count < HELD:
                        return False
        fast = slow = 0
        limits_m_s = self.known.get(distance_m, self._limits(there))
        for k, limit_m_s in zip(ticks, limits_m_s, strict=False):
            fast += limit_m_s >= fast_m_s
            if limit_m_s < fast_m_s:
                slow += 1
                self._slow_at_m[k] = max(self._slow_at_m[k], distance_m)
            if fast / count >= HELD or (count - slow) / count < HELD:
                break  # the ticks that are left change nothing
        return fast / count >= HELD

    def distance_m(
        self, low: float = NEAREST_M, high: float = FARTHEST_M, step: float = STEP_M
    ) -> float | None:
        """Return the working distance in metres, to ``step``; ``None`` if above ``FARTHEST_M``.

        The search starts between ``low`` and ``high``, which may be equal or swapped: it moves on
        by at least ``step`` each time and never leaves ``NEAREST_M`` to ``FARTHEST_M``, so it ends.
        """
        low = min(max(low, NEAREST_M), FARTHEST_M)
        high = min(max(high, low + step), FARTHEST_M)
        while not self.works(high):
            if high >= FARTHEST_M:
                return None
            low, high = high, min(FARTHEST_M, high + max(step, 2 * (high - low)))
        while low > NEAREST_M and self.works(low):
            low, high = max(NEAREST_M, low - max(step, 2 * (high - low))), low
        while high - low > step:
            middle = 0.5 * (low + high)
            low, high = (low, middle) if self.works(middle) else (middle, high)
        return high

    def _limits(self, there: "_Ticks") -> Iterator[float]:
        """Yield the permitted speed of each counted tick, m/s."""
        levels, robot = self._engine.new_levels(), self._situation.robot
        for k, (snapshot, counts) in enumerate(
            zip(self._seen.snapshots, self._counts, strict=True)
        ):
            limit_m_s = levels.limit_m_s(robot, snapshot, *there(k))
            if counts:
                yield limit_m_s

    def _ticks_at(self, distance_m: float) -> "_Ticks":
        """Return a function: tick -> people at this distance and the robots' separations, computed
        once each.
        """
        to = self._turn @ (np.array([distance_m, 0.0]) - self._middle)
        by_m = np.append(self._base[:2] + to, 0.0)

        @cache
        def tick(k: int) -> tuple[BodyZones, Findings]:
            there = shifted_zones(self._zones[k], by_m)
            return there, self._engine.separation(there, self._robots[k])

        return tick


_Ticks = Callable[[int], tuple[BodyZones, Findings]]


def _report(
    tracker: RobotTracker, path: Trajectory | None, times_ns: tuple[int, int], counter: int
) -> None:
    """Report at the first time the state of a robot that started working at the second time."""
    motion = tracker.settings.motion
    if path is None or not isinstance(motion, StateMotion):
        return
    q, qd = path.at((times_ns[0] - times_ns[1]) * 1e-9 - motion.delay_s)
    state = RobotState(
        robot=0,
        mode=RobotMode.AUTOMATIC,
        counter=counter,
        positions=tuple(q.tolist()),
        velocities=tuple(qd.tolist()),
    )
    tracker.update(state, times_ns[0])


def path_of(config: Config, model: RobotModel, index: int) -> Trajectory:
    """Return the path that a robot follows.

    Raises:
        ConfigError: the path is not known.
    """
    path = known_path(config, model, index)
    if path is None:
        robot = config.node.robots[index]
        otherwise = "pick_and_place" if robot.model in _UR5 else "path.yaml"
        plan = shipped_for(robot.model) or otherwise
        raise ConfigError(
            f"robots.{index}: no path of robot {robot.name} is known, so its permitted speed near "
            "people cannot be measured; in a copy of the configuration, write motion: {kind: "
            f"state, plan: {plan}}}, or the file of your own path. In the cell itself motion.plan "
            "also makes the node expect the robot on that path, and to brake on it"
        )
    return path


def known_path(config: Config, model: RobotModel, index: int) -> Trajectory | None:
    """Return the path that a robot follows, from its configuration or its simulated drive."""
    robot = config.node.robots[index]
    file = getattr(robot.motion, "plan", None) or getattr(robot.motion, "file", None)
    key = f"robots.{index}.motion.plan"
    for number, link in enumerate(config.links):
        simulate = link.simulate or {}
        if file is None and simulate.get("robot") == robot.name:
            file, key = simulate.get("trajectory"), f"links.{number}.simulate.trajectory"
    return None if file is None else load_trajectory(file, model, config.base_dir, key)


def _ahead_rad(model: RobotModel, path: Trajectory) -> float:
    """Return the mean direction, from the base, in which the robot works, in steps of whole
    degrees.
    """
    assert model.base is not None
    times = np.arange(_PHASES) * path.duration_s / _PHASES
    capsules = model.capsules(path.at(times)[0])
    ends = np.concatenate([capsules.a, capsules.b], axis=1)[..., :2] - model.base[:2]
    far = np.take_along_axis(ends, np.linalg.norm(ends, axis=-1).argmax(1)[:, None, None], axis=1)
    x, y = far[:, 0].mean(0)
    if x * x + y * y < _AHEAD_M**2:
        x, y = 1.0, 0.0
    return float(np.radians(np.round(np.degrees(atan2(y, x)))))
