"""A UR5e on a vehicle, and what its controller says."""

import math
from typing import Any

from hri_predict.protocol.messages import BaseMotion, RobotMode, RobotState
from hri_predict.robots.settings import RobotSettings

BASE: dict[str, Any] = {
    "kind": "state",
    "base_from_robot": {"xyz": [0.2, 0.0, 0.5]},
    "capsules": [{"name": "body", "a": [-0.2, 0, 0.3], "b": [0.3, 0, 0.3], "radius": 0.3}],
    "max_speed_m_s": 1.0,
    "max_turn_rad_s": 0.8,
    "acceleration_m_s2": 1.5,
    "uncertainty_m": 0.02,
    "uncertainty_rad": 0.01,
    "stopping": {
        "source": "made up",
        "speed_m_s": [0.25, 1.0, 2.0],
        "rows": [{"payload_kg": 50, "time_s": [0.3, 0.9, 1.6], "distance_m": [0.05, 0.5, 1.8]}],
    },
}
Q = (0.1, -1.2, 1.5, -1.8, -1.5, 0.2)


def settings_of(**more: Any) -> RobotSettings:
    """Its entry in the configuration; ``base``: changes of the base's."""
    base = {**BASE, **more.pop("base", {})}
    data = {"name": "amr", "model": "ur5e", "max_speed_m_s": 1.5, "base": base}
    return RobotSettings.model_validate({**data, **more})


def standing(x_m: float = 0.0, y_m: float = 0.0, yaw_rad: float = 0.0) -> BaseMotion:
    """A base that stands there."""
    return moving(x_m, y_m, yaw_rad)


def moving(
    x_m: float = 0.0,
    y_m: float = 0.0,
    yaw_rad: float = 0.0,
    vx: float = 0.0,
    vy: float = 0.0,
    turn: float = 0.0,
) -> BaseMotion:
    """A base that moves."""
    return BaseMotion(x_m=x_m, y_m=y_m, yaw_rad=yaw_rad, vx_m_s=vx, vy_m_s=vy, yaw_rate_rad_s=turn)


def state(counter: int, base: BaseMotion | None, **more: Any) -> RobotState:
    """The arm stands; the base is there."""
    data = {"positions": Q, "velocities": (0.0,) * 6, "mode": RobotMode.AUTOMATIC, **more}
    return RobotState(robot=0, counter=counter, base=base, **data)


NOWHERE = {
    "NaN": moving(x_m=math.nan),
    "infinite": moving(y_m=math.inf),
    "not available": moving(vx=None),  # type: ignore[arg-type]
    "too fast": moving(vx=0.9, vy=0.9),
    "turns too fast": moving(turn=1.0),
    "out of this world": moving(x_m=2000.0),
}
