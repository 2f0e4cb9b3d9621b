"""Effect of the zones over time on each robot; distances of all robots are computed together."""

from collections.abc import Sequence
from dataclasses import dataclass

from hri_predict.risk.separation.in_time import TimeByTime
from hri_predict.risk.separation.nearest import BodiesInTime, Courses, NearestInTime
from hri_predict.risk.terms import Finding
from hri_predict.robots.motion import RobotMotion


@dataclass(frozen=True, slots=True, eq=False)
class Outlook:
    """Effect of the zones over time on one robot.

    Attributes:
        standing: (K+1,) distances to the robot at its present position; entry 0 as captured.
        finding: result of the comparison at each time.
    """

    standing: NearestInTime
    finding: Finding


def outlooks(
    motions: Sequence[RobotMotion], judging: Sequence[TimeByTime], bodies: BodiesInTime
) -> list[Outlook]:
    """Return the outlooks of one or more robots, computed in two searches.

    The first search uses the present positions of all robots. The second uses the continued motion
    of those that are limited in some direction. A search for two robots takes about as long as for
    one.
    """
    standing = bodies.standing([m.capsules for m in motions], [len(m.times_s) for m in motions])
    later = [near[1:] for near in standing]  # without the bodies as captured
    ways = [
        each.any_way(near, motion.is_foreseen)
        for each, near, motion in zip(judging, later, motions, strict=True)
    ]
    tried = [robot for robot, way in enumerate(ways) if len(way.speeds_m_s)]
    courses = [
        Courses(*motions[robot].stopping_at(ways[robot].speeds_m_s), ways[robot].enough_m)
        for robot in tried
    ]
    ahead = dict(zip(tried, bodies.least(courses), strict=True)) if tried else {}
    findings = [
        each.finding(float(near.distance[0]), later[robot], ways[robot], ahead.get(robot))
        for robot, (each, near) in enumerate(zip(judging, standing, strict=True))
    ]
    return [Outlook(*each) for each in zip(standing, findings, strict=True)]
