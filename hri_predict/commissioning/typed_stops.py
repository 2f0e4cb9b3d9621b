"""Stops measured by the integrator, and what any stopping test has to show."""

from collections.abc import Sequence
from dataclasses import dataclass

from hri_predict.commissioning.report import Curve, Stop, Stopping
from hri_predict.robots.model import RobotModel
from hri_predict.robots.settings import RobotSettings
from hri_predict.run import assemble
from hri_predict.run.config import Config

NEAR = 0.95
"""Fraction of a speed that counts as this speed: the stop is commanded there."""
_CURVE_STEPS = 40
_ROUNDED_M_S = 0.001
"""Speeds of a test, and of a stop, are rounded by less."""


@dataclass(frozen=True, slots=True)
class MeasuredStop:
    """A stop measured by the integrator, from the onset of braking to standstill."""

    robot: str
    speed_m_s: float
    time_s: float
    distance_m: float


def typed_stops(config: Config, measured: Sequence[MeasuredStop]) -> Stopping:
    """Compare stops measured by the integrator with the stopping tables."""
    models = {model.name: model for model in assemble.build_robots(config)}
    stops = []
    for each in measured:
        table_s, table_m = models[each.robot].stopping(each.speed_m_s)
        stops.append(
            Stop(
                robot=each.robot,
                stated_m_s=each.speed_m_s,
                speed_m_s=each.speed_m_s,
                total_s=None,
                total_m=None,
                braking_s=each.time_s,
                braking_m=each.distance_m,
                table_s=table_s,
                table_m=table_m,
                allowed_s=table_s,
                allowed_m=table_m,
                resolution_s=0.0,
                measured_by="integrator",
                stood=True,
                passed=each.time_s <= table_s and each.distance_m <= table_m,
            )
        )
    return Stopping(stops=stops, curves=curves_of(config, list(models.values())))


def without_top_speed(robots: Sequence[RobotSettings], stopping: Stopping) -> list[str]:
    """Return one line for each robot that was not stopped from its highest speed."""
    missing = []
    for robot in robots:
        speeds = [stop.speed_m_s for stop in stopping.stops if stop.robot == robot.name]
        if max(speeds, default=0.0) < NEAR * robot.max_speed_m_s - _ROUNDED_M_S:
            missing.append(
                f"robot {robot.name}: no stop from its highest speed, {robot.max_speed_m_s:g} m/s"
            )
    return missing


def curves_of(config: Config, models: Sequence[RobotModel]) -> list[Curve]:
    """Return each robot's stopping table up to its highest speed."""
    curves = []
    for settings, model in zip(config.node.robots, models, strict=True):
        top = settings.max_speed_m_s
        speeds = [top * (i + 1) / _CURVE_STEPS for i in range(_CURVE_STEPS)]
        rows = [model.stopping(speed) for speed in speeds]
        curves.append(
            Curve(
                robot=settings.name,
                speed_m_s=[round(speed, 4) for speed in speeds],
                time_s=[round(time_s, 4) for time_s, _ in rows],
                distance_m=[round(distance_m, 4) for _, distance_m in rows],
            )
        )
    return curves
