"""Arms as a configuration names them."""

from typing import Any

from hri_predict.base.settings import Pose
from hri_predict.robots.model import RobotSettings


def arm_settings(model: str = "ur5e", **more: Any) -> RobotSettings:
    """An arm in the origin of the room, which may be as fast as 1 m/s, unless told otherwise."""
    plain: dict[str, Any] = {"name": "arm", "room_from_robot": Pose(), "max_speed_m_s": 1.0}
    return RobotSettings(model=model, **(plain | more))
