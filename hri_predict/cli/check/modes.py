"""Notes of ``check`` on operating modes, and on how the node knows where its robots are."""

from collections.abc import Sequence

from hri_predict.robots.model import RobotSettings, StateMotion, TrajectoryMotion


def mode_notes(robot: RobotSettings) -> list[str]:
    """One plain warning for each mode that this robot allows, and one if a file moves it."""
    modes, notes = robot.modes, []
    if isinstance(robot.motion, TrajectoryMotion):
        notes.append(
            f"robot {robot.name}: motion.kind trajectory: the file says where it is, regardless "
            "of the advice; a robot that obeys the advice is soon elsewhere (unknown, if its "
            "controller sends RobotState; a danger, if not): set motion: {kind: state} for it"
        )
    if modes.teach is not None:
        notes.append(
            f"robot {robot.name}: TEACH is allowed: in manual mode, while the enabling device is "
            f"held, people and zones do not stop it, up to {modes.teach.speed_m_s:g} m/s; the "
            "enabling device must also be wired to the robot's own safety controller"
        )
    if modes.recovery is not None:
        notes.append(
            f"robot {robot.name}: RECOVERY is allowed: beside people it may go back along its plan "
            f"at up to {modes.recovery.speed_m_s:g} m/s, while no link comes nearer to a person"
        )
    if modes.muting is not None:
        limit = modes.muting.speed_m_s or robot.max_speed_m_s
        notes.append(
            f"robot {robot.name}: MUTING is allowed: for up to {modes.muting.max_s:g} s no person "
            f"stops it, at up to {min(limit, robot.max_speed_m_s):g} m/s; that time recovers in "
            f"{modes.muting.recovery_s:g} s without a request, so people may be ignored for "
            f"{modes.muting.share:.0%} of the time; they must be protected by other means"
        )
    return notes


def still_note(robots: Sequence[RobotSettings], mode: str) -> list[str]:
    """One note on the robots whose frozen RobotState is believed while they stand.

    In mode ``fixed``, it does not matter where an arm is within its reach.
    """
    believed = [
        robot.name
        for robot in robots
        if isinstance(robot.motion, StateMotion)
        and robot.motion.still_s is None
        and (mode != "fixed" or robot.base is not None)
    ]
    if not believed:
        return []
    return [
        f"{', '.join(believed)}: a RobotState that freezes while the robot stands is not noticed "
        "when the robot moves on; motion.still_s notices it, and also stops a robot that waits "
        "for longer while people are within its reach"
    ]
