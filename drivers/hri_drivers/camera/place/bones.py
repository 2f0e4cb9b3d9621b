"""A body's size from its bones: stature, and lengths that no body exceeds.

Lengths as shares of the stature: R. Drillis and R. Contini, "Body Segment Parameters", New York
University, 1966, as in D. Winter, "Biomechanics and Motor Control of Human Movement", figure 4.1.
The stature of adults: ANSUR II (``hri_predict.base.skeleton``), 6068 people, a third
women: mean 1715 mm; women 1629 with a standard deviation of 64, men 1756 with 69.
"""

from dataclasses import dataclass
from functools import cache

import numpy as np

from hri_predict.base.arrays import Bools, Floats, Ints
from hri_predict.base.errors import ConfigError
from hri_predict.base.geometry import norm
from hri_predict.contracts.joint_map import load_joint_map

ADULT_M = 1.70
ADULT_ERROR = 0.14
"""99 % of adults differ from ADULT_M by less than this fraction: 1.46 to 1.94 m."""
SHARES = {
    ("hip", "knee"): 0.245,
    ("knee", "ankle"): 0.246,
    ("shoulder", "hip"): 0.288,
    ("shoulder", "elbow"): 0.186,
    ("elbow", "wrist"): 0.146,
}
"""Length of each bone as a fraction of the stature; each exists on both sides of the body."""
CARRIED_SHARES = {
    "{}_wrist": (0.108, ("{}_index", "{}_pinky", "{}_thumb")),
    "{}_ankle": (0.152, ("{}_heel", "{}_foot_index")),
    "{}_shoulder": (
        0.182,
        ("{}_ear", "{}_eye", "{}_eye_inner", "{}_eye_outer", "mouth_{}", "nose"),
    ),
}
"""Joints of hands, feet and head by the joint that carries them, and their maximum distance from it
as a fraction of the stature: the length of the hand, of the foot, and from the shoulder to the top
of the head. "{}" is the side. They do not measure a stature."""
MIN_SHARE = 0.7
"""Minimum sum of the fractions of the bones that measure a stature: both arms, or a leg and an
arm."""


@dataclass(frozen=True, slots=True, eq=False)
class Bones:
    """The bones of a layout that this module knows.

    Attributes:
        ends: (B, 2) joints at the ends of each bone.
        shares: (B,) length of each bone as a share of the stature.
        hips, shoulders, ankles: the joints on the left and the right.
        carried: (C, 2) joints that carry hands, feet and head, and the joint that each carries.
        carried_shares: (C,) maximum distance between the two as a share of the stature.
    """

    ends: Ints
    shares: Floats
    hips: tuple[int, int]
    shoulders: tuple[int, int]
    ankles: tuple[int, int]
    carried: Ints
    carried_shares: Floats

    def stature(self, positions: Floats, known: Bools) -> float:
        """Return the stature in metres from all bones with known ends; NaN if these bones are too
        few.

        Args:
            positions: (J, 3) metres, in any axes.
            known: (J,) which joints to use.
        """
        whole = known[self.ends].all(axis=1)
        shares = float(self.shares[whole].sum())
        if shares < MIN_SHARE:
            return float("nan")
        return float(self.lengths(positions)[whole].sum()) / shares

    def lengths(self, positions: Floats) -> Floats:
        """Return (B,) the length of each bone; NaN where an end is not known."""
        return norm(positions[self.ends[:, 0]] - positions[self.ends[:, 1]])


@cache
def bones_of(layout: str) -> Bones:
    """Return the bones of a shipped joint map's joints.

    Raises:
        ConfigError: the map does not exist, or it has none of these joints.
    """
    joints = load_joint_map(layout).source_joints
    try:
        ends = [
            (joints.index(f"{side}_{first}"), joints.index(f"{side}_{second}"))
            for side in ("left", "right")
            for first, second in SHARES
        ]
        hips, shoulders, ankles = (
            (joints.index(f"left_{name}"), joints.index(f"right_{name}"))
            for name in ("hip", "shoulder", "ankle")
        )
    except ValueError:
        raise ConfigError(
            f"joint map '{layout}': no hips, knees, shoulders or elbows under the names of "
            f"mediapipe33 and coco17; use one of these maps"
        ) from None
    shares = np.array([*SHARES.values()] * 2)
    carried = [
        (joints.index(carrier.format(side)), joints.index(name.format(side)), share)
        for side in ("left", "right")
        for carrier, (share, names) in CARRIED_SHARES.items()
        for name in names
        if name.format(side) in joints
    ]
    pairs = np.array([each[:2] for each in carried]).reshape(-1, 2)
    return Bones(
        np.array(ends), shares, hips, shoulders, ankles, pairs,
        np.array([share for *_, share in carried]),
    )  # fmt: skip
