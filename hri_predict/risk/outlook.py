"""What the zones over time mean for each robot; the distances of all robots are found together."""

from collections.abc import Sequence
from dataclasses import dataclass

from hri_predict.risk.nearest_in_time import BodiesInTime, Courses, NearestInTime
from hri_predict.risk.robot_motion import RobotMotion
from hri_predict.risk.separation import Finding
from hri_predict.risk.separation_in_time import TimeByTime


@dataclass(frozen=True, slots=True, eq=False)
class Outlook:
    """What the zones over time mean for one robot.

    Attributes:
        motion: its.
        standing: (K+1,) who is how near to it where it is now; entry 0 as captured.
        finding: judged time by time.
    """

    motion: RobotMotion
    standing: NearestInTime
    finding: Finding


def outlooks(
    motions: Sequence[RobotMotion], judging: Sequence[TimeByTime], bodies: BodiesInTime
) -> list[Outlook]:
    """The outlooks of several robots (one at least) in two searches.

    First for all of them where they are now, then for those that are not free in any direction as
    they go on: one search for two robots costs about as much as for one.
    """
    standing = bodies.standing([m.capsules for m in motions], [len(m.times_s) for m in motions])
    later = [_later(near) for near in standing]
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
    return [Outlook(*each) for each in zip(motions, standing, findings, strict=True)]


def _later(nearest: NearestInTime) -> NearestInTime:
    """Without entry 0, the bodies as captured."""
    return NearestInTime(
        nearest.distance[..., 1:],
        nearest.person[..., 1:],
        nearest.segment[..., 1:],
        nearest.link[..., 1:],
    )
