"""Conversion of bodies from the source's joints to canonical joints."""

import math
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from hri_predict.base.arrays import Bools, Floats
from hri_predict.base.skeleton import JOINTS
from hri_predict.contracts.joint_map import JointMap
from hri_predict.contracts.scene import Person, sound_error_m
from hri_predict.people.body.size import are_human_sized
from hri_predict.people.body.unseen import at_origin, collapsed, contradicts, out_of_reach
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
        unseen: number of observed joints at the source's origin, too far from the others, or of a
            limb without length.
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


def canonical_bodies(people: Sequence[Person], joint_map: JointMap, origin: Floats) -> list[Mapped]:
    """Map the joints of a scene's people to canonical ones, all at once. Never raises.

    Args:
        people: P people as sent by the source.
        joint_map: joint map of the source.
        origin: (3,) origin of the source's frame, in the room; a joint exactly there was not seen.

    Returns:
        P bodies, in the same order.
    """
    troubles = [_trouble(person, len(joint_map.source_joints)) for person in people]
    sound = [person for person, trouble in zip(people, troubles, strict=True) if trouble is None]
    bodies = iter(_bodies(sound, joint_map, origin) if sound else ())
    return [next(bodies) if trouble is None else Mapped(None, trouble) for trouble in troubles]


def canonical_body(person: Person, joint_map: JointMap, origin: Floats) -> Mapped:
    """Map one person's joints; see ``canonical_bodies``."""
    return canonical_bodies([person], joint_map, origin)[0]


def _trouble(person: Person, count: int) -> str | None:
    """Return the counter for a person whose joints cannot be read; ``None`` if they can."""
    positions, observed = person.positions, person.observed
    if positions.shape != (count, 3) or observed.shape != (count,):
        return "malformed_bodies"
    if positions.dtype.kind not in "fiu" or observed.dtype != np.bool_:
        return "malformed_bodies"  # one such array would change the type of everyone's
    return "absurd_errors" if math.isnan(sound_error_m(person.error_m)) else None


def _bodies(people: Sequence[Person], joint_map: JointMap, origin: Floats) -> Iterator[Mapped]:
    positions = np.stack([person.positions for person in people]).astype(np.float64)
    observed = np.stack([person.observed for person in people])
    sizes = np.abs(positions)
    # false for NaN and infinity as well
    usable = observed & (sizes < ROOM_LIMIT_M).all(axis=-1)
    unusable = observed.sum(axis=1) - usable.sum(axis=1)
    nowhere = usable & at_origin(positions, origin)
    usable &= ~nowhere
    away = (sizes >= ROOM_LIMIT_M).any(axis=-1) & observed
    # of a body in another unit, the one joint near the origin shows no size
    lost = ~usable.any(axis=1) | (2 * away.sum(axis=1) > observed.sum(axis=1))
    joints, seen = joint_map.map(np.where(usable[..., None], positions, 0.0), usable)
    seen = seen & np.isfinite(joints).all(axis=-1)
    sized, fallen = are_human_sized(joints, seen), collapsed(joints, seen)
    seen = seen & ~fallen
    apart = contradicts(joints, seen)
    for n, person in enumerate(people):
        counts = int(unusable[n]), int(nowhere[n].sum() + fallen[n].sum())
        if lost[n]:
            yield Mapped(None, "unusable_bodies" if unusable[n] else None, *counts)
        elif not seen[n].any():
            yield Mapped(None, None, *counts)
        elif not sized[n]:
            yield Mapped(None, "wrong_size_bodies", *counts)
        else:
            mapped = _without_far_joints(person, joints[n], seen[n], counts, apart=bool(apart[n]))
            if mapped.body is not None and nowhere[n].any() and _is_waist(joint_map, nowhere[n]):
                mapped = mapped._replace(hip_centred=_around(mapped.body, origin))
            yield mapped


def _without_far_joints(
    person: Person, positions: Floats, observed: Bools, counts: tuple[int, int], *, apart: bool
) -> Mapped:
    """Return a body of human size without the joints that are out of reach of the others."""
    unusable, unseen = counts
    misnamed = False
    if apart:
        far, misnamed = out_of_reach(positions, observed)
        unseen += int(np.count_nonzero(far))
        observed = observed & ~far
        if not observed.any():
            return Mapped(None, None, unusable, unseen)
        # or the lost joints outvoted the others
        if far.any() and not are_human_sized(positions[None], observed[None])[0]:
            return Mapped(None, "wrong_size_bodies", unusable, unseen)
    positions = np.where(observed[:, None], positions, 0.0)
    body = Body(person.id, positions, observed, sound_error_m(person.error_m))
    return Mapped(body, None, unusable, unseen, misnamed=misnamed)


def _is_waist(joint_map: JointMap, joints: Bools) -> bool:
    """Return whether one of these (J_source,) joints is by itself the waist."""
    weights = joint_map.weights[_WAIST]
    return bool((weights[joints] == 1.0).any())


def _around(body: Body, origin: Floats) -> bool:
    """Return whether the joints next to the waist are within a bone's length of the origin."""
    next_to = [joint for joint in _NEXT if body.observed[joint]]
    apart = [float(np.linalg.norm(body.positions[joint] - origin)) for joint in next_to]
    return bool(apart) and max(apart) < HIP_CENTRED_M
