"""The deciding pair: one segment of a body and one capsule of a robot."""

import numpy as np

from hri_predict.base.geometry import Capsules, capsule_distance
from hri_predict.base.skeleton import hidden_ends
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


def hidden_ends_of(people: Finding, bodies: BodyZones) -> int:
    """Return how many joints of the deciding segment the newest capture does not show, 0 to 2.

    A lost person has none: no part of that body is seen.
    """
    if bodies.fresh is None or not 0 <= people.person < len(bodies.fresh):
        return 0
    return hidden_ends(bodies.zones.segments[people.segment], bodies.fresh[people.person])


def pair_m(people: Finding, bodies: BodyZones, motion: RobotMotion) -> float | None:
    """Return the deciding pair's present distance; ``None`` without a deciding robot capsule."""
    pair = pair_of(people, bodies, motion)
    return None if pair is None else float(capsule_distance(*pair))
