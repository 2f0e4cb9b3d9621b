"""Motion classes: what the node knows about a person *before* it knows how good the forecast is.

One radius for all people is far too large for most and too small for some. So two measurements,
made at every capture, divide people into classes:

- **speed** of the trunk: *still* below ``STILL_M_S``, *brisk* from ``BRISK_M_S`` on, *slow* in
  between. A person who walks straight on is far easier to predict than one who sets out, turns or
  stops;
- **residual**: how wrong forecasts of this person were lately. It is the mean over joints of the
  distance between the newest capture and its forecast of ``RESIDUAL_S`` before; the largest such
  value within the last ``RESIDUAL_S`` counts. There are three grades, *calm*, *usual* and
  *surprising*, whose thresholds are the terciles of the calibration's windows, and *new*: no
  forecast is old enough yet.

A person whose speed is unknown counts as *slow* in a calibration; a zone then takes the largest
radii of all speeds (``radii.Radii``). Both measurements depend on the past alone, so a calibration
within each class is as valid as one without classes (Mondrian conformal prediction: V. Vovk, A.
Gammerman, G. Shafer, "Algorithmic Learning in a Random World", 2005, section 4.5).
"""

import numpy as np
from numpy.typing import NDArray

from hri_predict.arrays import Floats
from hri_predict.geometry import norm
from hri_predict.risk.zones.human_speed import Velocities
from hri_predict.skeleton import Skeleton

STILL_M_S = 0.4
"""Below this speed the trunk stays: well under walking (1.2 m/s), well over swaying (0.05 m/s)."""
BRISK_M_S = 1.0
"""From this speed on a person walks: people prefer 1.2 to 1.4 m/s (R. Bohannon, Age and Ageing 26
(1997), 15), and are slower when they set out, turn or stop."""
RESIDUAL_S = 0.4
"""How old a forecast is when its error counts as the residual, and how long it is remembered."""
SPEED_CLASSES = ("still", "slow", "brisk")
GRADES = ("calm", "usual", "surprising")
"""Grades of people whose residual is known."""
NEW = "new"
CLASSES = tuple(f"{speed}, {grade}" for speed in SPEED_CLASSES for grade in (*GRADES, NEW))

_TRUNK = ("waist", "torso", "neck", "l_shoulder", "r_shoulder", "l_hip", "r_hip")


def trunk_speed(velocities: Velocities, skeleton: Skeleton) -> Floats:
    """(P,) speed of the trunk in m/s, the mean of its measured joints; NaN without any.

    Args:
        velocities: of all joints.
        skeleton: names the joints.
    """
    trunk = [i for i, name in enumerate(skeleton.joints) if name in _TRUNK]
    velocity, measured = velocities
    count = measured[:, trunk].sum(1)
    mean = velocity[:, trunk].sum(1) / np.maximum(count, 1)[:, None]  # 0 where it was not measured
    return np.where(count > 0, norm(mean), np.nan)


def speed_class(speed_m_s: Floats) -> NDArray[np.intp]:
    """(P,) index into ``SPEED_CLASSES``; an unknown speed (NaN) is *slow*."""
    return (~(speed_m_s < STILL_M_S)).astype(np.intp) + (speed_m_s >= BRISK_M_S)


def motion_class(speed_m_s: Floats, residual_m: Floats, thresholds_m: Floats) -> NDArray[np.intp]:
    """(P,) index into ``CLASSES``.

    Args:
        speed_m_s: (P,) see ``trunk_speed``.
        residual_m: (P,) metres; NaN if no forecast is old enough.
        thresholds_m: (3, 2) for each speed class: from calm to usual, and from usual to surprising.
    """
    fast = speed_class(speed_m_s)
    grade = (residual_m[:, None] >= thresholds_m[fast]).sum(1)
    grade = np.where(np.isnan(residual_m), len(GRADES), grade)
    return fast * (len(GRADES) + 1) + grade
