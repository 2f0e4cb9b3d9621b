"""How fast people are, for tests that build their bodies by hand."""

import numpy as np

from hri_predict.zones.human_speed import HumanSpeeds


def speeds_of(*v_h: float, segments: int = 1) -> HumanSpeeds:
    """People whose v_h is this; 0: they move as the standard assumes; inf: nobody knows."""
    speed = np.array(v_h, float)
    unknown = np.isinf(speed)
    counts = np.where(unknown, 10.0, speed)
    return HumanSpeeds(
        fast=(speed > 0) & ~unknown,
        unknown=unknown,
        fastest_m_s=np.where(unknown, 0.0, speed),
        fastest_joint=np.zeros(len(speed), np.intp),
        beyond_standard_m_s=np.repeat(counts[:, None], segments, axis=1),
    )
