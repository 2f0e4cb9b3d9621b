"""Messages of which a test says no more than matters to it."""

from typing import Any

from hri_predict.protocol.messages import Advice, Level, NodeState, RobotMode, RobotState, Status
from hri_predict.protocol.reasons import Reason


def make_advice(level: Level, reason: Reason = Reason.NONE, robot: int = 0, **more: Any) -> Advice:
    """Advice for the first robot, if no other is named."""
    return Advice(robot=robot, level=level, reason=reason, **more)


def make_status(people: int = 0, cycle: int = 1, **more: Any) -> Status:
    """The status of a node that runs, if nothing else is said."""
    running: dict[str, Any] = {"node_state": NodeState.RUNNING, "reason": Reason.NONE}
    return Status(**(running | {"predictor": 0} | more), people=people, cycle=cycle)


def make_state(
    positions: tuple[float, ...],
    velocities: tuple[float, ...] | None = None,
    counter: int = 1,
    robot: int = 0,
    **more: Any,
) -> RobotState:
    """The state of a robot in automatic mode, if no other is said; without velocities it stands."""
    said: dict[str, Any] = {"mode": RobotMode.AUTOMATIC, "robot": robot, "counter": counter}
    said["velocities"] = (0.0,) * len(positions) if velocities is None else velocities
    return RobotState(positions=positions, **(said | more))
