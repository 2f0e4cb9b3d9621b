"""Present position of a robot, or the reasons why it is unknown."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from hri_predict.base.arrays import Floats
from hri_predict.base.errors import RobotError
from hri_predict.base.geometry import Capsules
from hri_predict.protocol.messages import OperatingMode, RobotMode, RobotState
from hri_predict.protocol.reasons import Reason
from hri_predict.robots.mode_request import NOTHING_ASKED, ModeRequest, ModeRequests
from hri_predict.robots.model import (
    RobotModel,
    RobotSettings,
    StandingMotion,
    StateMotion,
    TrajectoryMotion,
)
from hri_predict.robots.plan import OnPlan, Plan
from hri_predict.robots.states.agreement import RobotPlace, apart_m, permitted_m
from hri_predict.robots.states.frozen import FrozenCheck
from hri_predict.robots.states.line import Line, Received
from hri_predict.robots.states.plausibility import HELD_S, StateCheck
from hri_predict.robots.states.reader import StateReader
from hri_predict.robots.states.still import StillCheck
from hri_predict.robots.trajectory import load_trajectory, slower, standing_at

PLACE_STEP_S = 0.3
"""Maximum step, in seconds of its plan, between places of a robot that backs out."""
BACK_S = 0.05
"""Distance back along the path: of two places with the same joints, the one nearest to it is used.
At a turning point this continues past the turn, where the joints are the same.
"""
FASTER_M_S = 0.05
"""Minimum excess of speed for which a controller takes precedence over the newest state."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class RobotNow:
    """State of a robot at one moment.

    Attributes:
        q: (N,) rad, m, a moving base's coordinates first; ``None`` if unknown (no state yet, or an
            impossible state).
        qd: (N,) rad/s, m/s; ``None`` if ``q`` is ``None``.
        speed_m_s: speed of the fastest point (upper bound at ``q``, ``qd``); 0 if unknown. The
            higher of the reported speed and the speed derived from the positions.
        reasons: why the state cannot be trusted; empty if it can.
        uncertainty_m: maximum position error of any point at ``q``: due to a change of the arm's
            speed since RobotState was received (acceleration x age^2 / 2), the error of a moving
            base's reported pose, and small differences between controllers. Add it to Z_r.
        age_s: time since the state's receipt; ``None`` before the first, 0 for a known motion.
        capsules: (C,) capsules of the model at ``q``, if they were computed with the speed.
        on_plan: place on the tracker's ``plan``; ``None`` if it is not on the plan.
        confirmed: whether the motion so far proves the direction of ``qd``.
        proven: whether the position is proven; see ``StillCheck``.
        tool: number of the assumed tool; ``None``: no tool is named, or the worst case is assumed.
        asked: requests of its controllers.
        place_s: place on the plan from the joints only, while recovery is requested, because a
            robot backing out has velocities that are not in the plan. ``None``: not known.
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
    proven: bool = True
    tool: int | None = None
    asked: ModeRequest = NOTHING_ASKED
    place_s: float | None = None

    def without(self, reason: Reason) -> "RobotNow":
        """Return the same state without one of its reasons."""
        return replace(self, reasons=tuple(r for r in self.reasons if r is not reason))


class RobotTracker:
    """Tracks one robot from RobotState or a trajectory file, or as a robot at rest.

    Args:
        settings: the robot's entry in the configuration.
        model: its model.
        base_dir: base of relative paths of trajectory files.
        start_ns: start time of a trajectory; ``None``: at the first call of ``at``.
        check: creates the check of one link's states from the maximum joint velocities (N,) and the
            position noise (N,).

    Attributes:
        settings, model: as given.
        plan: the path of the robot; ``None`` if unknown.
        outcomes: number of states ``accepted``, ``repeated`` (same counter, so not fresh) and
            ``invalid``, and number of times that states ``contradicted`` each other or the
            trajectory.
        counters: in addition, ``velocity_wrong``, ``jumped``, ``miscounted`` and ``frozen``.

    Raises:
        RobotError: the trajectory or the standing position does not fit; starts with its key.
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
        self.outcomes = {"accepted": 0, "repeated": 0, "invalid": 0, "contradicted": 0}
        self._new_check = check
        self._reader = StateReader(model)
        self._lines: dict[str, Line] = {}
        self._start_ns = start_ns
        self._contradict_until_ns = 0
        self._reported = StateMotion()
        if isinstance(settings.motion, StateMotion):
            self._reported = settings.motion
        self._acceleration_m_s2 = self._reported.acceleration_m_s2
        self._noise = np.zeros(model.dof)
        if settings.base is not None:  # two states may be off in opposite directions
            place, heading = settings.base.uncertainty_m, settings.base.uncertainty_rad
            self._noise[:3] = 2 * place, 2 * place, 2 * heading
            self._acceleration_m_s2 += settings.base.acceleration_m_s2
        self.plan: Plan | None = None
        self._on_plan: OnPlan | None = None
        self._located_ns = 0
        self._asked = ModeRequests()
        self._still = StillCheck(self._reported.still_s, model.dof - model.reported)
        self._place_s: float | None = None
        motion = settings.motion
        if isinstance(motion, StandingMotion):
            self._standing = standing_at(motion, model, settings.name)
        elif isinstance(motion, TrajectoryMotion):
            self.plan = self._planned(motion.file, base_dir, "motion.file")
        elif motion.plan is not None:
            self.plan = self._planned(motion.plan, base_dir, "motion.plan")

    def update(self, state: RobotState, received_ns: int, link: str = "") -> None:
        """Process a RobotState.

        A repeated counter on a link does not refresh the state, so the data of a frozen sender
        becomes stale. An impossible state (joint count, NaN, limits, a missing base, or a moving
        base configured as fixed) makes the position unknown until a good state arrives. So do
        states that contradict each other, for some seconds; see ``StateCheck``.

        Args:
            state: as received.
            received_ns: time of receipt, node's clock.
            link: link on which the state arrived; each link has its own counter.
        """
        line = self._lines.get(link)
        if line is None:
            line = self._lines[link] = self._new_line()
        if line.counter == state.counter:
            self.outcomes["repeated"] += 1
            return
        line.counter, line.heard_ns = state.counter, received_ns
        joints = self._reader.joints(state, link)
        if isinstance(joints, Reason):
            self.outcomes["invalid"] += 1
            line.refused = joints
            return
        q, qd = joints
        line.check.take(state.counter, q, qd, received_ns)
        line.refused = None if self._reader.is_possible(qd) else Reason.ROBOT_STATE_INVALID
        if line.refused is not None:
            self.outcomes["invalid"] += 1
            return
        self.outcomes["accepted"] += 1
        tool = self._named(state)
        line.state = Received(np.array(q), np.array(qd), state.mode, received_ns, tool)
        self._asked.take(state, received_ns, link)
        self._still.take(q, link)

    def advise(self, limit_m_s: float, now_ns: int) -> None:
        """Record the speed limit sent to the robot at ``now_ns``; 0 for a stop."""
        self._still.advise(limit_m_s, now_ns)

    def _new_line(self) -> Line:
        model = self.model
        check = self._new_check(model.velocity_max, self._noise)
        lead = model.dof - model.reported
        check.frozen = FrozenCheck(model.tip_speed, self._acceleration_m_s2, lead)
        return Line(model, check)

    @property
    def counters(self) -> dict[str, int]:
        """See the class."""
        found = {"velocity_wrong": 0, "jumped": 0, "miscounted": 0, "frozen": 0}
        for line in self._lines.values():
            for name, count in line.check.counters.items():
                found[name] += count
            found["frozen"] += 0 if line.check.frozen is None else line.check.frozen.counter
        return {**self.outcomes, **found}

    def at(self, now_ns: int) -> RobotNow:
        """Return the robot's state at ``now_ns``, node's clock.

        With RobotState, the joints are extrapolated at their reported velocity over the state's age
        (the link's delay plus at most ``stale_s`` since receipt), within their limits.
        ``uncertainty_m`` bounds the effect of a change of speed since then. A robot configured as
        at rest or on a trajectory is unknown if a RobotState is wrong.
        """
        motion = self.settings.motion
        if isinstance(motion, StateMotion):
            return self._by_state(motion, now_ns)
        if wrong := self._wrong(now_ns):
            return _nowhere(wrong)
        now = self._by_plan(motion, now_ns)
        states = [line.place(now_ns, self._reported) for line in self._fresh(now_ns)]
        assert now.q is not None  # a plan always says where it is
        assert now.qd is not None
        off_m = self._off_m(RobotPlace(now.q, now.qd), now.speed_m_s, states, now_ns)
        if off_m is None:
            return _nowhere((Reason.ROBOT_STATES_CONTRADICT,))
        return replace(now, uncertainty_m=off_m)

    def _by_plan(self, motion: TrajectoryMotion | StandingMotion, now_ns: int) -> RobotNow:
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
        lines, wrong = self._fresh(now_ns), self._wrong(now_ns)
        line = self._fastest(lines) if lines else self._newest()
        frozen = [each.is_frozen(now_ns, motion.stale_s) for each in lines]
        reasons = [Reason.ROBOT_STATE_FROZEN] if any(frozen) else []
        if line is None or line.state is None or wrong:
            return _nowhere((*reasons, *wrong) or (Reason.ROBOT_STATE_STALE,))
        state, place = line.state, line.place(now_ns, motion)
        age_s = max((now_ns - state.received_ns) * 1e-9, 0.0)
        if age_s > motion.stale_s:
            reasons.append(Reason.ROBOT_STATE_STALE)
        if state.mode != RobotMode.AUTOMATIC:
            reasons.append(Reason.ROBOT_NOT_AUTOMATIC)
        tool = self._tool(lines)
        model = self.model.counting(tool)
        capsules, speed = model.moving(place.q, state.qd)
        if line.check.unreported is not None:
            unreported = state.qd + line.check.unreported
            speed = np.maximum(speed, model.tip_speed(place.q, unreported))
        others = [each.place(now_ns, motion) for each in lines if each is not line]
        off_m = self._off_m(place, float(speed), others, now_ns)
        if off_m is None:
            return _nowhere((Reason.ROBOT_STATES_CONTRADICT,))
        off_m += self._acceleration_m_s2 * place.ahead_s**2 / 2
        if model.mobile is not None:
            off_m += model.mobile.uncertainty_m
        asked = self._asked.at(now_ns, motion.stale_s)
        return RobotNow(
            q=place.q,
            qd=state.qd,
            speed_m_s=float(speed),
            reasons=tuple(reasons),
            asked=asked,
            on_plan=self._along_plan(state, place.ahead_s),
            place_s=self._placed(state, asked),
            uncertainty_m=off_m,
            age_s=age_s,
            capsules=capsules,
            confirmed=line.check.confirmed,
            proven=self._still.is_proven,
            tool=tool,
        )

    def _fresh(self, now_ns: int) -> list[Line]:
        """Return the controllers with fresh states."""
        stale_s = self._reported.stale_s
        return [line for line in self._lines.values() if line.is_fresh(now_ns, stale_s)]

    def _newest(self) -> Line | None:
        """Return the controller with the newest state."""
        heard = [line for line in self._lines.values() if line.state is not None]
        return max(heard, key=_received_ns, default=None)

    def _fastest(self, lines: Sequence[Line]) -> Line:
        """Return the decisive controller: the newest, unless another reports a higher speed."""
        newest = max(lines, key=_received_ns)
        if len(lines) == 1:
            return newest
        speeds = {line: self._speed(line) for line in lines}
        fastest = max(lines, key=lambda line: speeds[line])
        return fastest if speeds[fastest] > speeds[newest] + FASTER_M_S else newest

    def _speed(self, line: Line) -> float:
        assert line.state is not None  # it is fresh
        return float(self.model.tip_speed(line.state.q, line.state.qd))

    def _off_m(
        self, place: RobotPlace, speed_m_s: float, others: Sequence[RobotPlace], now_ns: int
    ) -> float | None:
        """Return the maximum distance of other states from a position; ``None``: too far.

        A contradiction remains in effect for ``HELD_S`` after it was last seen.
        """
        model, most_m = self.model, 0.0
        for other in others:
            off_m = apart_m(model, place, other)
            speed = max(speed_m_s, float(model.tip_speed(other.q, other.qd)))
            permitted = permitted_m(
                model, place, other, speed_m_s=speed, acceleration_m_s2=self._acceleration_m_s2
            )
            if not off_m <= permitted:
                self.outcomes["contradicted"] += now_ns >= self._contradict_until_ns
                self._contradict_until_ns = now_ns + round(HELD_S * 1e9)
            most_m = max(most_m, off_m)
        return None if now_ns < self._contradict_until_ns else most_m

    def _named(self, state: RobotState) -> int | None:
        """Return the tool in a state, if it is confirmed and known."""
        tool = state.tool
        known = isinstance(tool, int) and not isinstance(tool, bool)
        known = known and tool in self.model.tool_numbers
        return tool if known and state.tool_confirmed is True else None

    def _tool(self, lines: Sequence[Line]) -> int | None:
        """Return the tool confirmed by all controllers with fresh states; ``None``: worst case."""
        if not self.model.tool_numbers:
            return None
        said = {line.state.tool for line in lines if line.state is not None}
        return said.pop() if len(said) == 1 else None

    def _wrong(self, now_ns: int) -> tuple[Reason, ...]:
        """Return why the newest states cannot be trusted."""
        stale_s, lines = self._reported.stale_s, self._lines.values()
        return tuple(dict.fromkeys(r for line in lines for r in line.reasons(now_ns, stale_s)))

    def _along_plan(self, state: Received, ahead_s: float) -> OnPlan | None:
        """Return the place of a state on the plan, advanced by ``ahead_s`` at its rate."""
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

    def _placed(self, state: Received, asked: ModeRequest) -> float | None:
        """Return the phase of the newest state from its joints only, near the last known phase.

        A path that goes forth and back contains each position twice. A robot that backs out on the
        way forth looks like one that continues on the way back; only the previous place
        distinguishes them.
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

    def _planned(self, file: str, base_dir: Path | None, key: str) -> Plan:
        trajectory = load_trajectory(file, self.model, base_dir, key)
        peak = trajectory.peak_tip_speed(self.model)
        if peak > self.settings.max_speed_m_s:
            limit, better = self.settings.max_speed_m_s, slower(file, self.settings.model)
            raise RobotError(
                f"{key}: trajectory '{file}' moves robot '{self.settings.name}' at {peak:.3g} m/s, "
                f"above max_speed_m_s {limit:g}; use {better}"
            )
        return Plan(trajectory, self.model)


def _nowhere(reasons: tuple[Reason, ...]) -> RobotNow:
    """Return the state of a robot that may be anywhere."""
    return RobotNow(q=None, qd=None, speed_m_s=0.0, reasons=reasons, age_s=None)


def _received_ns(line: Line) -> int:
    return -1 if line.state is None else line.state.received_ns
