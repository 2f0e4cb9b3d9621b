"""Where a robot is now, or why that is unknown."""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from hri_predict.arrays import Floats
from hri_predict.errors import RobotError
from hri_predict.geometry import Capsules
from hri_predict.protocol.messages import OperatingMode, RobotMode, RobotState
from hri_predict.protocol.reasons import Reason
from hri_predict.quantities.units import meant
from hri_predict.robots.asked import NOTHING_ASKED, Asked, AskedByLinks
from hri_predict.robots.model import (
    RobotModel,
    RobotSettings,
    StandingMotion,
    StateMotion,
    TrajectoryMotion,
)
from hri_predict.robots.plan import OnPlan, Plan
from hri_predict.robots.plausibility import StateCheck
from hri_predict.robots.settings import POSITION_TOLERANCE
from hri_predict.robots.trajectory import load_trajectory

PLACE_STEP_S = 0.3
"""A robot that backs out is at most so far, in seconds of its plan, from where it was before."""
BACK_S = 0.05
"""Of two places with the same joints, it is at the one nearest to so far back. Where a path turns
round, that takes it on; either way the joints that follow are those that are judged."""
VELOCITY_TOLERANCE = 0.1
"""How far beyond a limit a reported velocity may lie, as a fraction of the limit: a servo
overshoots for a moment."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class RobotNow:
    """A robot at one moment.

    Attributes:
        q: (N,) rad, m, a moving base's coordinates first; ``None`` if unknown (no state yet, or an
            impossible one).
        qd: (N,) rad/s, m/s; ``None`` with ``q``.
        speed_m_s: of the fastest point (upper bound at ``q``, ``qd``); 0 if unknown. The higher of
            what is reported and what the change of the positions proves.
        reasons: why it cannot be trusted; empty if it can.
        uncertainty_m: how far any point may be from where ``q`` puts it because the arm changed its
            speed since RobotState came: acceleration x age^2 / 2; and because a moving base is not
            quite where it is said to be. Add it to Z_r.
        age_s: since the state's receipt; ``None`` before the first, 0 for a known motion.
        capsules: (C,) of the model at ``q``, if they were computed with the speed.
        on_plan: its place on the tracker's ``plan``; ``None`` if it is not found there.
        confirmed: whether the motion so far proves the direction of ``qd``.
        tool: number of the tool that is counted with; ``None``: none is named, or the worst of all.
        asked: what its controllers ask for.
        place_s: its place on the plan by its joints alone, while recovery is asked for: backing
            out, it has velocities that the plan does not have. ``None``: not known.
    """

    q: Floats | None
    qd: Floats | None
    speed_m_s: float
    reasons: tuple[Reason, ...] = ()
    uncertainty_m: float = 0.0
    age_s: float | None = 0.0
    capsules: Capsules | None = None
    on_plan: OnPlan | None = None
    confirmed: bool = True
    tool: int | None = None
    asked: Asked = NOTHING_ASKED
    place_s: float | None = None

    def without(self, reason: Reason) -> "RobotNow":
        """The same without one of its reasons."""
        return replace(self, reasons=tuple(r for r in self.reasons if r is not reason))


@dataclass(frozen=True, slots=True, eq=False)
class _Received:
    """The newest acceptable RobotState."""

    q: Floats
    qd: Floats
    mode: RobotMode
    received_ns: int
    link: str


_Joints = tuple[tuple[float, ...], tuple[float, ...]]
"""Positions and velocities, the base's first."""


