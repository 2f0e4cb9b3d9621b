"""The reasons for an advice, one row each: the problem, the remedy and the consequences.

The numbers are sent on the wire and must never be reused. Sets of reasons follow from the rows.
"""

from collections.abc import Iterable
from enum import IntEnum, unique
from typing import Any, Self

from hri_predict.protocol.reason_row import Kind, Row


@unique
class Reason(IntEnum):
    """Reason for an advice; most reasons are also conditions in Status."""

    _value_: int
    row: Row

    def __new__(cls, row: Any) -> Self:  # Any, or type checkers refuse ``Reason(number)``
        """Create the member with this number; ``row`` keeps the other properties."""
        member = int.__new__(cls, row.number)
        member._value_ = row.number
        member.row = row
        return member

    # A row takes a few lines, so that the table stays one file.
    # fmt: off
    NONE = Row(0, Kind.NONE,
        "nothing is near",
        "",
        rank=0)
    PERSON_NEAR = Row(1, Kind.PEOPLE,
        "a person is too close",
        "the person is farther away: the separation exceeds its limit by risk.band_m",
        rank=7, short="too close", by_distance=True, in_view=True)
    PERSON_APPROACHING = Row(2, Kind.PEOPLE,
        "a person may get too close before the robot stops",
        "the person is farther away: the predicted separation exceeds its limit by risk.band_m",
        rank=6, short="may get too close", by_distance=True, in_view=True)
    ZONE_OCCUPIED = Row(3, Kind.PEOPLE,
        "a person is in a named zone",
        "the zone is seen to be empty",
        in_view=True)
    ZONE_ENTRY_PREDICTED = Row(4, Kind.PEOPLE,
        "a person is about to enter a named zone",
        "no person is predicted to enter it",
        in_view=True)
    OUT_OF_VIEW = Row(5, Kind.PEOPLE,
        "the robot can reach a place outside the field of view",
        "the robot moves back into view, or source.field_of_view is extended")
    PERSON_LOST = Row(6, Kind.PEOPLE,
        "a person vanished and may still be here",
        "the person is seen again or seen not to be there, or an Acknowledge of the advised "
        "latch id arrives",
        short="lost", by_distance=True)
    LATCHED = Row(7, Kind.WAITING,
        "motion requires an acknowledgement",
        "its cause clears, and then an Acknowledge of the advised latch id arrives")
    RELEASE_PENDING = Row(8, Kind.WAITING,
        "waiting to release: the cause has cleared",
        "new captures confirm it, and the speed limit has risen to the value that people allow",
        rank=4)
    PERSON_FAST = Row(9, Kind.PEOPLE,
        "a person moves faster than ISO 13855 assumes",
        "the person slows down",
        rank=3)
    SPEED_UNKNOWN = Row(10, Kind.PEOPLE,
        "the person's speed is not known yet; physical limits are used",
        "the person's joints have been seen for long enough",
        short="speed unknown", by_distance=True)
    CONTACT_POSSIBLE = Row(11, Kind.PEOPLE,
        "the robot may touch a person; the speed limit is the contact limit of that body part",
        "the person is farther away: the separation exceeds its limit by risk.band_m",
        rank=5, short="contact possible", by_distance=True)
    NO_INPUT = Row(20, Kind.INPUT,
        "no scene received yet",
        "the source delivers scenes")
    INPUT_STALE = Row(21, Kind.INPUT,
        "the newest scene is too old",
        "fresh scenes arrive",
        latches="blind")
    INPUT_FROZEN = Row(22, Kind.INPUT,
        "the source repeats the same data",
        "the source's data change again",
        latches="blind")
    INPUT_IMPOSSIBLE = Row(23, Kind.INPUT,
        "a body moves impossibly fast, is not of human size (check the units), has joints that "
        "are not numbers, shares its id with another body, or appears only in scenes that do not "
        "advance",
        "plausible captures arrive")
    SOURCE_BLIND = Row(24, Kind.INPUT,
        "the source reports that it cannot see the room",
        "the source sees the room again",
        latches="blind")
    CLOCK_JUMP = Row(25, Kind.INPUT,
        "the source's clock has jumped",
        "the clock runs evenly again")
    ROOM_NOT_SEEN_EMPTY = Row(26, Kind.MEMORY,
        "a person vanished whom the node was not tracking or could not remember, or it is "
        "unknown who vanished: a person may be anywhere",
        "an Acknowledge of the advised latch id arrives",
        latches="lost")
    TOO_MANY_PEOPLE = Row(27, Kind.INPUT,
        "more people are present than the node can follow",
        "the node can follow all people again, or people.max_people is raised")
    PERSON_NOT_LOCATED = Row(28, Kind.INPUT,
        "a person is present, but their position is unknown",
        "the source sees a joint of that person that the joint map uses")
    BODY_NOT_UPRIGHT = Row(29, Kind.INPUT,
        "a body lies in the air, is upside down or mirrored, or is not on the floor or not in "
        "view (check the axes)",
        "bodies are standing, sitting or lying on the floor")
    ROBOT_STATE_STALE = Row(30, Kind.ROBOT,
        "no fresh RobotState: the robot's position is unknown",
        "the controller sends RobotState again")
    ROBOT_NOT_AUTOMATIC = Row(31, Kind.ROBOT,
        "the robot is not in automatic mode",
        "the controller reports automatic mode")
    ROBOT_STATE_INVALID = Row(32, Kind.ROBOT,
        "RobotState is outside the limits of the robot or its base, reports a moving base "
        "although it is configured as fixed, or has a counter that does not advance",
        "the controller reports joints and base within their limits, and its counter advances by "
        "1")
    ROBOT_VELOCITY_WRONG = Row(33, Kind.ROBOT,
        "the velocities in RobotState do not match how its positions change",
        "the controller reports velocities, in rad/s or m/s, that match its positions",
        contradicts=True)
    ROBOT_STATE_JUMPED = Row(34, Kind.ROBOT,
        "the positions in RobotState change faster than the robot can move",
        "the controller reports positions that change no faster than the robot can move",
        contradicts=True)
    ROBOT_TOO_FAST = Row(35, Kind.ROBOT,
        "the robot still exceeds the advised speed limit after the time allowed for obeying it",
        "the robot keeps to the advised speed limit for 10 s")
    ROBOT_STOPS_LATE = Row(36, Kind.ROBOT,
        "the robot needed more distance or time to stop than its stopping table states",
        "the stopping table is corrected and the node restarted")
    ROBOT_BASE_UNKNOWN = Row(37, Kind.ROBOT,
        "RobotState does not report the pose of the robot's moving base",
        "the controller reports the base's pose and velocity")
    ROBOT_STATE_FROZEN = Row(38, Kind.ROBOT,
        "RobotState repeats an old position: it reports motion without a new position, an "
        "impossible stop, or no motion although motion is permitted",
        "the positions in RobotState change again, or the controller is restarted",
        contradicts=True)
    ROBOT_STATES_CONTRADICT = Row(39, Kind.ROBOT,
        "two RobotStates, or RobotState and the configured trajectory, report different "
        "positions of the robot",
        "they have all agreed for 3 s",
        contradicts=True)
    PREDICTOR_FAILED = Row(40, Kind.PREDICTOR,
        "the predictor failed; physical limits are used instead",
        "the predictor succeeds again",
        widens_zones=True)
    PREDICTOR_LATE = Row(41, Kind.PREDICTOR,
        "the predictor was late; physical limits are used instead",
        "the predictor answers within half a cycle again (if it often does not, use a cheaper one "
        "or lower rate_hz)",
        widens_zones=True)
    NODE_FAULT = Row(42, Kind.NODE,
        "the node failed",
        "the node is restarted (see its log for the cause)")
    SHADOW_MODE = Row(43, Kind.NODE,
        "shadow mode: the node gives no advice",
        "the node is restarted without --shadow")
    STARTING = Row(44, Kind.RUN,
        "the node is starting",
        "the node has started")
    STOPPING = Row(45, Kind.RUN,
        "the node is stopping",
        "the node is restarted")
    HORIZON_TOO_SHORT = Row(46, Kind.FORECAST,
        "the delay exceeds the forecast horizon",
        "the delay falls, or predictor.horizon_s is raised")
    ZONES_WIDENED = Row(47, Kind.FORECAST,
        "forecast errors exceed the calibration; zones are widened",
        "forecast errors stay within the calibration for long enough",
        rank=1, widens_zones=True, is_trouble=False)
    MOTION_UNLIKE = Row(48, Kind.FORECAST,
        "a motion differs from the calibration data; physical limits are used instead",
        "motion resembles the calibration data for long enough",
        rank=2, widens_zones=True)
    SECOND_SENDER = Row(49, Kind.NODE,
        "another sender uses this node's ids",
        "the other sender is switched off, or is given different ids")
    CLOCK_DRIFT = Row(50, Kind.INPUT,
        "all scenes arrive later than clock drift can explain: they are delayed, or the source's "
        "clock was set back",
        "scenes arrive as early as before, or the cause is fixed and the node restarted")
    CALIBRATION_DRIFT = Row(51, Kind.FORECAST,
        "for several minutes forecasts were wrong more often than the calibration states",
        "forecasts are as reliable as stated for about an hour with people, or the node runs "
        "with a calibration from this site")
    LOAD_SHED = Row(52, Kind.NODE,
        "the node's cycles take too long: poses, and if necessary zones, are not sent; advice is "
        "not affected",
        "cycles have been short enough for at least 5 s")
    ACKNOWLEDGE_REPEATED = Row(53, Kind.NODE,
        "Acknowledges arrive continually, from a button that is held down or a controller that "
        "acknowledges automatically: all are ignored",
        "no Acknowledge has arrived for 12 s; the next press is accepted",
        is_news=True)
    STATE_UNTRUSTED = Row(54, Kind.MEMORY,
        "the state file is missing, damaged, old, from another cell or not writable: latches and "
        "lost people may have been forgotten",
        "an Acknowledge of the advised latch id arrives, and the state file can be written",
        latches="lost", is_news=True)
    INPUT_REPEATS = Row(55, Kind.INPUT,
        "a body moves like a tracker artefact: it froze during a step, glides without changing "
        "shape, or repeats an earlier motion",
        "the body's limbs move like a person's again",
        latches="blind")
    INPUT_RELATIVE = Row(56, Kind.INPUT,
        "coordinates are relative to the hips, so the positions of people are unknown",
        "the source sends positions in room coordinates")
    SENSOR_SILENT = Row(57, Kind.INPUT,
        "one of several sensors is silent: the area that only this sensor covers is not seen",
        "every sensor of the merged source delivers scenes",
        latches="blind")
    SENSORS_DISAGREE = Row(58, Kind.INPUT,
        "two sensors place the same person differently: one was moved, or its registration is "
        "wrong",
        "the sensors have agreed for as long as it took to detect the difference")
    SET_UNKNOWN = Row(59, Kind.NODE,
        "no configured set is chosen: the number is unknown, or the PLC that chose a set is "
        "silent",
        "a PLC chooses a set in risk.sets and keeps renewing its choice",
        is_news=True)
    TEACH = Row(60, Kind.MODE,
        "teach mode: reduced speed while the enabling device is held",
        "the enabling device or the request is released",
        is_trouble=False)
    RECOVERY = Row(61, Kind.MODE,
        "recovery: the robot may back out slowly along its path, away from all people",
        "the robot is clear of all people, or the request is released",
        is_trouble=False)
    MUTED = Row(62, Kind.MODE,
        "muted: people do not stop the robot",
        "the request is released, or the configured time is up")
    SENSOR_MOVED = Row(63, Kind.INPUT,
        "the floor differs from its height in the first minutes: a sensor sank, tilted or was "
        "moved",
        "people stand at the earlier floor height again, or the sensor is registered and the "
        "node restarted")
    # fmt: on

    @property
    def text(self) -> str:
        """The problem, as text for people."""
        return self.row.text

    @property
    def clears_when(self) -> str:
        """The condition that clears it, as text for people; "" for NONE."""
        return self.row.clears_when


def widened_by(reasons: Iterable[Reason]) -> str:
    """Return why zones are larger than usual, as the end of a sentence; "" if they are not."""
    why = [r.text.replace("; ", " and ") for r in dict.fromkeys(reasons) if r.row.widens_zones]
    return f", because {', and '.join(why)}" if why else ""


CLEARED = "what stopped it has cleared"
"""In an advice's detail: new captures must still confirm it."""
RISING = "it may move again, at first slowly"
"""In an advice's detail: no person holds the robot back, and its speed limit is still rising."""
