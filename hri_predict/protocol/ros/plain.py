"""Convert Advice, Status, Zone and Pose to plain ROS 2 messages, without rclpy.

None of these messages is protected end to end. Only ``frames`` is
(``hri_drivers.links.ros2.codec``).
"""

import json
import math
import time
from collections.abc import Callable
from typing import Any, NamedTuple

from hri_predict.protocol.messages import Advice, Level, Message, NodeState, Pose, Status, Zone
from hri_predict.protocol.reasons import Reason
from hri_predict.protocol.ros import cdr
from hri_predict.protocol.ros.markers import pose_markers, zone_markers

DIAGNOSTICS_NS = 1_000_000_000
"""Interval of ``/diagnostics`` while nothing changes (REP-107: at least once a second)."""
OK, WARNING, ERROR, STALE = range(4)
"""Levels of ``diagnostic_msgs/DiagnosticStatus``."""

_SEVERITY = {
    Level.CLEAR: OK,
    Level.WARN: WARNING,
    Level.SLOW: WARNING,
    Level.STOP: ERROR,
    Level.FAULT: ERROR,
    Level.UNKNOWN: STALE,
}
_OF_NODE = {NodeState.RUNNING: OK, NodeState.FAULT: ERROR, NodeState.UNKNOWN: STALE}


class Sample(NamedTuple):
    """A serialised message and its topic, relative to the link's namespace or absolute."""

    topic: str
    data: bytes


def speed_fraction(advice: Advice, full_speed_m_s: float) -> float:
    """Return the permitted fraction of full speed, 0 to 1.

    0 at each level at which the robot may not move, and without a valid limit.
    """
    limit = advice.speed_limit_m_s
    if not advice.level.may_move or limit is None or not 0.0 < limit < math.inf:
        return 0.0
    return min(1.0, limit / full_speed_m_s)


def percent(fraction: float) -> int:
    """Return a fraction as a whole percentage, rounded down."""
    return min(100, max(0, math.floor(100.0 * fraction)))


def rounded(
    value: float | None, to: Callable[[float], int] = math.floor, steps: float = 1e4
) -> float | None:
    """Return a value rounded to a multiple of 1 / ``steps``, for JSON; ``None`` is "not available".

    ``to`` is the safe direction: ``math.floor`` for distances and limits, ``math.ceil`` for ages.
    If floating-point error would round in the wrong direction, the value is not changed.
    """
    if value is None or not math.isfinite(value):
        return None
    if not math.isfinite(steps * value):
        return value
    found = to(steps * value) / steps
    return (min if to is math.floor else max)(found, value)


def advice_fields(advice: Advice, fraction: float) -> dict[str, Any]:
    """Return the fields of an advice, for JSON: SI units, ``None`` is "not available"."""
    return {
        "robot": advice.robot,
        "level": advice.level.name.lower(),
        "may_move": fraction > 0.0,
        "reason": advice.reason.name,
        "reason_text": advice.reason.text,
        "clears_when": advice.reason.clears_when,
        "speed_fraction": rounded(fraction, steps=1e6),
        "speed_limit_m_s": rounded(advice.speed_limit_m_s) if fraction else 0.0,
        "separation_m": rounded(advice.separation_m),
        "predicted_separation_m": rounded(advice.predicted_separation_m),
        "time_to_breach_s": rounded(advice.time_to_breach_s),
        "age_s": rounded(advice.age_s, math.ceil),
        "latch_id": advice.latch_id,
        "mode": advice.mode.name.lower(),
        "tool": advice.tool,
    }


