"""The canonical skeleton: joints, their tree, body segments with radii, and maximum reaches.

Joints have the names of REP-155 (ROS4HRI) links, plus the points that a robot is likely to touch
first: ``l_hand``/``r_hand`` are the fingertips, ``l_foot``/``r_foot`` the toes, ``head_top`` is the
crown. ``head`` is the centre of the head at ear level, ``neck`` the middle of the shoulders,
``waist`` the middle of the hips, ``torso`` the lumbar/thoracic junction.

Body sizes are those of ANSUR II: Gordon et al., "2012 Anthropometric Survey of U.S. Army
Personnel: Methods and Summary Statistics", NATICK/TR-15/007, 2014; its public data has 4082 men
and 1986 women. Means, standard deviations (SD) and maxima below are over those 6068 people, in
millimetres, with the public data's variable names. A radius covers mean + 3 SD, rounded up to 5 mm,
for bare skin. Anything beyond (a held tool, a backpack, a person heavier than any soldier) must be
covered by the configured uncertainty of the person.
"""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hri_predict.base.arrays import Bools, Floats
from hri_predict.base.errors import ConfigError, nearest

JOINTS = (
    "waist", "torso", "neck", "head", "head_top",
    "l_shoulder", "l_elbow", "l_wrist", "l_hand",
    "r_shoulder", "r_elbow", "r_wrist", "r_hand",
    "l_hip", "l_knee", "l_ankle", "l_foot",
    "r_hip", "r_knee", "r_ankle", "r_foot",
)  # fmt: skip
PARENTS = (-1, 0, 1, 2, 3, 2, 5, 6, 7, 2, 9, 10, 11, 0, 13, 14, 15, 0, 17, 18, 19)


@dataclass(frozen=True, slots=True, kw_only=True)
class Segment:
    """A body segment as a capsule: ``radius`` metres around the line between two joints."""

    name: str
    joint_a: int
    joint_b: int
    radius: float
    part: str

    @property
    def region(self) -> str:
        """The name without its side: both hands are ``hand``."""
        return self.name.removeprefix("l_").removeprefix("r_")


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Skeleton:
    """Joints, their tree, and the segments between them.

    Attributes:
        parents: parent of each joint; -1 for the root.
        parts: joints of each body part; every joint and every segment belongs to one part.
        reach: (J, J) metres, the maximum distance between two joints of any person: the sum of the
            longest bones between them. Infinite if bone lengths are unknown.
    """

    name: str
    joints: tuple[str, ...]
    parents: tuple[int, ...]
    segments: tuple[Segment, ...]
    left_right_pairs: tuple[tuple[int, int], ...]
    parts: dict[str, tuple[int, ...]]
    reach: Floats

    @property
    def segment_names(self) -> tuple[str, ...]:
        """Names of the segments, in order."""
        return tuple(segment.name for segment in self.segments)

    def index(self, joint: str) -> int:
        """Return the index of a joint.

        Raises:
            ConfigError: there is no joint of this name.
        """
        if joint not in self.joints:
            raise ConfigError(
                f"skeleton {self.name} has no joint '{joint}'{nearest(joint, self.joints)}"
            )
        return self.joints.index(joint)

    def without(self, absent_parts: Iterable[str]) -> tuple[int, ...]:
        """Return the indices of the segments that remain without the absent body parts.

        Raises:
            ConfigError: a part is unknown.
        """
        absent = set(absent_parts)
        for part in sorted(absent):
            if part not in self.parts:
                raise ConfigError(
                    f"absent_parts: unknown body part '{part}'{nearest(part, self.parts)} "
                    f"(known: {', '.join(self.parts)})"
                )
        return tuple(i for i, s in enumerate(self.segments) if s.part not in absent)


def make_skeleton(
    name: str,
    joints: Sequence[str],
    parents: Sequence[int],
    *,
    segments: Sequence[Segment] = (),
    left_right_pairs: Sequence[tuple[int, int]] = (),
    parts: dict[str, tuple[int, ...]] | None = None,
    bone_lengths: Sequence[float] | None = None,
) -> Skeleton:
    """Build a skeleton from its tree, sufficient for a predictor with its own joints.

    Args:
        bone_lengths: maximum distance of each joint from its parent, metres (the root's is
            ignored); ``None`` if unknown, and ``reach`` is then infinite.
    """
    lengths = [math.inf] * len(joints) if bone_lengths is None else bone_lengths
    return Skeleton(
        name=name,
        joints=tuple(joints),
        parents=tuple(parents),
        segments=tuple(segments),
        left_right_pairs=tuple(left_right_pairs),
        parts=dict(parts or {}),
        reach=path_lengths(parents, lengths),
    )


