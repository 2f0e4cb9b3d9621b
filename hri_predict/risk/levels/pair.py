"""The deciding pair: one segment of a body and one capsule of a robot."""

import numpy as np

from hri_predict.base.geometry import Capsules, capsule_distance
from hri_predict.risk.terms import Finding
from hri_predict.robots.motion import RobotMotion
from hri_predict.zones.body_zones import BodyZones


def pair_of(
    people: Finding, bodies: BodyZones, motion: RobotMotion
) -> tuple[Capsules, Capsules] | None:
    """Return the deciding segment and capsule at present; ``None`` without a deciding robot
    capsule."""
    link, numbering = people.link, motion.model.numbering
    if numbering is not None:  # findings count the capsules of all tools
        own = np.flatnonzero(numbering == link)
        link = int(own[0]) if own.size else -1
    if link < 0:
        return None
    zones, pair = bodies.zones.capsules, (people.person, 0, people.segment)
    body = zones[pair]
    robot = motion.capsules
    return body, robot[link]


def pair_m(people: Finding, bodies: BodyZones, motion: RobotMotion) -> float | None:
    """Return the deciding pair's present distance; ``None`` without a deciding robot capsule."""
    pair = pair_of(people, bodies, motion)
    return None if pair is None else float(capsule_distance(*pair))