class PlainMessages:
    """Converts the node's messages to samples; keeps the newest level of each robot.

    Args:
        full_speed_m_s: speed of the robot's fastest point at fraction 1.
        frame_id: the room's frame in ROS.
        wall_ns: returns UTC in nanoseconds.
    """

    def __init__(
        self, full_speed_m_s: float, frame_id: str, wall_ns: Callable[[], int] = time.time_ns
    ) -> None:
        self._full_speed_m_s = full_speed_m_s
        self._frame_id = frame_id
        self._wall_ns = wall_ns
        self._advices: dict[int, Advice] = {}  # the newest of each robot
        self._sent: dict[int, int] = {}  # number of advices sent to each robot
        self._cycle: int | None = None
        self._shown: dict[str, tuple[object, int]] = {}  # on /diagnostics: state and time

    @property
    def level(self) -> Level:
        """The most urgent level of all robots; *unknown* before the first advice."""
        levels = [advice.level for advice in self._advices.values()]
        return max(levels, key=lambda level: level.urgency, default=Level.UNKNOWN)

    def of(self, message: Message) -> list[Sample]:
        """Return the samples of a message, the most urgent first."""
        match message:
            case Advice():
                return self._advice(message)
            case Status():
                self._cycle = message.cycle
                return self._status(message)
            case Zone():
                return [Sample("zones", zone_markers(message, **self._look()))]
            case Pose():
                return self._pose(message)
            case _:
                return []

    def last_words(self) -> list[Sample]:
        """Return the samples that stop every robot advised so far, because the node exits."""
        words: list[Sample] = []
        for robot in list(self._advices):
            words += self._advice(
                Advice(
                    robot=robot, level=Level.UNKNOWN, reason=Reason.STOPPING, speed_limit_m_s=0.0
                )
            )
        return words

    def _look(self) -> dict[str, Any]:
        return {"stamp_ns": self._wall_ns(), "frame_id": self._frame_id, "level": self.level}

    def _advice(self, advice: Advice) -> list[Sample]:
        robot = advice.robot
        self._advices[robot] = advice
        counter = self._sent[robot] = self._sent.get(robot, -1) + 1
        fraction, stamp_ns = speed_fraction(advice, self._full_speed_m_s), self._wall_ns()
        fields = advice_fields(advice, fraction) | {
            "stamp": round(stamp_ns * 1e-9, 6),
            "counter": counter,
            "cycle": self._cycle,
        }
        at = f"robot_{robot}/"
        samples = [
            Sample(at + "speed_fraction", cdr.float64(fraction)),
            Sample(at + "speed_ovr", cdr.int64(percent(fraction))),
            Sample(at + "advice", cdr.string(json.dumps(fields, allow_nan=False))),
        ]
        name = f"hri_predict: robot_{robot}"
        if self._is_due(name, (advice.level, advice.reason), stamp_ns):
            said, severity = f"{fields['level']}: {advice.reason.text}", _SEVERITY[advice.level]
            samples.append(_diagnostics(stamp_ns, name, severity, said=said, fields=fields))
        return samples

    def _status(self, status: Status) -> list[Sample]:
        stamp_ns, name = self._wall_ns(), "hri_predict: node"
        if not self._is_due(name, (status.node_state, status.reason), stamp_ns):
            return []
        severity = _OF_NODE.get(status.node_state, WARNING)
        said = f"{status.node_state.name.lower()}: {status.reason.text}"
        fields = {
            "people": status.people,
            "cycle": status.cycle,
            "age_s": rounded(status.age_s, math.ceil),
        }
        return [_diagnostics(stamp_ns, name, severity, said=said, fields=fields)]

    def _pose(self, pose: Pose) -> list[Sample]:
        look = self._look()
        joints = {joint: (x, y, z) for joint, x, y, z in pose.joints}
        unknown = (math.nan,) * 3
        places = [joints.get(joint, unknown) for joint in range(max(joints, default=-1) + 1)]
        ahead_ns = 1e9 * (pose.horizon_s - (pose.age_s or 0.0))
        when_ns = look["stamp_ns"] + (round(ahead_ns) if math.isfinite(ahead_ns) else 0)
        return [
            Sample("forecast", cdr.pose_array(when_ns, self._frame_id, places)),
            Sample("forecast_markers", pose_markers(pose, **look)),
        ]

    def _is_due(self, name: str, state: object, now_ns: int) -> bool:
        """Return whether a status changed or is due again; if so, record it as sent."""
        before, at_ns = self._shown.get(name, (None, 0))
        if before == state and 0 <= now_ns - at_ns < DIAGNOSTICS_NS:
            return False
        self._shown[name] = (state, now_ns)
        return True


def _diagnostics(
    stamp_ns: int, name: str, severity: int, *, said: str, fields: dict[str, Any]
) -> Sample:
    values = {key: "not available" if v is None else str(v) for key, v in fields.items()}
    data = cdr.diagnostic_array(stamp_ns, name=name, level=severity, message=said, values=values)
    return Sample("/diagnostics", data)
