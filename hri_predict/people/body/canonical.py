"""Conversion of one body from the source's joints to canonical joints."""

import math
from typing import NamedTuple

import numpy as np

from hri_predict.base.arrays import Bools, Floats
from hri_predict.base.skeleton import JOINTS
from hri_predict.contracts.joint_map import JointMap
from hri_predict.contracts.scene import Person, sound_error_m
from hri_predict.people.body.size import is_human_sized
from hri_predict.people.body.unseen import at_origin, out_of_reach
from hri_predict.people.track import Body

HIP_CENTRED_M = 0.35
"""A waist at the origin with hips or the lumbar joint within this distance was not lost."""
_WAIST = JOINTS.index("waist")
_NEXT = [JOINTS.index(name) for name in ("l_hip", "r_hip", "torso")]
ROOM_LIMIT_M = 1000.0
"""Maximum coordinate: no room is larger, so a larger value is an error."""


class Mapped(NamedTuple):
    """A body after mapping.

    Attributes:
        body: ``None`` if no joint is usable.
        trouble: the counter for its fault; ``None``: no fault.
        unusable: number of observed joints without valid coordinates.
        unseen: number of observed joints at the source's origin, or too far from the others.
        hip_centred: whether the waist is at the source's origin, with the rest of the body around
            it.
        misnamed: whether the joints contradict each other, as with a wrong joint map. The body is
            believed, because its position may be right.
    """

    body: Body | None
    trouble: str | None = None
    unusable: int = 0
    unseen: int = 0
    hip_centred: bool = False
    misnamed: bool = False

    @property
    def counts(self) -> dict[str, int]:
        """Counters of the body's joints, and of bodies like it."""
        return {
            "unusable_joints": self.unusable,
            "unseen_joints": self.unseen,
            "misnamed_bodies": int(self.misnamed),
        }


def canonical_body(person: Person, joint_map: JointMap, origin: Floats) -> Mapped:
    """Map a person's joints to canonical ones. Never raises.

    Args:
        person: the person as sent by the source.
        joint_map: joint map of the source.
        origin: (3,) origin of the source's frame, in the room; a joint exactly there was not seen.
    """
    count = len(joint_map.source_joints)
    if person.positions.shape != (count, 3) or person.observed.shape != (count,):
        return Mapped(None, "malformed_bodies")
    error_m = sound_error_m(person.error_m)
    if math.isnan(error_m):
        return Mapped(None, "absurd_errors")
    # false for NaN and infinity as well
    sound = (np.abs(person.positions) < ROOM_LIMIT_M).all(axis=1)
    usable = person.observed & sound
    unusable = int(np.count_nonzero(person.observed)) - int(np.count_nonzero(usable))
    nowhere = usable & at_origin(person.positions, origin)
    unseen = int(np.count_nonzero(nowhere))
    usable &= ~nowhere
    away = (np.abs(person.positions) >= ROOM_LIMIT_M).any(axis=1) & person.observed
    # of a body in another unit, the one joint near the origin shows no size
    if not usable.any() or 2 * away.sum() > person.observed.sum():
        return Mapped(None, "unusable_bodies" if unusable else None, unusable, unseen)
    positions, observed = joint_map.map(np.where(usable[:, None], person.positions, 0.0), usable)
    observed = observed & np.isfinite(positions).all(axis=1)
    if not observed.any():
        return Mapped(None, None, unusable, unseen)
    if not is_human_sized(positions, observed):
        return Mapped(None, "wrong_size_bodies", unusable, unseen)
    far, misnamed = out_of_reach(positions, observed)
    unseen += int(np.count_nonzero(far))
    if far.any():
        observed = observed & ~far
        if not observed.any():
            return Mapped(None, None, unusable, unseen)
        if not is_human_sized(positions, observed):  # the lost joints outvoted the others
            return Mapped(None, "wrong_size_bodies", unusable, unseen)
    body = Body(person.id, np.where(observed[:, None], positions, 0.0), observed, error_m)
    around = bool(nowhere.any()) and _is_waist(joint_map, nowhere) and _around(body, origin)
    return Mapped(body, None, unusable, unseen, around, misnamed)


def _is_waist(joint_map: JointMap, joints: Bools) -> bool:
    """Return whether one of these (J_source,) joints is by itself the waist."""
    weights = joint_map.weights[_WAIST]
    return bool((weights[joints] == 1.0).any())


def _around(body: Body, origin: Floats) -> bool:
    """Return whether the joints next to the waist are within a bone's length of the origin."""
    next_to = [joint for joint in _NEXT if body.observed[joint]]
    apart = [float(np.linalg.norm(body.positions[joint] - origin)) for joint in next_to]
    return bool(apart) and max(apart) < HIP_CENTRED_M
