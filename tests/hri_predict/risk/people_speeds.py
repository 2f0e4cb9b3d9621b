"""People whose bodies a test builds by hand, and how fast they are."""

from typing import Any

import numpy as np

from hri_predict.zones.body_zones import BodyZones
from hri_predict.zones.human_speed import HumanSpeeds
from hri_predict.zones.types import Zones


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


def bodies_in(zones: Zones, **more: Any) -> BodyZones:
    """People who are seen, stay in these zones and move as the standard and their zones assume."""
    people, segments = len(zones.ids), len(zones.segments)
    seen: dict[str, Any] = {
        "paths": zones.capsules,
        "lost": np.zeros(people, bool),
        "age_s": 0.05,
        "capture_ns": 10**9,
        "speeds": speeds_of(*np.zeros(people), segments=segments),
        "segments_m_s": np.zeros((people, segments)),
        "as_assumed": np.ones(people, bool),
    }
    return BodyZones(zones=zones, **(seen | more))
