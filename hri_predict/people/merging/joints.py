"""Merges the bodies that several sensors see of one person."""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from hri_predict.base.arrays import Bools, Floats
from hri_predict.base.geometry import norm
from hri_predict.people.track import Body

LEAD_MORE = 4
"""Number of additional joints that another sensor must see to become the leading sensor."""


def leading(lead: int | None, seen: Mapping[int, Body]) -> int:
    """Return the leading sensor, with priority for joints: the sensor that sees most of them.

    The leading sensor stays until another sees ``LEAD_MORE`` more joints, so that a body does not
    jump between two sensors that differ slightly.

    Args:
        lead: the current leading sensor; ``None``: none.
        seen: at least one body, by sensor.
    """
    counts = {sensor: int(np.count_nonzero(body.observed)) for sensor, body in seen.items()}
    best = max(counts, key=lambda sensor: (counts[sensor], -sensor))
    if lead in counts and counts[lead] > 0 and counts[best] < counts[lead] + LEAD_MORE:
        return lead
    return best


class Merged(NamedTuple):
    """A merged body.

    Attributes:
        positions: (J, 3) metres, 0 where not observed.
        observed: (J,) whether observed.
        disputed: number of joints left out.
        error_m: the largest error of the sensors that see the person.
    """

    positions: Floats
    observed: Bools
    disputed: int
    error_m: float


def merged(lead: int, seen: Mapping[int, Body], joint_apart_m: float) -> Merged:
    """Merge bodies joint by joint: from the leading sensor if it sees the joint, otherwise from
    another.

    A joint that two sensors see farther apart than ``joint_apart_m`` is not observed: it is unknown
    which sensor is right, and the zone becomes as wide as for a hidden joint. The error is the
    largest of all sensors that see a joint, including those not used: bodies are merged because
    they are close together, but a body with a large error may belong to a person elsewhere.
    """
    order = sorted(seen, key=lambda s: (s != lead, -np.count_nonzero(seen[s].observed), s))
    first = seen[order[0]]
    positions, observed = first.positions.copy(), first.observed.copy()
    disputed = np.zeros(len(observed), np.bool_)
    for sensor in order[1:]:
        other = seen[sensor]
        both = observed & other.observed
        disputed |= both & (norm(positions - other.positions) > joint_apart_m)
        more = other.observed & ~observed
        positions[more] = other.positions[more]
        observed |= more
    observed &= ~disputed
    error_m = max((body.error_m for body in seen.values() if body.observed.any()), default=0.0)
    positions = np.where(observed[:, None], positions, 0.0)
    return Merged(positions, observed, int(np.count_nonzero(disputed)), error_m)