class RobotTracker:
    """Follows one robot by its RobotState, its trajectory file, or standing still.

    Args:
        settings: the robot's entry in the configuration.
        model: its model.
        base_dir: base of relative paths of trajectory files.
        start_ns: when a trajectory starts; ``None`` means at the first ``at``.
        check: compares the states of one link with each other; takes the joints' fastest (N,) and
            the noise of their positions (N,).

    Attributes:
        settings, model: as given.
        plan: the path that it follows; ``None`` if unknown.
        counters: states ``accepted``, ``repeated`` (same counter, so not fresh), ``invalid``, and
            found to be ``velocity_wrong``, ``jumped`` or ``miscounted`` (see ``StateCheck``).

    Raises:
        RobotError: the trajectory or the standing position does not fit the robot.
    """

    def __init__(
        self,
        settings: RobotSettings,
        model: RobotModel,
        base_dir: Path | None = None,
        start_ns: int | None = None,
        *,
        check: Callable[[Floats, Floats], StateCheck] = StateCheck,
    ) -> None:
        self.settings = settings
        self.model = model
        self._counts = {"accepted": 0, "repeated": 0, "invalid": 0}
        self._new_check = check
        self._checks: dict[str, StateCheck] = {}
        self._start_ns = start_ns
        self._state: _Received | None = None
        self._refused: Reason | None = None
        self._tools: dict[str, tuple[int, int | None]] = {}  # by link: when and which
        self._yaw: dict[str, float] = {}  # by link: of the base, without jumps of a full turn
        self._last_counter: dict[str, int] = {}
        self._bounds = list(
            zip(
                (model.position_min - POSITION_TOLERANCE).tolist(),
                (model.position_max + POSITION_TOLERANCE).tolist(),
                strict=True,
            )
        )
        self._fastest = (model.velocity_max * (1 + VELOCITY_TOLERANCE)).tolist()
        self._noise = np.zeros(model.dof)
        if settings.base is not None:  # two states may be off in opposite directions
            place, heading = settings.base.uncertainty_m, settings.base.uncertainty_rad
            self._noise[:3] = 2 * place, 2 * place, 2 * heading
        self.plan: Plan | None = None
        self._on_plan: OnPlan | None = None
        self._located_ns = 0
        self._asked = AskedByLinks()
        self._place_s: float | None = None
        motion = settings.motion
        if isinstance(motion, StandingMotion):
            self._standing = self._checked_standing(motion)
        elif isinstance(motion, TrajectoryMotion):
            self.plan = self._planned(motion.file, base_dir)
        elif motion.plan is not None:
            self.plan = self._planned(motion.plan, base_dir)

    def update(self, state: RobotState, received_ns: int, link: str = "") -> None:
        """Take a RobotState.

        A counter that repeats on its link refreshes nothing: a frozen sender ages out. An
        impossible state (joint count, NaN, limits, a base that is missing or should stand) makes
        the position unknown until a good one comes. So do states that contradict each other, for
        some seconds; see ``StateCheck``.

        Args:
            state: as received.
            received_ns: time of receipt, node's clock.
            link: the link it came on; each link has its own counter.
        """
        if self._last_counter.get(link) == state.counter:
            self._counts["repeated"] += 1
            return
        self._last_counter[link] = state.counter
        joints = self._joints(state, link)
        if isinstance(joints, Reason):
            self._counts["invalid"] += 1
            self._refused = joints
            return
        q, qd = joints
        if link not in self._checks:
            self._checks[link] = self._new_check(self.model.velocity_max, self._noise)
        self._checks[link].take(state.counter, q, qd, received_ns)
        self._refused = None if self._is_possible(qd) else Reason.ROBOT_STATE_INVALID
        if self._refused is not None:
            self._counts["invalid"] += 1
            return
        self._counts["accepted"] += 1
        self._state = _Received(np.array(q), np.array(qd), state.mode, received_ns, link)
        self._tools[link] = received_ns, self._named(state)
        self._asked.take(state, received_ns, link)

    @property
    def counters(self) -> dict[str, int]:
        """What came of the RobotStates; see the class."""
        counts = {**self._counts, "velocity_wrong": 0, "jumped": 0, "miscounted": 0}
        for check in self._checks.values():
            for name, count in check.counters.items():
                counts[name] += count
        return counts

    def at(self, now_ns: int) -> RobotNow:
        """Where the robot is at ``now_ns``, node's clock.

        With RobotState, the joints move on at their reported velocity over the state's age (its
        link's delay plus at most ``stale_s`` since its receipt), but not past their limits.
        ``uncertainty_m`` bounds the effect of a change of speed since then.
        """
        motion = self.settings.motion
        if isinstance(motion, StateMotion):
            return self._by_state(motion, now_ns)
        if isinstance(motion, StandingMotion):
            return RobotNow(q=self._standing, qd=np.zeros(self.model.dof), speed_m_s=0.0)
        assert self.plan is not None  # __init__ loaded it
        if self._start_ns is None:
            self._start_ns = now_ns
        phase_s = (now_ns - self._start_ns) * 1e-9 + motion.start_s
        q, qd = self.plan.trajectory.at(phase_s)
        capsules, speed = self.model.moving(q, qd)
        return RobotNow(
            q=q, qd=qd, speed_m_s=float(speed), capsules=capsules, on_plan=OnPlan(phase_s, 1.0)
        )

    def _by_state(self, motion: StateMotion, now_ns: int) -> RobotNow:
        state = self._state
        wrong = self._wrong(now_ns)
        if state is None or wrong:
            why = wrong or (Reason.ROBOT_STATE_STALE,)
            return RobotNow(q=None, qd=None, speed_m_s=0.0, reasons=why, age_s=None)
        age_s = max((now_ns - state.received_ns) * 1e-9, 0.0)
        reasons: list[Reason] = []
        if age_s > motion.stale_s:
            reasons.append(Reason.ROBOT_STATE_STALE)
        if state.mode != RobotMode.AUTOMATIC:
            reasons.append(Reason.ROBOT_NOT_AUTOMATIC)
        ahead_s = min(age_s, motion.stale_s) + motion.delay_s
        lowest = np.minimum(self.model.position_min, state.q)
        highest = np.maximum(self.model.position_max, state.q)
        q = np.minimum(np.maximum(state.q + state.qd * ahead_s, lowest), highest)
        tool = self._tool(now_ns, motion.stale_s)
        model = self.model.counting(tool)
        capsules, speed = model.moving(q, state.qd)
        check = self._checks[state.link]
        if check.unreported is not None:
            speed = np.maximum(speed, model.tip_speed(q, state.qd + check.unreported))
        acceleration_m_s2, off_m = motion.acceleration_m_s2, 0.0
        if model.mobile is not None:
            acceleration_m_s2 += model.mobile.settings.acceleration_m_s2
            off_m = model.mobile.uncertainty_m
        on_plan = self._along_plan(state, ahead_s)
        asked = self._asked.at(now_ns, motion.stale_s)
        return RobotNow(
            q=q,
            qd=state.qd,
            speed_m_s=float(speed),
            reasons=tuple(reasons),
            asked=asked,
            place_s=self._placed(state, asked),
            uncertainty_m=acceleration_m_s2 * ahead_s**2 / 2 + off_m,
            age_s=age_s,
            capsules=capsules,
            on_plan=on_plan,
            confirmed=check.confirmed,
            tool=tool,
        )

    def _named(self, state: RobotState) -> int | None:
        """The tool that a state names, if it is confirmed and known."""
        tool = state.tool
        known = isinstance(tool, int) and not isinstance(tool, bool)
        known = known and tool in self.model.tool_numbers
        return tool if known and state.tool_confirmed is True else None

    def _tool(self, now_ns: int, stale_s: float) -> int | None:
        """The tool that every link confirms whose state is fresh; else the worst must count."""
        if not self._tools or not self.model.tool_numbers:
            return None
        oldest_ns = now_ns - round(stale_s * 1e9)
        said = {tool for at_ns, tool in self._tools.values() if at_ns >= oldest_ns}
        return said.pop() if len(said) == 1 else None

    def _wrong(self, now_ns: int) -> tuple[Reason, ...]:
        """Why the newest states cannot be believed."""
        if self._refused is not None:
            return (self._refused,)
        found = (check.reason(now_ns) for check in self._checks.values())
        return tuple(dict.fromkeys(reason for reason in found if reason is not None))

    def _along_plan(self, state: _Received, ahead_s: float) -> OnPlan | None:
        """The place of a state on the plan, moved on for ``ahead_s`` at its rate."""
        if self.plan is None:
            return None
        expected_s = None
        if self._on_plan is not None:
            since_s = (state.received_ns - self._located_ns) * 1e-9
            expected_s = self._on_plan.phase_s + self._on_plan.rate * since_s
        if state.received_ns != self._located_ns or self._on_plan is None:
            self._on_plan = self.plan.locate(state.q, state.qd, expected_s)
            self._located_ns = state.received_ns
        found = self._on_plan
        return (
            None if found is None else replace(found, phase_s=found.phase_s + found.rate * ahead_s)
        )

    def _placed(self, state: _Received, asked: Asked) -> float | None:
        """The phase of the newest state by its joints alone, near the last one that is known.

        A path that goes there and back has each place twice. A robot that backs out on the way
        there looks like one that goes on, on the way back: only where it was before tells.
        """
        before_s = self._place_s
        self._place_s = None if self._on_plan is None else self._on_plan.phase_s
        if self.plan is None or before_s is None or asked.request is not OperatingMode.RECOVERY:
            return self._place_s
        expected_s = before_s - BACK_S
        found = self.plan.locate(state.q, np.zeros(self.model.dof), expected_s)
        around_s = self.plan.trajectory.duration_s
        away_s = 0.0 if found is None else found.phase_s - before_s
        away_s -= around_s * round(away_s / around_s)
        near = found is not None and abs(away_s) <= PLACE_STEP_S
        self._place_s = found.phase_s if found is not None and near else None
        return self._place_s

    def _planned(self, file: str, base_dir: Path | None) -> Plan:
        trajectory = load_trajectory(file, self.model, base_dir)
        peak = trajectory.peak_tip_speed(self.model)
        if peak > self.settings.max_speed_m_s:
            raise RobotError(
                f"robot '{self.settings.name}': its fastest point reaches {peak:.3g} m/s on "
                f"trajectory '{file}', above max_speed_m_s "
                f"{self.settings.max_speed_m_s:g}; raise that, or slow the trajectory"
            )
        return Plan(trajectory, self.model)

    def _joints(self, state: RobotState, link: str) -> "_Joints | Reason":
        """Positions and velocities with the base's, or why the state is refused.

        All must be there, be numbers, and lie within the position limits.
        """
        joints, base = self.model.reported, state.base
        if len(state.positions) != joints or len(state.velocities) != joints:
            return Reason.ROBOT_STATE_INVALID
        q, qd = state.positions, state.velocities
        if self.model.mobile is not None:
            if base is None:
                return Reason.ROBOT_BASE_UNKNOWN
            q = base.x_m, base.y_m, base.yaw_rad, *q
            qd = base.vx_m_s, base.vy_m_s, base.yaw_rate_rad_s, *qd
        elif base is not None:
            return Reason.ROBOT_STATE_INVALID
        try:  # plain numbers: for so few an array costs more than the comparison
            # Written so that NaN, which compares false with everything, is refused.
            sound = all(
                low <= p <= high and abs(v) < math.inf and abs(p) < math.inf
                for p, v, (low, high) in zip(q, qd, self._bounds, strict=True)
            )
        except TypeError:  # a field that is "not available"
            return Reason.ROBOT_STATE_INVALID
        if not sound:
            return Reason.ROBOT_STATE_INVALID
        return (q if base is None else self._unwound(q, link)), qd

    def _unwound(self, q: tuple[float, ...], link: str) -> tuple[float, ...]:
        """The same with the base's yaw next to that of the link's state before."""
        turns = round((self._yaw.get(link, q[2]) - q[2]) / (2 * math.pi))
        self._yaw[link] = q[2] + 2 * math.pi * turns
        return *q[:2], self._yaw[link], *q[3:]

    def _is_possible(self, qd: tuple[float, ...]) -> bool:
        """Whether all velocities are within their limits."""
        if not all(-most <= v <= most for v, most in zip(qd, self._fastest, strict=True)):
            return False
        return self.model.mobile is None or math.hypot(qd[0], qd[1]) <= self._fastest[0]

    def _checked_standing(self, motion: StandingMotion) -> Floats:
        model, name = self.model, self.settings.name
        if len(motion.positions) != model.dof:
            raise RobotError(
                f"robot '{name}': motion.positions has {len(motion.positions)} values, but "
                f"'{self.settings.model}' has {model.dof} joints; give one for each of "
                f"{', '.join(model.joint_names)}"
            )
        q = np.array(motion.positions)
        outside = np.flatnonzero((q < model.position_min) | (q > model.position_max))
        if outside.size:
            j = outside[0]
            raise RobotError(
                f"robot '{name}': motion.positions: joint '{model.joint_names[j]}' at {q[j]:g} "
                f"{model.units[j]} is outside {model.position_min[j]:g} .. "
                f"{model.position_max[j]:g}; {meant(q[j], model.units[j])}"
            )
        return q
