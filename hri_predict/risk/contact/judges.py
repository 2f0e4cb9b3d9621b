"""Build the contact judges, one for each robot that may touch people."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from hri_predict.base.errors import ConfigError
from hri_predict.base.skeleton import Segment
from hri_predict.risk.contact.clamping import Clamping, thickness_m
from hri_predict.risk.contact.judge import ContactJudge
from hri_predict.risk.contact.limits import SegmentLimits, load_table
from hri_predict.risk.fixtures import Fixture, floor
from hri_predict.risk.robot_constants import RobotConstants
from hri_predict.risk.settings import RiskSettings
from hri_predict.robots.model import RobotModel, RobotSettings

_UPRIGHT = 0.99  # cosine of the base's tilt


def contact_judges(
    *,
    settings: RiskSettings,
    robots: Sequence[RobotConstants],
    segments: Sequence[Segment],
    floor_m: float,
    base_dir: Path | None = None,
) -> dict[int, ContactJudge]:
    """Return the judges by robot index; empty unless the mode is ``hybrid``.

    Args:
        settings: see ``RiskSettings``.
        robots: all robots.
        segments: the zones' segments.
        floor_m: height of the floor.
        base_dir: base of relative paths.

    Raises:
        ConfigError: no robot has ``contact: allowed``, the zones leave out the head, the table
            cannot be read, or fixtures are missing for a robot that does not stand upright.
    """
    if settings.mode != "hybrid":
        return {}
    if "head" not in (s.name for s in segments):
        raise ConfigError(
            "risk.mode hybrid: the zones do not include the head, so the robot may not touch any "
            "person; remove torso from people.absent_parts, choose a predictor with a head in its "
            "skeleton, or use mode predictive"
        )
    judges = {}
    for index, robot in enumerate(robots):
        if robot.robot.contact is None:
            continue
        names = [s.name for s in segments]
        margins = settings.region_margins_m
        radii = np.array([s.radius + margins.get(s.region, 0.0) for s in segments])
        judges[index] = ContactJudge(
            robot,
            segment_limits(settings, robot.model, names, base_dir),
            Clamping(
                [floor(floor_m, "floor"), *fixtures_of(settings, robot.robot)],
                thickness_m(names, radii),
            ),
        )
    if not judges:
        raise ConfigError(
            "risk.mode hybrid: no robot is allowed to touch people; set 'contact: allowed' for "
            "one, or use mode predictive"
        )
    return judges


def segment_limits(
    settings: RiskSettings, model: RobotModel, names: Sequence[str], base_dir: Path | None
) -> SegmentLimits:
    """Return the maximum contact speeds of a robot with ``contact: allowed`` for these segments."""
    assert model.contact is not None  # the robot would not have been loaded
    table = load_table(settings.contact.table, base_dir)
    return SegmentLimits.of(table, names, model.effective_kg, model.contact.area_cm2)


def fixtures_of(settings: RiskSettings, robot: RobotSettings) -> list[Fixture]:
    """Return the configured fixtures, or the table on which the robot stands."""
    if robot.room_from_robot is None:
        raise ConfigError(
            f"risk.mode hybrid: the base of robot {robot.name} moves, so the objects against which "
            "it may clamp people are unknown; remove its 'contact: allowed'"
        )
    matrix = robot.room_from_robot.matrix()
    if settings.contact.fixtures is not None:
        return list(settings.contact.fixtures)
    if matrix[2, 2] < _UPRIGHT:
        raise ConfigError(
            f"risk.contact.fixtures: robot {robot.name} is not mounted upright, so the objects "
            "against which it may clamp people are unknown; list its fixtures ([] if there are "
            "none)"
        )
    return [floor(float(matrix[2, 3]), f"table of {robot.name}")]
