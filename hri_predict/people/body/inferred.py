"""Unseen joints, inferred from the seen ones, with their uncertainty.

Some are never sent (COCO has no hands, feet or torso); others are hidden by a bench, by the edge of
the image, or for a moment. ``RULES`` place a joint in a frame that moves with the body: an origin,
an axis with the length of the person's own measured bone and, for some joints, a direction to the
joint's side. Both the position and the radius that holds the true joint are shares of that bone, so
no body size is assumed. If the rule's anchors are not seen either, ``body_model`` gives the
position.

The shares are fitted on recordings by ``hri-predict bench joint-maps --fit DATA``, which prints
``_FITTED`` (docs/measured/joint-maps.md). If too little of a body is seen, its other joints stay
unobserved.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from hri_predict.base.arrays import Bools, Floats
from hri_predict.base.skeleton import CANONICAL, JOINTS
from hri_predict.people.body.body_model import BodyModel
from hri_predict.people.body.seated import is_low

_LEAST_SIDE = 0.1
"""Minimum sine of the angle between side and axis (6 degrees): below it, the frame is unstable."""
_LEAST_BONE_M = 0.01
"""Minimum length of a bone with a usable direction."""
_LEGS = [JOINTS.index(f"{side}_{joint}") for side in "lr" for joint in ("knee", "ankle", "foot")]
"""Joints that the posture does not place in a body too low to stand: reach bounds them."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Rule:
    """Rule for the position of one joint, from others. Defined for the left side; ``mirrored``
    gives the rule for the right.

    Attributes:
        joint: the inferred joint.
        origin: origin of the frame.
        axis: start and end joint of the first direction; its length is the bone.
        side: start and end joint of the third direction, outwards or to the left; ``None``: the
            position is on the axis.
        place: shares of the bone along the axis, forward, and to the side.
        within: maximum distance of the true joint from this position, as a share of the bone.
    """

    joint: str
    origin: str
    axis: tuple[str, str]
    side: tuple[str, str] | None = None
    place: tuple[float, float, float] = (0.0, 0.0, 0.0)
    within: float = 0.0

    @property
    def anchors(self) -> frozenset[str]:
        """Joints required by the rule."""
        return frozenset({self.origin, *self.axis, *(self.side or ())})

    @property
    def is_left(self) -> bool:
        """Whether its side direction points to the left, as for joints in the middle."""
        return not self.joint.startswith("r_")

    def mirrored(self) -> "Rule":
        """Return the same rule for the other side."""
        side = None if self.side is None else (_other(self.side[0]), _other(self.side[1]))
        return replace(
            self,
            joint=_other(self.joint),
            origin=_other(self.origin),
            axis=(_other(self.axis[0]), _other(self.axis[1])),
            side=side,
        )


class Frame(NamedTuple):
    """A rule's frame in some bodies: origin (..., 3), directions (..., 3, 3) as rows (along the
    axis, forward, to the side; zeros without a side), bone (...) in metres, and whether the frame
    exists."""

    origin: Floats
    directions: Floats
    bone: Floats
    exists: Bools


def frame_of(rule: Rule, positions: Floats, observed: Bools) -> Frame:
    """Return the frame of a rule in bodies of canonical joints.

    Args:
        rule: the rule.
        positions: (..., J, 3) metres, finite.
        observed: (..., J).
    """

    def between(ends: tuple[str, str]) -> Floats:
        start, end = (JOINTS.index(joint) for joint in ends)
        vector: Floats = positions[..., end, :] - positions[..., start, :]
        return vector

    exists = observed[..., [JOINTS.index(joint) for joint in sorted(rule.anchors)]].all(-1)
    along = between(rule.axis)
    bone = _length(along)
    exists &= bone > _LEAST_BONE_M
    along = along / np.maximum(bone, _LEAST_BONE_M)[..., None]
    directions = np.zeros((*along.shape[:-1], 3, 3))
    directions[..., 0, :] = along
    if rule.side is not None:
        side = between(rule.side)
        whole = _length(side)
        side = side - np.einsum("...i,...i->...", side, along)[..., None] * along
        size = _length(side)
        exists &= (size > _LEAST_SIDE * whole) & (whole > 0)
        side = side / np.where(size > 0, size, 1.0)[..., None]
        upward = along if _points_up(rule) else -along
        left = side if rule.is_left else -side
        directions[..., 1, :] = _cross(left, upward)
        directions[..., 2, :] = side
    return Frame(positions[..., JOINTS.index(rule.origin), :], directions, bone, exists)


class Filled(NamedTuple):
    """Bodies with their inferred joints: positions (..., J, 3), observed (..., J), (..., J) maximum
    error of an inferred joint in metres, 0 for all others, and whether a rule gave it (..., J)."""

    positions: Floats
    observed: Bools
    within_m: Floats
    by_rule: Bools


class Inference:
    """Infers unseen joints: from the rules if their anchors are seen, because a bone of the same
    limb is more informative than the posture; otherwise from the distribution of postures.

    Args:
        model: distribution of postures; ``None``: only rules are used.
        floor_m: height of the floor in the room.
    """

    def __init__(self, model: BodyModel | None = None, floor_m: float = 0.0) -> None:
        self._model, self._floor_m = model, floor_m

    def fill(self, positions: Floats, observed: Bools) -> Filled:
        """Add joints that are not observed; those that cannot be inferred stay unobserved.

        Args:
            positions: (..., J, 3) metres, finite, in the room.
            observed: (..., J).
        """
        none = np.zeros(observed.shape)
        filled = Filled(positions.copy(), observed.copy(), none, none.astype(np.bool_))
        if observed.all():
            return filled
        _fill_by_rules(filled, observed)
        if self._model is not None and not filled.observed.all():
            _fill_by_postures(filled, observed, self._model, self._floor_m)
        return filled


