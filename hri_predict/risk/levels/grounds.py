"""Grounds of a robot's advice, derived from the findings; for recordings only."""

from collections.abc import Sequence

from hri_predict.base.geometry import capsule_distance
from hri_predict.risk.levels.advice import asked_of
from hri_predict.risk.levels.pair import hidden_ends_of, pair_of
from hri_predict.risk.robot_constants import RobotConstants
from hri_predict.risk.separation.stage import RobotFindings
from hri_predict.risk.settings import RiskSettings
from hri_predict.risk.terms import Finding
from hri_predict.risk.types import Grounds
from hri_predict.zones.body_zones import BodyZones


def grounds_of(
    robots: Sequence[RobotConstants],
    found: Sequence[RobotFindings],
    bodies: BodyZones,
    settings: RiskSettings,
) -> tuple[Grounds, ...]:
    """Return the grounds of each robot's advice."""
    return tuple(
        _of_one(robot, each, bodies, settings) for robot, each in zip(robots, found, strict=True)
    )


def _of_one(
    robot: RobotConstants, found: RobotFindings, bodies: BodyZones, settings: RiskSettings
) -> Grounds:
    """Return the grounds of one robot's advice, from the finding that the advice names.

    This need not be the mildest finding: if none permits motion, the advice names the zones.
    """
    motion = found.motion
    if motion is None:
        return Grounds(unknown=found.unknown)
    _, people = asked_of(robot, found, bodies)
    named = [name for name, finding in found.ways.items() if finding is people]
    way = "" if people is None else named[0] if named else "zones"
    pair = None if people is None else pair_of(people, bodies, motion)
    milder_way, milder = found.mildest
    is_milder = people is not None and milder is not None and milder.slack_m > people.slack_m
    moved_m = motion.clearance_m - settings.clearance_m
    return Grounds(
        speed_m_s=found.speed_m_s,
        capsules=motion.capsules,
        way=way,
        person=None if people is None else bodies.zones.ids[people.person],
        segment="" if people is None else bodies.zones.segments[people.segment],
        link=None if people is None else people.link,
        pair=pair,
        pair_m=None if pair is None else float(capsule_distance(*pair)),
        separation_m=None if people is None else people.separation_m,
        slack_m=None if people is None else people.slack_m,
        milder_way=milder_way if is_milder else "",
        milder_slack_m=milder.slack_m if milder is not None and is_milder else None,
        hidden_ends=0 if people is None else hidden_ends_of(people, bodies),
        reaction_s=bodies.age_s + motion.until_braking_s,
        stopping_s=motion.stopping_s,
        stopping_m=motion.stopping_m,
        intrusion_m=settings.intrusion_m,
        person_uncertainty_m=settings.person_uncertainty_m,
        robot_uncertainty_m=settings.robot_uncertainty_m + moved_m,
        human_m_s=_human_m_s(people, bodies),
        place_error_m=0.0 if people is None else bodies.error_m(people.person),
    )


def _human_m_s(people: Finding | None, bodies: BodyZones) -> float:
    beyond = bodies.speeds.beyond_standard_m_s
    if people is None or not 0 <= people.person < len(beyond):
        return 0.0
    return float(beyond[people.person].max(initial=0.0))
