"""Text of the cause of a robot's advice, and of the condition that ends it."""

from hri_predict.protocol.messages import Level
from hri_predict.protocol.reasons import CLEARED, RISING, Reason
from hri_predict.risk.levels.machine import Advised
from hri_predict.risk.robot_constants import RobotConstants
from hri_predict.risk.separation.stage import RobotFindings
from hri_predict.risk.settings import RiskSettings
from hri_predict.robots.model import StateMotion


def why_and_until(
    robot: RobotConstants, found: RobotFindings, advised: Advised, reason: Reason
) -> tuple[str, str]:
    """Why the robot is stopped or slow, and the condition that ends this."""
    special = _released(advised, robot.risk) or _unproven(robot, found, reason)
    return special or (reason.text, reason.clears_when)


def _released(advised: Advised, risk: RiskSettings) -> tuple[str, str] | None:
    """Return why a robot that may move again, now or soon, still waits, and what ends this."""
    if advised.reason is not Reason.RELEASE_PENDING:
        return None
    if advised.level is not Level.SLOW:
        confirm = f"{risk.release_captures} new captures in a row confirm it"
        is_warning = advised.level is Level.WARN
        cleared = "the cause of the warning has cleared" if is_warning else CLEARED
        return f"waiting to release: {cleared}", confirm
    return (
        f"{RISING}: the speed limit rises by {risk.speed_rise_m_s2:g} m/s each second",
        "it has risen to the value that people allow",
    )


def _unproven(
    robot: RobotConstants, found: RobotFindings, reason: Reason
) -> tuple[str, str] | None:
    """Return, as text, why a robot is judged for all possible positions, and what ends this."""
    motion = robot.robot.motion
    if found.wherever is None or reason is not Reason.ROBOT_STATE_FROZEN:
        return None
    assert isinstance(motion, StateMotion)  # no other is doubted
    far = "gone" if robot.model.base is None else f"over {robot.anywhere_m:.2f} m from its base"
    return (
        f"RobotState has not changed for {motion.still_s:g} s during which the robot was free to "
        "move: its position is not certain",
        f"a joint's position changes, or all people are {far}",
    )