def in_words(part: str) -> str:
    """Return a readable name of a body or robot part: ``right hand`` for ``r_hand``."""
    side = {"l_": "left ", "r_": "right "}.get(part[:2], "")
    return (side + part[2:] if side else part).replace("_", " ")


def hidden_ends(segment: str, seen: Sequence[bool] | Bools) -> int:
    """Return how many of a segment's two joints, by its canonical name, were not seen: (J,)."""
    for each in CANONICAL.segments:
        if each.name == segment:
            return int(not seen[each.joint_a]) + int(not seen[each.joint_b])
    return 0


def seen_text(hidden: int, short: bool = False) -> str:
    """Return how much of a segment was not seen, to follow its name; "" if all was seen.

    Args:
        hidden: see ``hidden_ends``.
        short: for a line of a list or a narrow screen.
    """
    if not hidden:
        return ""
    is_part = hidden == 1
    if short:
        return " (seen in part)" if is_part else " (not seen)"
    rest = "seen in part; the rest" if is_part else "not seen; its zone"
    return f" ({rest} is inferred)"


def path_lengths(parents: Sequence[int], bone_lengths: Sequence[float]) -> Floats:
    """(J, J) length of the path through the tree between any two joints.

    Joints in separate trees (several roots) are infinitely far apart.
    """
    count = len(parents)
    lengths = np.full((count, count), np.inf)
    for start in range(count):
        lengths[start, start] = 0.0
        reached = [start]
        for joint in reached:  # grows during the loop: breadth first
            for other in range(count):
                if other == parents[joint]:
                    bone = bone_lengths[joint]
                elif parents[other] == joint:
                    bone = bone_lengths[other]
                else:
                    continue
                if other not in reached:
                    lengths[start, other] = lengths[start, joint] + bone
                    reached.append(other)
    return lengths


def generations(parents: Sequence[int]) -> list[list[int]]:
    """Return the joints grouped by depth in the tree: roots, their children, and so on."""
    found = [[j for j, parent in enumerate(parents) if parent < 0]]
    while children := [j for j, parent in enumerate(parents) if parent in found[-1]]:
        found.append(children)
    return found


def neighbours(parents: Sequence[int]) -> NDArray[np.intp]:
    """(J, J) for each joint, all joints sorted by the number of bones between them, itself
    first.
    """
    return np.argsort(path_lengths(parents, [1.0] * len(parents)), axis=1, kind="stable")


def _round_up(millimetres: float) -> float:
    """Return a length in metres, rounded up to 5 mm."""
    return math.ceil(millimetres / 5.0) * 5.0 / 1000.0


def _girth(mean: float, sd: float) -> float:
    """Radius of a round segment of circumference mean + 3 SD."""
    return _round_up((mean + 3.0 * sd) / (2.0 * math.pi))


def _half(mean: float, sd: float) -> float:
    """Radius that covers a breadth or depth of mean + 3 SD."""
    return _round_up((mean + 3.0 * sd) / 2.0)


# The larger of circumference / (2 pi) and half the largest breadth or depth covers the segment.
_RADII = {
    "pelvis": _girth(1020.08, 76.42),  # buttockcircumference
    "abdomen": _half(317.75, 36.36),  # waistbreadth, wider than waistcircumference / (2 pi)
    "thorax": _girth(1022.10, 100.67),  # chestcircumference
    "shoulders": _half(251.74, 26.78),  # chestdepth; the breadth is the capsule's own length
    "head": _half(196.33, 8.49),  # headlength (brow to back), more than headcircumference / (2 pi)
    "upper_arm": _girth(340.93, 41.52),  # bicepscircumferenceflexed
    "forearm": _girth(295.01, 30.05),  # forearmcircumferenceflexed
    # handlength - palmlength, 239 - 140 at most: some sources end at the knuckles, and the capsule
    # must still cover the fingers. It also covers a spread hand, except the tip of the thumb.
    "hand": _round_up(99.0),
    "thigh": _girth(622.20, 57.75),  # thighcircumference
    "shank": _girth(386.04, 30.65),  # calfcircumference
    # lateralmalleolusheight, 69.58 + 3 x 7.27, is the depth of the sole below the ankle; rounded up
    # for a shoe. It also covers the toes if a source ends at the ball of the foot (footlength -
    # balloffootlength: 323 - 245 at most).
    "foot": _round_up(96.0),
}

