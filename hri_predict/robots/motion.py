"""Motion of a robot now, and its continuation and stop, along its plan or straight on."""

from dataclasses import dataclass

import numpy as np

from hri_predict.base.arrays import Floats, Ints
from hri_predict.base.geometry import Capsules
from hri_predict.robots.model import RobotModel
from hri_predict.robots.plan import OnPlan, Plan
from hri_predict.robots.stopping import StoppingCurve
from hri_predict.robots.tracker import RobotNow

DIRECTED_M_S = 0.1
"""Minimum speed at which measured velocities show a direction. Velocities derived from positions
with 0.1 mrad resolution over 8 ms have steps of 0.0125 rad/s. For a robot at rest, six joints about
a metre from the tip add up to 0.03 m/s (sqrt(6) x 0.0125) in any direction. At three times that
speed, the direction is correct to within 20 degrees. Along a plan the direction is known."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class RobotMotion:
    """One robot's motion from now on. K steps after now.

    A *place* on the path is a phase of the plan; without a plan, the time in seconds at ``qd`` from
    ``q``.

    Attributes:
        q, qd: (N,) now, rad and rad/s, m and m/s.
        speed_m_s: present speed of the fastest point.
        clearance_m: C + Z_d + Z_r.
        capsules: (C,) now.
        stopping_s, stopping_m: T_s and S_s at that speed.
        times_s: (K+1,) as in ``Zones``.
        until_braking_s: time from now.
        model, curve: model and stopping curve of the robot.
        plan, on_plan: planned path, and place on it; both or neither are set.
        confirmed: whether the motion so far proves the direction of ``qd``.
        proven: whether its states were seen to change while it was free to move.
        tool: number of the assumed tool; ``None``: no tool is named, or the worst case is assumed.
    """

    q: Floats
    qd: Floats
    speed_m_s: float
    clearance_m: float
    capsules: Capsules
    stopping_s: float
    stopping_m: float
    times_s: Floats
    until_braking_s: float
    model: RobotModel
    curve: StoppingCurve
    plan: Plan | None
    on_plan: OnPlan | None
    confirmed: bool = True
    proven: bool = True
    tool: int | None = None

    @classmethod
    def of(
        cls,
        now: RobotNow,
        *,
        stopping: tuple[float, float],
        model: RobotModel,
        curve: StoppingCurve,
        plan: Plan | None,
        clearance_m: float,
        times_s: Floats,
        until_braking_s: float,
    ) -> "RobotMotion":
        """Return the motion of a robot with known joints; ``stopping``: T_s and S_s now."""
        assert now.q is not None  # the caller has checked it
        assert now.qd is not None
        stopping_s, stopping_m = stopping
        return cls(
            q=now.q,
            qd=now.qd,
            speed_m_s=now.speed_m_s,
            clearance_m=clearance_m + now.uncertainty_m,
            capsules=now.capsules or model.capsules(now.q),
            stopping_s=stopping_s,
            stopping_m=stopping_m,
            times_s=times_s,
            until_braking_s=until_braking_s,
            model=model,
            curve=curve,
            plan=plan if now.on_plan is not None else None,
            on_plan=now.on_plan if plan is not None else None,
            confirmed=now.confirmed,
            proven=now.proven,
            tool=now.tool,
        )

    @property
    def is_foreseen(self) -> bool:
        """Whether the robot's direction is known, from its plan or from confirmed motion above the
        noise."""
        return self.on_plan is not None or (self.confirmed and self.speed_m_s > DIRECTED_M_S)

    def stopping_at(self, speeds_m_s: Floats) -> tuple[Capsules, Ints]:
        """(L, K+1, C) the robot as it moves on at each speed and stops.

        And (L,) the last step that begins before it stands.
        """
        if self.plan is not None and self.on_plan is not None:
            capsules, stands_s = self.plan.stopping_capsules(
                self.on_plan, speeds_m_s, self.times_s, self.until_braking_s
            )
            return capsules, self._steps_until(stands_s)
        stopping_s = self._stopping_s(speeds_m_s)
        capsules = self.model.stopping_capsules(
            self.q,
            self.qd,
            times_s=self.times_s,
            reaction_s=self.until_braking_s,
            stopping_s=stopping_s,
            scale=speeds_m_s / self.speed_m_s,
            speed_m_s=self.speed_m_s,
        )
        return capsules, self._steps_until(self.until_braking_s + stopping_s)

    def ends_at(self, speeds_m_s: Floats) -> Floats:
        """Return the place (L,) where the robot comes to rest from each speed."""
        if self.plan is not None and self.on_plan is not None:
            ever = np.array([1e3])
            return self.plan.phases(self.on_plan, speeds_m_s, ever, self.until_braking_s)[0][:, 0]
        stopping_s = self._stopping_s(speeds_m_s)
        ever = self.until_braking_s + stopping_s[:, None]
        travel = self.model.travel_s(
            speeds_m_s[:, None], ever, self.until_braking_s, stopping_s[:, None]
        )
        return travel[:, 0] * speeds_m_s / self.speed_m_s

    def at_places(self, end: float, count: int) -> Capsules:
        """Return the robot (count, C) at evenly spaced places from the present one to ``end``."""
        if self.plan is not None and self.on_plan is not None:
            start = self.on_plan.phase_s
            return self.model.capsules(self.plan.trajectory.at(np.linspace(start, end, count))[0])
        return self.model.capsules(self.q + np.linspace(0.0, end, count)[:, None] * self.qd)

    @property
    def is_one_path(self) -> bool:
        """Whether all joints follow one path at every speed; a base and its arm do not."""
        return self.model.mobile is None

    @property
    def place(self) -> float:
        """Place now."""
        return 0.0 if self.on_plan is None else self.on_plan.phase_s

    def _steps_until(self, stands_s: Floats) -> Ints:
        until: Ints = self.times_s[:-1].searchsorted(stands_s, "right")
        return until

    def _stopping_s(self, speeds_m_s: Floats) -> Floats:
        tabled = np.interp(speeds_m_s, self.curve.speed_m_s, self.curve.time_s)
        return np.where(speeds_m_s == self.speed_m_s, self.stopping_s, tabled)
