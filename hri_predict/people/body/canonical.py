"""One body as the source sends it, in canonical joints."""

from typing import NamedTuple

import numpy as np

from hri_predict.joint_map import JointMap
from hri_predict.people.body.size import is_human_sized
from hri_predict.people.track import Body
from hri_predict.scene import Person

ROOM_LIMIT_M = 1000.0
"""No room is larger: a coordinate beyond this is an error."""


class Mapped(NamedTuple):
    """What became of a body.

    Attributes:
        body: ``None`` if no joint is usable.
        trouble: the counter of what is wrong with it; ``None``: nothing.
        unusable: number of observed joints that are no coordinates.
    """

    body: Body | None
    trouble: str | None = None
    unusable: int = 0


def canonical_body(person: Person, joint_map: JointMap) -> Mapped:
    """Map a person's joints to canonical ones. Never raises."""
    count = len(joint_map.source_joints)
    if person.positions.shape != (count, 3) or person.observed.shape != (count,):
        return Mapped(None, "malformed_bodies")
    # false for NaN and infinity as well
    sound = (np.abs(person.positions) < ROOM_LIMIT_M).all(axis=1)
    usable = person.observed & sound
    unusable = int(np.count_nonzero(person.observed)) - int(np.count_nonzero(usable))
    if not usable.any():
        return Mapped(None, "unusable_bodies" if unusable else None, unusable)
    positions, observed = joint_map.map(np.where(usable[:, None], person.positions, 0.0), usable)
    observed = observed & np.isfinite(positions).all(axis=1)
    if not observed.any():
        return Mapped(None, None, unusable)
    if not is_human_sized(positions, observed):
        return Mapped(None, "wrong_size_bodies", unusable)
    body = Body(person.id, np.where(observed[:, None], positions, 0.0), observed)
    return Mapped(body, None, unusable)