def rule_of(joint: str, observed: Bools) -> Rule | None:
    """Return the rule used to infer a joint in a body with seen joints ``observed`` (J,)."""
    seen = {name for name, there in zip(JOINTS, observed, strict=True) if there}
    for rule in RULES:
        if rule.anchors <= seen:
            if rule.joint == joint:
                return rule
            seen |= {rule.joint} & set(_MIDPOINTS)
    return None


def _fill_by_rules(filled: Filled, observed: Bools) -> None:
    known = observed.copy()  # what others may rest on
    for rule in RULES:
        joint, origin = JOINTS.index(rule.joint), JOINTS.index(rule.origin)
        if filled.observed[..., joint].all():
            continue
        anchors = [JOINTS.index(name) for name in rule.anchors]
        frame = frame_of(rule, filled.positions, known)
        new = frame.exists & ~filled.observed[..., joint]
        offset = np.einsum("...ki,k->...i", frame.directions, np.array(rule.place))
        offset *= frame.bone[..., None]
        longest = _length(offset) + CANONICAL.reach[joint, origin]
        within = np.minimum(rule.within * frame.bone, longest)
        within = within + filled.within_m[..., anchors].sum(-1)  # of midpoints
        filled.positions[..., joint, :] = np.where(
            new[..., None], frame.origin + offset, filled.positions[..., joint, :]
        )
        filled.observed[..., joint] |= new
        filled.by_rule[..., joint] |= new
        filled.within_m[..., joint] = np.where(new, within, filled.within_m[..., joint])
        if rule.joint in _MIDPOINTS:
            known[..., joint] |= new


def _fill_by_postures(filled: Filled, observed: Bools, model: BodyModel, floor_m: float) -> None:
    joints, floor = observed.shape[-1], np.array([0.0, 0.0, floor_m])
    lacks = ~filled.observed.reshape(-1, joints)
    rows = np.flatnonzero(lacks.any(1))
    seen = observed.reshape(-1, joints)[rows]
    found = model.complete(filled.positions.reshape(-1, joints, 3)[rows] - floor, seen)
    new = lacks[rows] & found.usable[:, None]
    new[:, _LEGS] &= ~is_low(filled.positions.reshape(-1, joints, 3)[rows] - floor, seen)[:, None]
    for into, values in (
        (filled.positions.reshape(-1, joints, 3), found.positions + floor),
        (filled.within_m.reshape(-1, joints), found.within_m),
        (filled.observed.reshape(-1, joints), new),
    ):
        own = into[rows]
        own[new] = values[new]
        into[rows] = own


def _points_up(rule: Rule) -> bool:
    """Return whether the axis points upwards in a standing body."""
    return rule.axis[1] not in ("l_ankle", "r_ankle")


def _other(joint: str) -> str:
    swap = {"l_": "r_", "r_": "l_"}
    return swap.get(joint[:2], joint[:2]) + joint[2:]


def _length(vectors: Floats) -> Floats:
    length: Floats = np.sqrt(np.einsum("...i,...i->...", vectors, vectors))
    return length


def _cross(a: Floats, b: Floats) -> Floats:
    x, y, z = (a[..., i] for i in range(3))
    u, v, w = (b[..., i] for i in range(3))
    return np.stack([y * w - z * v, z * u - x * w, x * v - y * u], axis=-1)


SHAPES: dict[str, Rule] = {
    "hand": Rule(joint="l_hand", origin="l_wrist", axis=("l_elbow", "l_wrist")),
    "wrist": Rule(joint="l_wrist", origin="l_hand", axis=("l_elbow", "l_hand")),
    "foot": Rule(
        joint="l_foot", origin="l_ankle", axis=("l_knee", "l_ankle"), side=("r_hip", "l_hip")
    ),
    "hip": Rule(joint="l_hip", origin="waist", axis=("r_shoulder", "l_shoulder")),
    "torso": Rule(
        joint="torso", origin="waist", axis=("waist", "neck"), side=("r_shoulder", "l_shoulder")
    ),
    "head_top": Rule(
        joint="head_top", origin="head", axis=("neck", "head"), side=("r_shoulder", "l_shoulder")
    ),
}
"""The fitted rules, without their shares."""
_FITTED = {
    "hand": ((0.199, 0.0, 0.0), 0.534),
    "wrist": ((-0.016, 0.0, 0.0), 0.42),
    "foot": ((-0.001, 0.045, 0.015), 0.438),
    "hip": ((0.121, 0.0, 0.0), 0.318),
    "torso": ((0.563, -0.004, 0.0), 0.251),
    "head_top": ((0.636, 0.071, 0.0), 0.315),
}


def _rules() -> Iterator[Rule]:
    for joint, pair in (("waist", "hip"), ("neck", "shoulder")):
        # by definition; a hundredth stands for the rounding, and marks it as inferred
        axis = (f"r_{pair}", f"l_{pair}")
        yield Rule(joint=joint, origin=axis[0], axis=axis, place=(0.5, 0.0, 0.0), within=0.01)
    for name, (place, within) in _FITTED.items():
        rule = replace(SHAPES[name], place=place, within=within)
        yield rule
        if rule.joint.startswith("l_"):
            yield rule.mirrored()


_MIDPOINTS = ("waist", "neck")
RULES = tuple(_rules())
