"""Near misses: a robot that moves while a person is hardly farther away than its motion needs."""

from hri_predict.risk.levels.grounds import mildest
from hri_predict.risk.separation.stage import Findings
from hri_predict.risk.types import NearMiss
from hri_predict.zones.body_zones import BodyZones

SHARE = 0.2
"""Margin above the limit within which a separation is a near miss."""
MOVING_M_S = 0.01


def near_misses(findings: Findings, bodies: BodyZones) -> tuple[NearMiss, ...]:
    """The near misses of one tick: at most one for each robot.

    Of several ways to judge the same people the mildest counts, as for the advice. A separation
    below the limit is not a near miss: it is a stop.
    """
    found: list[NearMiss] = []
    for robot, each in enumerate(findings.robots):
        _, closest = mildest(each)
        if closest is None or not each.speed_m_s > MOVING_M_S:
            continue
        limit_m = closest.separation_m - closest.slack_m
        if not 0 <= closest.slack_m < SHARE * limit_m:
            continue
        miss = NearMiss(
            robot=robot,
            person=bodies.zones.ids[closest.person],
            segment=bodies.zones.segments[closest.segment],
            link=closest.link,
            separation_m=closest.separation_m,
            limit_m=limit_m,
        )
        found.append(miss)
    return tuple(found)
