"""Check that every part of a robot backing out along its plan recedes from all people.

Recovery must know the direction before the robot moves. Measured velocities show it only above
``DIRECTED_M_S``, the maximum speed in recovery, and a robot at rest has no direction. A robot that
crept until its direction is visible could creep towards a person. So only one direction is
accepted: back along its plan, from its present joint positions.
"""

from hri_predict.risk.robot_constants import RobotConstants
from hri_predict.risk.separation.receding import link_distances
from hri_predict.robots.motion import RobotMotion
from hri_predict.robots.tracker import RobotNow
from hri_predict.zones.body_zones import BodyZones

FORWARDS_M_S = 0.03
"""Maximum forward speed of a robot that backs out; lower speeds may be noise, see ``DIRECTED_M_S``.
"""
NEARER_M = 0.001
"""Maximum approach that is ignored: two steps of the wire (0.25 mrad) at a tip 2 m away."""
STEPS = 16
"""Number of positions on the way back at which distances are compared."""


def why_not_backing_out(
    robot: RobotConstants, now: RobotNow, motion: RobotMotion, bodies: BodyZones
) -> str:
    """Return why the robot would not recede from all people until it stops; "" if it would.

    Args:
        robot: the robot; refused without ``modes.recovery`` or a plan.
        now: state of the robot.
        motion: its motion.
        bodies: all people, as captured.
    """
    recovery = robot.robot.modes.recovery
    if recovery is None or robot.plan is None or now.place_s is None:
        return "its position on its plan is not known"
    if bodies.lost.any():
        return "a person is lost"
    if bodies.speeds.unknown.any():
        return "the speed of a person is not known yet"
    forwards_m_s = robot.plan.forwards_m_s(now.place_s, motion.qd)
    if not forwards_m_s <= FORWARDS_M_S:
        return "it does not move backwards"
    stops_s = robot.model.stopping(recovery.speed_m_s)[0]
    moves_s = robot.reaction_s(bodies.age_s) + stops_s
    places = robot.plan.back_from(now.place_s, recovery.speed_m_s, moves_s, STEPS)
    way = robot.model.capsules(robot.plan.trajectory.at(places)[0])
    distance = link_distances(bodies.captured, way)  # of all places within the stated error
    inexact = [p for p in range(distance.shape[-1]) if bodies.error_m(p) > 0]
    if not (distance[0][:, inexact] > 0).all():
        return "the position of a person near it is not known well enough"
    if not (distance >= distance[0] - NEARER_M).all():
        return "a link would move closer to a person on the way back"
    return ""
