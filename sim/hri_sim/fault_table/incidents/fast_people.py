"""People who are faster than the standard assumes, and sensors that hardly measure their speed."""

from typing import Any

from hri_predict.protocol.reasons import Reason
from hri_sim.fault_table.incident import Incident
from hri_sim.fault_table.people import person, wait, walk


def _comes(speed_m_s: float, seconds: float = 6.0) -> dict[str, Any]:
    """Comes straight towards the robot at a speed, and stays a metre before it."""
    return person([9.0, 0.1], walk([1.2, 0.1], speed_m_s=speed_m_s), wait(seconds))


_HIPS_AND_HANDS = "hide@0+20:joints=[waist, torso, l_hip, r_hip, l_wrist, l_hand, r_wrist, r_hand]"
_SLOW_CAMERA = {"source": {"rate_hz": 8.0}, "people": {"max_gap_s": 0.1, "exits": []}}
"""Captures too far apart for the node to resample between them; by then the exit is too close."""

FAST_PEOPLE = (
    Incident(
        name="fast: runs up to the robot",
        people=(_comes(4.0),),
        duration_s=8.0,
        moving=(0.5, 1.3),
        not_moving=(1.9, 6.0),
    ),
    Incident(
        name="fast: a runner whose hips and hands are hidden",
        people=(_comes(4.0),),
        duration_s=8.0,
        faults=(_HIPS_AND_HANDS,),
        not_moving=(1.9, 6.0),
    ),
    Incident(
        name="fast: a runner, seen 8 times a second",
        people=(_comes(4.0),),
        duration_s=8.0,
        settings=_SLOW_CAMERA,
        not_moving=(1.9, 6.0),
    ),
    Incident(
        name="fast: a walker, seen 8 times a second, is not",
        people=(_comes(1.0, seconds=2.0),),
        duration_s=9.0,
        settings=_SLOW_CAMERA,
        modes=("iso",),
        moving=(2.0, 5.0),
        never_says=(Reason.PERSON_FAST,),
    ),
)
