"""A lost person whose joints were all seen last."""

from typing import Any

import numpy as np

from hri_predict.base.arrays import Floats
from hri_predict.people.snapshot import LostPerson


def lost_person(number: int, positions: Floats, last_seen_ns: int, **differs: Any) -> LostPerson:
    """Somebody who walked, with what ``differs``."""
    joints = len(positions)
    return LostPerson(
        id=number,
        positions=positions,
        last_seen_ns=last_seen_ns,
        **{
            "joint_age_s": np.zeros(joints),
            "speed_m_s": 1.6,
            "limbs_m_s": np.zeros(joints),
            **differs,
        },
    )
