"""Read the joints from a RobotState, a moving base's coordinates first, or refuse it."""

import math

from hri_predict.protocol.messages import RobotState
from hri_predict.protocol.reasons import Reason
from hri_predict.robots.model import RobotModel
from hri_predict.robots.settings import POSITION_TOLERANCE

VELOCITY_TOLERANCE = 0.1
"""Maximum excess of a reported velocity over a limit, as a fraction of the limit: a servo
overshoots for a moment."""
Joints = tuple[tuple[float, ...], tuple[float, ...]]
"""Positions and velocities, the base's first."""


class StateReader:
    """Reads the states of one robot.

    Args:
        model: the robot.
    """

    def __init__(self, model: RobotModel) -> None:
        self._model = model
        self._yaw: dict[str, float] = {}  # by link: of the base, without jumps of a full turn
        self._bounds = list(
            zip(
                (model.position_min - POSITION_TOLERANCE).tolist(),
                (model.position_max + POSITION_TOLERANCE).tolist(),
                strict=True,
            )
        )
        self._fastest = (model.velocity_max * (1 + VELOCITY_TOLERANCE)).tolist()

    def joints(self, state: RobotState, link: str) -> Joints | Reason:
        """Return positions and velocities including the base's, or why the state is refused.

        All values must be present and finite, and positions within their limits.
        """
        joints, base = self._model.reported, state.base
        if len(state.positions) != joints or len(state.velocities) != joints:
            return Reason.ROBOT_STATE_INVALID
        q, qd = state.positions, state.velocities
        if self._model.mobile is not None:
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

    def is_possible(self, qd: tuple[float, ...]) -> bool:
        """Return whether all velocities are within their limits."""
        if not all(-most <= v <= most for v, most in zip(qd, self._fastest, strict=True)):
            return False
        return self._model.mobile is None or math.hypot(qd[0], qd[1]) <= self._fastest[0]

    def _unwound(self, q: tuple[float, ...], link: str) -> tuple[float, ...]:
        """Return the same with the base's yaw unwrapped to that of the link's previous state."""
        turns = round((self._yaw.get(link, q[2]) - q[2]) / (2 * math.pi))
        self._yaw[link] = q[2] + 2 * math.pi * turns
        return *q[:2], self._yaw[link], *q[3:]
