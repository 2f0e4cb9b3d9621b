"""Speed classes and the residual: data on a person known before a forecast can be judged.

- **speed** of the trunk: *still* below ``STILL_M_S``, *brisk* from ``BRISK_M_S`` on, *slow* in
  between. A person who walks straight on is far easier to predict than one who starts, turns or
  stops. Each class has its own factors on the learned scale.
- **residual**: recent forecast error of this person. It is the mean over joints of the distance
  between the newest capture and its forecast made ``RESIDUAL_S`` earlier; the largest such value
  within the last ``RESIDUAL_S`` is used. It is an input of the learned scale.

A person whose speed is unknown counts as *slow* in a calibration; for zones, the largest radii of
all speed classes are used (``radii.Radii``). The speed depends on the past alone, so a calibration
within each class is as valid as one without classes (Mondrian conformal prediction: V. Vovk, A.
Gammerman, G. Shafer, "Algorithmic Learning in a Random World", 2005, section 4.5).
"""

from functools import cache

import numpy as np
from numpy.typing import NDArray

from hri_predict.base.arrays import Floats, Ints
from hri_predict.base.geometry import norm
from hri_predict.base.skeleton import Skeleton
from hri_predict.zones.human_speed import Velocities

STILL_M_S = 0.4
"""Below this speed the trunk counts as still: well below walking (1.2 m/s), well above swaying
(0.05 m/s)."""
BRISK_M_S = 1.0
"""Minimum speed of a person who walks: people prefer 1.2 to 1.4 m/s (R. Bohannon, Age and Ageing 26
(1997), 15), and are slower when they start, turn or stop."""
RESIDUAL_S = 0.4
"""Age of the forecast whose error is the residual, and time for which the error is kept."""
SPEED_CLASSES = ("still", "slow", "brisk")
_TRUNK = ("waist", "torso", "neck", "l_shoulder", "r_shoulder", "l_hip", "r_hip")


def trunk_speed(velocities: Velocities, skeleton: Skeleton) -> Floats:
    """Return (P,) speed of the trunk in m/s, the mean over its measured joints; NaN if none is
    measured.

    Args:
        velocities: velocities of all joints.
        skeleton: names the joints.
    """
    trunk = trunk_joints(skeleton)
    velocity, measured = velocities
    count = measured[:, trunk].sum(1)
    mean = velocity[:, trunk].sum(1) / np.maximum(count, 1)[:, None]  # 0 where it was not measured
    return np.where(count > 0, norm(mean), np.nan)


def trunk_joints(skeleton: Skeleton) -> Ints:
    """Return the indices of the joints whose mean velocity is the trunk's velocity."""
    return _trunk_of(tuple(skeleton.joints))


@cache
def _trunk_of(joints: tuple[str, ...]) -> Ints:
    return np.array([i for i, name in enumerate(joints) if name in _TRUNK], np.intp)


def speed_class(speed_m_s: Floats) -> NDArray[np.intp]:
    """Return (P,) index into ``SPEED_CLASSES``; an unknown speed (NaN) is *slow*."""
    return (~(speed_m_s < STILL_M_S)).astype(np.intp) + (speed_m_s >= BRISK_M_S)
