"""Near misses: a robot moves with hardly more distance to a person than its motion requires."""

from hri_predict.risk.separation.stage import Findings
from hri_predict.risk.types import NearMiss
from hri_predict.zones.body_zones import BodyZones

SHARE = 0.2
"""Maximum excess of a separation over its limit for a near miss."""
MOVING_M_S = 0.01


def near_misses(findings: Findings, bodies: BodyZones) -> tuple[NearMiss, ...]:
    """Return the near misses of one tick, at most one per robot.

    If the same people are judged by several rules, the mildest applies, as for the advice. A
    separation below the limit is a stop, not a near miss.
    """
    found: list[NearMiss] = []
    for robot, each in enumerate(findings.robots):
        _, closest = each.mildest
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
