"""The reasons for an advice: what is wrong, and what clears it.

The numbers are on the wire: never reuse one.
"""

from enum import IntEnum


class Reason(IntEnum):
    """Reason of an advice; most reasons are also conditions in Status."""

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
    SPEED_UNKNOWN = 10
    CONTACT_POSSIBLE = 11
    NO_INPUT = 20
    INPUT_STALE = 21
    INPUT_FROZEN = 22
    INPUT_IMPOSSIBLE = 23
    SOURCE_BLIND = 24
    CLOCK_JUMP = 25
    ROOM_NOT_SEEN_EMPTY = 26
    TOO_MANY_PEOPLE = 27
    PERSON_NOT_LOCATED = 28
    BODY_NOT_UPRIGHT = 29
    ROBOT_STATE_STALE = 30
    ROBOT_NOT_AUTOMATIC = 31
    ROBOT_STATE_INVALID = 32
    ROBOT_VELOCITY_WRONG = 33
    ROBOT_STATE_JUMPED = 34
    ROBOT_TOO_FAST = 35
    ROBOT_STOPS_LATE = 36
    ROBOT_BASE_UNKNOWN = 37
    ROBOT_STATE_FROZEN = 38
    ROBOT_STATES_CONTRADICT = 39
    PREDICTOR_FAILED = 40
    PREDICTOR_LATE = 41
    NODE_FAULT = 42
    SHADOW_MODE = 43
    STARTING = 44
    STOPPING = 45
    HORIZON_TOO_SHORT = 46
    ZONES_WIDENED = 47
    MOTION_UNLIKE = 48
    SECOND_SENDER = 49
    CLOCK_DRIFT = 50
    CALIBRATION_DRIFT = 51
    LOAD_SHED = 52
    ACKNOWLEDGE_REPEATED = 53
    STATE_UNTRUSTED = 54
    INPUT_REPEATS = 55
    INPUT_RELATIVE = 56
    TEACH = 60
    RECOVERY = 61
    MUTED = 62

    @property
    def text(self) -> str:
        """What is wrong, for a person."""
        return _TEXT[self][0]

    @property
    def clears_when(self) -> str:
        """What clears it, for a person; "" for NONE."""
        return _TEXT[self][1]


CLEARED = "what stopped it has cleared"
"""In an advice's detail: new captures must still confirm it."""
RISING = "it may move again, at first slowly"
"""In an advice's detail: no person holds it back, and its limit has not risen as far as it may."""

