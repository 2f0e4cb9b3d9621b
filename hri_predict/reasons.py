"""Why the advice is what it is, and what would clear it.

The numbers are on the wire: never reuse one.
"""

from enum import IntEnum


class Reason(IntEnum):
    """Reason of an advice, most of them also a condition in Status."""

    NONE = 0
    PERSON_NEAR = 1
    PERSON_APPROACHING = 2
    ZONE_OCCUPIED = 3
    ZONE_ENTRY_PREDICTED = 4
    OUT_OF_VIEW = 5
    PERSON_LOST = 6
    LATCHED = 7
    RELEASE_PENDING = 8
    PERSON_FAST = 9
    NO_INPUT = 20
    INPUT_STALE = 21
    INPUT_FROZEN = 22
    INPUT_IMPOSSIBLE = 23
    SOURCE_BLIND = 24
    CLOCK_JUMP = 25
    ROOM_NOT_SEEN_EMPTY = 26
    TOO_MANY_PEOPLE = 27
    PERSON_NOT_LOCATED = 28
    ROBOT_STATE_STALE = 30
    ROBOT_NOT_AUTOMATIC = 31
    ROBOT_STATE_INVALID = 32
    PREDICTOR_FAILED = 40
    PREDICTOR_LATE = 41
    NODE_FAULT = 42
    SHADOW_MODE = 43
    STARTING = 44
    STOPPING = 45
    HORIZON_TOO_SHORT = 46
    ZONES_WIDENED = 47
    MOTION_UNLIKE = 48

    @property
    def text(self) -> str:
        """What is the matter, for a person."""
        return _TEXT[self][0]

    @property
    def clears_when(self) -> str:
        """What would clear it, for a person."""
        return _TEXT[self][1]


_TEXT = {
    Reason.NONE: ("nothing near", "nothing needs to clear"),
    Reason.PERSON_NEAR: ("a person is too near", "the person moves away beyond the band"),
    Reason.PERSON_APPROACHING: (
        "a person may come too near before the robot has stopped",
        "the predicted separation grows beyond the band",
    ),
    Reason.ZONE_OCCUPIED: ("a person is in a named zone", "the zone is seen empty"),
    Reason.ZONE_ENTRY_PREDICTED: (
        "a person is about to enter a named zone",
        "nobody is predicted to enter it",
    ),
    Reason.OUT_OF_VIEW: (
        "the robot can reach a place that the sensor does not see",
        "the robot moves back into view, or the field of view is extended",
    ),
    Reason.PERSON_LOST: (
        "a person vanished and may still be here",
        "the person is seen again, or the lost zone's time runs out (then: seen empty)",
    ),
    Reason.LATCHED: (
        "a stop is latched",
        "it is acknowledged by its latch id, after its cause has cleared",
    ),
    Reason.RELEASE_PENDING: (
        "the cause has cleared, waiting for more captures",
        "further distinct captures agree",
    ),
    Reason.PERSON_FAST: (
        "a person is faster than the standard assumes of people",
        "the person slows down",
    ),
    Reason.NO_INPUT: ("no scene was received yet", "the source delivers"),
    Reason.INPUT_STALE: ("the newest scene is too old", "fresh scenes arrive"),
    Reason.INPUT_FROZEN: ("the source repeats itself", "the source's data change again"),
    Reason.INPUT_IMPOSSIBLE: (
        "a body moved as no body can, is of no human size (units?), or its joints are not numbers",
        "plausible captures arrive",
    ),
    Reason.SOURCE_BLIND: ("the source says that it does not see the room", "it sees the room"),
    Reason.CLOCK_JUMP: ("the source's clock jumped", "the clock runs evenly again"),
    Reason.ROOM_NOT_SEEN_EMPTY: (
        "a person vanished, and the room was not seen empty since",
        "the room is seen empty for long enough, or Acknowledge",
    ),
    Reason.TOO_MANY_PEOPLE: (
        "more people are here than the node can follow",
        "fewer people are here, or people.max_people is raised",
    ),
    Reason.PERSON_NOT_LOCATED: (
        "somebody is here, and where is not known",
        "the source sees a joint of that person that the joint map uses",
    ),
    Reason.ROBOT_STATE_STALE: (
        "no fresh RobotState, so where the robot is is not known",
        "the controller sends RobotState again",
    ),
    Reason.ROBOT_NOT_AUTOMATIC: (
        "the robot is not in automatic mode",
        "the controller reports automatic mode",
    ),
    Reason.ROBOT_STATE_INVALID: (
        "RobotState is outside the robot's limits",
        "the controller reports joints within the robot's limits",
    ),
    Reason.PREDICTOR_FAILED: (
        "the predictor failed; physical limits are used instead",
        "the predictor succeeds again",
    ),
    Reason.PREDICTOR_LATE: (
        "the predictor was late; physical limits are used instead",
        "the predictor is in time again",
    ),
    Reason.NODE_FAULT: ("the node itself failed", "the node is restarted (its log says why)"),
    Reason.SHADOW_MODE: ("shadow mode: nothing is advised", "the node runs without --shadow"),
    Reason.STARTING: ("the node is starting", "the node has started"),
    Reason.STOPPING: ("the node is stopping", "the node is started again"),
    Reason.HORIZON_TOO_SHORT: (
        "the delay now exceeds the forecast's horizon",
        "the delay falls, or predictor.horizon_s is raised",
    ),
    Reason.ZONES_WIDENED: (
        "forecasts erred more than calibrated; zones are widened",
        "forecasts were as good as calibrated for long enough",
    ),
    Reason.MOTION_UNLIKE: (
        "a motion is unlike all that was calibrated; physical limits are used instead",
        "the motion is like the calibrated ones for long enough",
    ),
}
