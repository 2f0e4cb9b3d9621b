"""Converts the state that the controller reports to a RobotState."""

import math

from hri_drivers.links.rtde.packets import Recipe
from hri_predict.protocol.messages import RobotMode, RobotState

JOINTS = 6
OUTPUTS = Recipe(
    names=(
        "timestamp",
        "actual_q",
        "actual_qd",
        "robot_mode",
        "safety_mode",
        "runtime_state",
    ),
    types=("DOUBLE", "VECTOR6D", "VECTOR6D", "INT32", "INT32", "UINT32"),
)
_LAYOUT = OUTPUTS.layout
COUNTERS = 1 << 16

# robot_mode
_POWER_OFF, _POWER_ON, _IDLE, _BACKDRIVE, _RUNNING = 3, 4, 5, 6, 7
# safety_mode
_NORMAL, _REDUCED, _RECOVERY = 1, 2, 4
# runtime_state
_STOPPING, _PLAYING, _PAUSING, _PAUSED, _RESUMING = 0, 2, 3, 4, 5
_IN_PROGRAM = frozenset((_STOPPING, _PLAYING, _PAUSING, _PAUSED, _RESUMING))


def mode_of(robot_mode: int, safety_mode: int, runtime_state: int) -> RobotMode:
    """Return the operating mode; only a robot that is moved by its program is *automatic*.

    A protective, safeguard or emergency stop, a fault and all other states are *unknown*: the node
    has no better mode for them, and the robot is stopped.
    """
    if robot_mode in (_POWER_OFF, _POWER_ON, _IDLE):
        return RobotMode.DRIVES_OFF
    if robot_mode == _BACKDRIVE or safety_mode == _RECOVERY:
        return RobotMode.MANUAL
    if robot_mode != _RUNNING or safety_mode not in (_NORMAL, _REDUCED):
        return RobotMode.UNKNOWN
    return RobotMode.AUTOMATIC if runtime_state in _IN_PROGRAM else RobotMode.MANUAL


class StateReader:
    """Makes RobotStates from data packages; the counter advances with the controller's time stamp.

    If the stamp stops or goes back, the counter is repeated, so that the node detects a controller
    that hangs or repeats old states.
    """

    def __init__(self) -> None:
        self._counter = 0
        self._stamp = -math.inf

    def restart(self) -> None:
        """Start a new connection: a restarted controller counts its time from 0."""
        self._stamp = -math.inf

    def read(self, robot: int, data: bytes) -> RobotState | None:
        """Return the state of a data package; ``None`` if it is not one of ``OUTPUTS``.

        Positions and velocities that are not numbers are passed on; the node refuses them and names
        the joint.
        """
        if len(data) != _LAYOUT.size:
            return None
        stamp, *values = _LAYOUT.unpack(data)
        if not math.isfinite(stamp):
            return None
        if stamp > self._stamp:
            self._stamp = stamp
            self._counter = (self._counter + 1) % COUNTERS
        robot_mode, safety_mode, runtime_state = values[2 * JOINTS :]
        return RobotState(
            robot=robot,
            mode=mode_of(robot_mode, safety_mode, runtime_state),
            counter=self._counter,
            positions=tuple(values[:JOINTS]),
            velocities=tuple(values[JOINTS : 2 * JOINTS]),
        )
