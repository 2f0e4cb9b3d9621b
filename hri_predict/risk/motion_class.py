"""Motion classes: what can be seen of a person *before* it is known how good the forecast is.

A radius that holds people in general is far too wide for most and too narrow for some. So people
are told apart by two things that the node sees at every capture:

- **speed** of the trunk: *still* below ``STILL_M_S``, *brisk* from ``BRISK_M_S`` on, *slow* in
  between: who walks straight on is far better foreseen than who sets out, turns or stops;
- **surprise**: by how much forecasts of this person were wrong of late. The mean over joints of
  how far the newest capture is from where it was forecast ``SURPRISE_S`` before, and the largest
  such value within the last ``SURPRISE_S``. Three grades, *calm*, *usual* and *surprising*, whose
  thresholds are the terciles of the calibration's windows; and *new*, where no forecast is old
  enough yet.

Where no speed is known, a person counts as *slow* in a calibration; a zone then takes the largest
radii of all speeds (``calibration.Radii``).
Both are functions of the past alone, so a calibration within each class is as valid as one without
(Mondrian conformal prediction: V. Vovk, A. Gammerman, G. Shafer, "Algorithmic Learning in a Random
World", 2005, section 4.5).
"""

import numpy as np
from numpy.typing import NDArray

from hri_predict.risk.human_speed import Velocities
from hri_predict.risk.kinematics import norm
from hri_predict.scene import Floats
from hri_predict.skeleton import Skeleton

STILL_M_S = 0.4
"""Below this the trunk stays: well under walking (1.2 m/s), well over swaying (0.05 m/s)."""
BRISK_M_S = 1.0
"""From here on somebody goes somewhere: people prefer to walk at 1.2 to 1.4 m/s (R. Bohannon, Age
and Ageing 26 (1997), 15), and are slower as they set out, turn and stop."""
SURPRISE_S = 0.4
"""How old a forecast is when its error counts as surprise, and how long that is remembered."""
SPEED_CLASSES = ("still", "slow", "brisk")
GRADES = ("calm", "usual", "surprising")
"""Of those of whom a surprise is known."""
NEW = "new"
CLASSES = tuple(f"{speed}, {grade}" for speed in SPEED_CLASSES for grade in (*GRADES, NEW))

_TRUNK = ("waist", "torso", "neck", "l_shoulder", "r_shoulder", "l_hip", "r_hip")


def trunk_speed(velocities: Velocities, skeleton: Skeleton) -> Floats:
    """(P,) speed of the trunk in m/s, the mean of its measured joints; NaN where none is.

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


def motion_class(speed_m_s: Floats, surprise_m: Floats, thresholds_m: Floats) -> NDArray[np.intp]:
    """(P,) index into ``CLASSES``.

    Args:
        speed_m_s: (P,) see ``trunk_speed``.
        surprise_m: (P,) metres; NaN where no forecast is old enough.
        thresholds_m: (3, 2) of each speed class, between calm and usual, and usual and surprising.
    """
    fast = speed_class(speed_m_s)
    grade = (surprise_m[:, None] >= thresholds_m[fast]).sum(1)
    grade = np.where(np.isnan(surprise_m), len(GRADES), grade)
    return fast * (len(GRADES) + 1) + grade