# Longest bones, metres: the survey's maxima, or differences of two maxima. The survey has no trunk
# bones: these are differences of two mean heights, scaled by the ratio of largest to mean stature.
_TALL = 1993.0 / 1714.41 / 1000.0
_BONES = {
    "torso": (1099.59 - 882.74) * _TALL,  # tenthribheight - trochanterionheight
    "neck": (1406.16 - 1099.59) * _TALL,  # acromialheight - tenthribheight
    "head": (1714.41 - 129.62 - 1406.16) * _TALL,  # stature - tragiontopofhead - acromialheight
    "head_top": 0.150 + 0.020,  # tragiontopofhead; some sources put the head as low as the atlas
    "shoulder": 0.489 / 2,  # biacromialbreadth
    "elbow": 0.393,  # acromionradialelength
    "wrist": 0.328,  # radialestylionlength
    "hand": 0.239,  # handlength
    "hip": 0.362 / 2,  # bicristalbreadth, wider than the hip joints are apart
    "knee": 1.095 - 0.594,  # trochanterionheight - lateralfemoralepicondyleheight
    "ankle": 0.594 - 0.070,  # lateralfemoralepicondyleheight - mean lateralmalleolusheight
    # footlength 0.323, its heel quarter behind the ankle (own estimate); lateralmalleolusheight
    "foot": math.hypot(0.75 * 0.323, 0.093),
}
# Allows for the travel of shoulder girdle and spine, and for sources whose joints differ from the
# survey's landmarks.
_REACH_MARGIN = 1.15

_SIDES = {"l_": "left", "r_": "right"}


def _segments() -> tuple[Segment, ...]:
    def segment(name: str, a: str, b: str, part: str) -> Segment:
        radius = _RADII[name.removeprefix("l_").removeprefix("r_")]
        return Segment(
            name=name, joint_a=JOINTS.index(a), joint_b=JOINTS.index(b), radius=radius, part=part
        )

    trunk = [
        segment("pelvis", "l_hip", "r_hip", "torso"),
        segment("abdomen", "waist", "torso", "torso"),
        segment("thorax", "torso", "neck", "torso"),
        segment("shoulders", "l_shoulder", "r_shoulder", "torso"),
        segment("head", "neck", "head_top", "torso"),
    ]
    limbs = [
        segment(s + name, s + a, s + b, f"{side}_{limb}")
        for s, side in _SIDES.items()
        for name, a, b, limb in (
            ("upper_arm", "shoulder", "elbow", "arm"),
            ("forearm", "elbow", "wrist", "arm"),
            ("hand", "wrist", "hand", "arm"),
            ("thigh", "hip", "knee", "leg"),
            ("shank", "knee", "ankle", "leg"),
            ("foot", "ankle", "foot", "leg"),
        )
    ]
    return tuple(trunk + limbs)


def _parts() -> dict[str, tuple[int, ...]]:
    names = {
        "torso": ("waist", "torso", "neck", "head", "head_top"),
        **{
            f"{side}_{limb}": tuple(s + joint for joint in joints)
            for s, side in _SIDES.items()
            for limb, joints in (
                ("arm", ("shoulder", "elbow", "wrist", "hand")),
                ("leg", ("hip", "knee", "ankle", "foot")),
            )
        },
    }
    return {part: tuple(JOINTS.index(j) for j in joints) for part, joints in names.items()}


def _bone_length(joint: str) -> float:
    return _BONES.get(joint.removeprefix("l_").removeprefix("r_"), 0.0) * _REACH_MARGIN


CANONICAL = make_skeleton(
    "canonical",
    JOINTS,
    PARENTS,
    segments=_segments(),
    left_right_pairs=tuple(
        (i, JOINTS.index("r_" + name[2:])) for i, name in enumerate(JOINTS) if name[:2] == "l_"
    ),
    parts=_parts(),
    bone_lengths=[_bone_length(joint) for joint in JOINTS],
)