_TEXT = {
    Reason.NONE: ("nothing is near", ""),
    Reason.PERSON_NEAR: (
        "a person is too close",
        "the person is farther away: the separation exceeds its limit by risk.band_m",
    ),
    Reason.PERSON_APPROACHING: (
        "a person may get too close before the robot stops",
        "the person is farther away: the predicted separation exceeds its limit by risk.band_m",
    ),
    Reason.ZONE_OCCUPIED: ("a person is in a named zone", "the zone is seen empty"),
    Reason.ZONE_ENTRY_PREDICTED: (
        "a person is about to enter a named zone",
        "no person is predicted to enter it",
    ),
    Reason.OUT_OF_VIEW: (
        "the robot can reach a place outside the field of view",
        "the robot moves back into view, or source.field_of_view is extended",
    ),
    Reason.PERSON_LOST: (
        "a person vanished and may still be here",
        "the person is seen again or seen not to be there, or an Acknowledge of the advised latch "
        "id arrives",
    ),
    Reason.LATCHED: (
        "motion must wait for an acknowledgement",
        "its cause clears, and then an Acknowledge of the advised latch id arrives",
    ),
    Reason.RELEASE_PENDING: (
        "the robot is released step by step",
        "new captures confirm it, and the speed limit has risen to what people allow",
    ),
    Reason.PERSON_FAST: (
        "a person moves faster than the standard assumes",
        "the person slows down",
    ),
    Reason.SPEED_UNKNOWN: (
        "the person's speed is not known yet; physical limits are used",
        "the person's joints are seen for long enough",
    ),
    Reason.CONTACT_POSSIBLE: (
        "the robot may touch a person; the speed limit is what that part of the body bears",
        "the person is farther away: the separation exceeds its limit by risk.band_m",
    ),
    Reason.NO_INPUT: ("no scene received yet", "the source delivers scenes"),
    Reason.INPUT_STALE: ("the newest scene is too old", "fresh scenes arrive"),
    Reason.INPUT_FROZEN: ("the source repeats the same data", "the source's data change again"),
    Reason.INPUT_REPEATS: (
        "a body moves as a tracker makes it up: it froze in a step, glides without a change of "
        "shape, or repeats what it did",
        "the body's limbs move again as a person's do",
    ),
    Reason.INPUT_RELATIVE: (
        "coordinates are relative to the hips: no person's place is known",
        "the source sends positions in the room",
    ),
    Reason.INPUT_IMPOSSIBLE: (
        "a body moves impossibly fast, is not of human size (check the units), has joints that are "
        "not numbers, shares its id, or is only in scenes that do not advance",
        "plausible captures arrive",
    ),
    Reason.SOURCE_BLIND: (
        "the source reports that it cannot see the room",
        "the source sees the room again",
    ),
    Reason.CLOCK_JUMP: ("the source's clock jumped", "the clock runs evenly again"),
    Reason.ROOM_NOT_SEEN_EMPTY: (
        "a person vanished whom the node did not track or could not keep, or it is unknown who "
        "did: a person may be anywhere",
        "an Acknowledge of the advised latch id arrives",
    ),
    Reason.TOO_MANY_PEOPLE: (
        "more people are present than the node can follow",
        "the node can follow all people again, or people.max_people is raised",
    ),
    Reason.PERSON_NOT_LOCATED: (
        "a person is present, but their position is unknown",
        "the source sees a joint of that person that the joint map uses",
    ),
    Reason.BODY_NOT_UPRIGHT: (
        "a body lies in the air, is upside down or mirrored, or is not on the floor or in view "
        "(check the axes)",
        "bodies are seen as people stand, sit or lie on the floor",
    ),
    Reason.ROBOT_STATE_STALE: (
        "no fresh RobotState: the robot's position is unknown",
        "the controller sends RobotState again",
    ),
    Reason.ROBOT_NOT_AUTOMATIC: (
        "the robot is not in automatic mode",
        "the controller reports automatic mode",
    ),
    Reason.ROBOT_STATE_INVALID: (
        "RobotState is outside the robot's or its base's limits, reports a base that is configured "
        "to stand, or its counter does not count",
        "the controller reports joints and base within their limits, and its counter advances by 1",
    ),
    Reason.ROBOT_VELOCITY_WRONG: (
        "the velocities in RobotState do not match how its positions change",
        "the controller reports velocities, in rad/s or m/s, that match its positions",
    ),
    Reason.ROBOT_STATE_JUMPED: (
        "the positions in RobotState changed faster than the robot can move",
        "the controller reports positions that follow from each other",
    ),
    Reason.ROBOT_TOO_FAST: (
        "the robot is faster than it was advised, after the time in which it should have obeyed",
        "the robot keeps to the advised speed limit for 10 s",
    ),
    Reason.ROBOT_STOPS_LATE: (
        "the robot needed more way or time to stop than its stopping table says",
        "the stopping table is corrected and the node is started again",
    ),
    Reason.ROBOT_BASE_UNKNOWN: (
        "RobotState does not say where the robot's moving base is",
        "the controller reports the base's pose and velocity",
    ),
    Reason.ROBOT_STATE_FROZEN: (
        "RobotState repeats an old place: it reports motion, but no new place, a stop that is "
        "impossible, or none of the motion that is permitted",
        "the positions in RobotState change again, or the controller is started again",
    ),
    Reason.ROBOT_STATES_CONTRADICT: (
        "two RobotStates, or RobotState and the configured trajectory, put the robot in different "
        "places",
        "all of them have agreed for 3 s",
    ),
    Reason.PREDICTOR_FAILED: (
        "the predictor failed; physical limits are used instead",
        "the predictor succeeds again",
    ),
    Reason.PREDICTOR_LATE: (
        "the predictor was late; physical limits are used instead",
        "the predictor is on time again",
    ),
    Reason.NODE_FAULT: (
        "the node itself failed",
        "the node is restarted (its log says why)",
    ),
    Reason.SHADOW_MODE: ("shadow mode: the node gives no advice", "the node runs without --shadow"),
    Reason.STARTING: ("the node is starting", "the node has started"),
    Reason.STOPPING: ("the node is stopping", "the node is started again"),
    Reason.HORIZON_TOO_SHORT: (
        "the delay is longer than the forecast's horizon",
        "the delay falls, or predictor.horizon_s is raised",
    ),
    Reason.ZONES_WIDENED: (
        "forecast errors exceed the calibration; zones are widened",
        "forecast errors stay within the calibration for long enough",
    ),
    Reason.MOTION_UNLIKE: (
        "a motion is unlike the calibration data; physical limits are used instead",
        "motion resembles the calibration data for long enough",
    ),
    Reason.CALIBRATION_DRIFT: (
        "for minutes forecasts missed more often than the calibration states",
        "forecasts hold as stated for about an hour with people, or the node runs with a "
        "calibration of this site",
    ),
    Reason.LOAD_SHED: (
        "the node's cycles take too long: poses, and then zones, are not sent; the advice is whole",
        "cycles have been short enough for at least 5 s",
    ),
    Reason.ACKNOWLEDGE_REPEATED: (
        "Acknowledges come again and again, from a button that is held down or from a controller "
        "that acknowledges by itself: none of them counts",
        "no Acknowledge has come for 12 s; then one press counts again",
    ),
    Reason.STATE_UNTRUSTED: (
        "the state file is missing, damaged, old or of another cell, or cannot be written: what "
        "was latched and who was lost may be forgotten",
        "an Acknowledge of the advised latch id arrives, and the state file can be written",
    ),
    Reason.SECOND_SENDER: (
        "another sender uses this node's ids",
        "the other sender is switched off, or gets ids of its own",
    ),
    Reason.TEACH: (
        "teach mode: reduced speed while the enabling device is held",
        "the enabling device is let go, or the request is released",
    ),
    Reason.RECOVERY: (
        "recovery: the robot may back out slowly along its path, away from all people",
        "the robot is out of people's way, or the request is released",
    ),
    Reason.MUTED: (
        "muted: people do not stop the robot",
        "the request is released, or the configured time is over",
    ),
    Reason.CLOCK_DRIFT: (
        "all scenes arrive later than a clock's drift explains: they are delayed, or the source's "
        "clock was set back",
        "scenes arrive as early as before, or the cause is mended and the node is started again",
    ),
}
