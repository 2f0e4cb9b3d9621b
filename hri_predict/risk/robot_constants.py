"""Constants of one robot for the risk stage. They are constant, unless the robot is measured to
stop later than its stopping table states.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Self

from hri_predict.base.errors import ConfigError
from hri_predict.risk.delay_budget import DelayBudget
from hri_predict.risk.settings import RiskSettings
from hri_predict.risk.terms import ProtectiveDistance, protective_distance
from hri_predict.robots.model import RobotModel, RobotSettings, StateMotion
from hri_predict.robots.plan import Plan
from hri_predict.robots.stopping import StoppingCurve
from hri_predict.robots.tracker import RobotTracker


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class RobotConstants:
    """The constants of one robot.

    Attributes:
        robot: its entry in the configuration.
        risk: see ``RiskSettings``.
        model: its geometry and stopping.
        plan: the path of the robot; ``None`` if unknown.
        curve: T_s and S_s over its speed.
        budget: the delays.
        until_braking_s: time from now until it starts to brake.
        fixed_radius_m: radius for mode ``fixed``: as configured, or the robot's reach plus the
            maximum S_p; wider for a robot that was measured to stop late.
        spare_m: what was configured for it beyond reach and maximum S_p; negative if less.
        tools: the constants with one tool, by its number; this object is the worst case over all
            tools.
    """

    robot: RobotSettings
    risk: RiskSettings
    model: RobotModel
    plan: Plan | None
    curve: StoppingCurve
    budget: DelayBudget
    until_braking_s: float
    fixed_radius_m: float
    spare_m: float
    tools: Mapping[int, Self] = field(default_factory=dict)

    @classmethod
    def of(
        cls, tracker: RobotTracker, risk: RiskSettings, budget: DelayBudget, horizon_s: float
    ) -> Self:
        """Return the constants of the robot of ``tracker``.

        Args:
            tracker: the robot's tracker.
            risk: see ``RiskSettings``.
            budget: the delays.
            horizon_s: the forecast's last step after the capture.

        Raises:
            ConfigError: T_r + T_s exceeds the horizon, or the circle of mode ``fixed`` is smaller
                than the robot.
        """
        robot, model = tracker.settings, tracker.model
        curve = StoppingCurve.of(model.stopping, robot.max_speed_m_s)
        budget.check(robot.name, float(curve.time_s[-1]), horizon_s, risk.beyond_horizon)
        needed_m = worst_distance(risk, robot, model, budget).total
        radius_m = risk.fixed_radius_m or model.reach_m + needed_m
        if risk.mode == "fixed" and radius_m < model.reach_m:
            raise ConfigError(
                f"risk.fixed_radius_m: {radius_m:g} m is less than the reach of robot "
                f"{robot.name}, {model.reach_m:.2f} m; increase it, or leave it out"
            )
        worst = cls(
            robot=robot,
            risk=risk,
            model=model,
            plan=tracker.plan,
            curve=curve,
            budget=budget,
            until_braking_s=budget.after_now_s(robot.name),
            fixed_radius_m=radius_m,
            spare_m=radius_m - model.reach_m - needed_m,
        )
        return replace(worst, tools={n: worst._with_tool(n) for n in model.tool_numbers})

    def _with_tool(self, number: int) -> Self:
        """Return the same robot with one tool; circles and doors remain those of the worst case."""
        model = self.model.counting(number)
        plan = None if self.plan is None else Plan(self.plan.trajectory, model)
        curve = StoppingCurve.of(model.stopping, self.robot.max_speed_m_s)
        return replace(self, model=model, plan=plan, curve=curve, tools={})

    def counting(self, tool: int | None) -> Self:
        """Return the constants with one tool; ``None``: the worst case over all tools."""
        return self if tool is None else self.tools[tool]

    def revised(self) -> Self:
        """Return a copy with the models' present stopping curves."""
        curve = StoppingCurve.of(self.model.stopping, self.robot.max_speed_m_s)
        radius_m = max(self.fixed_radius_m, self.anywhere_m + self.spare_m)
        tools = {number: own.revised() for number, own in self.tools.items()}
        return replace(self, curve=curve, fixed_radius_m=radius_m, tools=tools)

    @property
    def name(self) -> str:
        """The robot's name in the configuration."""
        return self.robot.name

    @property
    def is_reported(self) -> bool:
        """Whether its controller reports its motion."""
        return isinstance(self.robot.motion, StateMotion)

    @property
    def max_speed_m_s(self) -> float:
        """The robot's highest speed in production."""
        return self.robot.max_speed_m_s

    @property
    def anywhere_m(self) -> float:
        """Distance from its base beyond which people are safe, for every position of the robot."""
        return self.model.reach_m + self.needed_m()

    @property
    def longest_s(self) -> float:
        """Maximum T_r + T_s, seconds: input almost stale, highest speed."""
        return self.reaction_s(self.budget.stale_s) + float(self.curve.time_s[-1])

    def reaction_s(self, age_s: float) -> float:
        """Return T_r, seconds, for advice based on a capture of age ``age_s``."""
        return age_s + self.until_braking_s

    def needed_m(self, human_m_s: float = 0.0, late_s: float = 0.0) -> float:
        """S_p at the highest speed and the longest delay, metres.

        ``late_s``: how much older a body is than ``stale_s``, as one that the newest scenes lack.
        """
        budget = replace(self.budget, stale_s=self.budget.stale_s + late_s)
        return worst_distance(self.risk, self.robot, self.model, budget, human_m_s=human_m_s).total


def worst_distance(
    settings: RiskSettings,
    robot: RobotSettings,
    model: RobotModel,
    budget: DelayBudget,
    *,
    human_m_s: float = 0.0,
    speed_m_s: float | None = None,
) -> ProtectiveDistance:
    """Return S_p at the longest delay, term by term.

    ``speed_m_s``: the robot's speed; ``None``: its highest.
    """
    speed_m_s = robot.max_speed_m_s if speed_m_s is None else speed_m_s
    of_base_m = 0.0 if model.mobile is None else model.mobile.uncertainty_m
    return protective_distance(
        speed_m_s,
        budget.reaction_s(budget.stale_s, robot.name),
        *model.stopping(speed_m_s),
        intrusion_m=settings.intrusion_m,
        person_uncertainty_m=settings.person_uncertainty_m,
        robot_uncertainty_m=settings.robot_uncertainty_m + of_base_m,
        human_m_s=human_m_s,
    )
