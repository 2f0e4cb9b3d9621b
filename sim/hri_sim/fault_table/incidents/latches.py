"""Motion that must wait for an acknowledgement: after the start, blindness, and lost people."""

from collections.abc import Mapping
from typing import Any

from hri_predict.protocol.reasons import Reason
from hri_sim.fault_table.incident import Incident
from hri_sim.fault_table.people import FAR, stands

_UNSEEN = stands([0.6, 0.3])
"""Stands beside the robot from the start; the source does not see this person."""


def _latched(*causes: str) -> Mapping[str, Any]:
    return {"risk": {"latch": list(causes)}}


LATCHES = (
    Incident(
        name="latch start: a person not seen yet",
        people=(_UNSEEN,),
        duration_s=8.0,
        faults=("vanish@0+8:person=1",),
        settings=_latched("start"),
        not_moving=(0.0, 8.0),
        says=(Reason.LATCHED,),
    ),
    Incident(
        name="latch blind: blind for half a second",
        people=(FAR,),
        duration_s=9.0,
        faults=("blind@4+0.5",),
        settings=_latched("blind"),
        moving=(1.0, 4.0),
        not_moving=(4.1, 9.0),
        says=(Reason.LATCHED, Reason.SOURCE_BLIND),
    ),
    Incident(
        name="latch lost: a person vanishes and is found",
        people=(FAR,),
        duration_s=9.0,
        faults=("vanish@4+1:person=1",),
        settings=_latched("lost"),
        moving=(1.0, 4.0),
        not_moving=(5.0, 9.0),
        says=(Reason.LATCHED,),
    ),
)
