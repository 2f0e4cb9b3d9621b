"""Scenes that arrive late for a long time, with true stamps: a bad switch, a person in the way."""

from hri_predict.protocol.reasons import Reason
from hri_sim.fault_table.incident import Incident
from hri_sim.fault_table.people import person, wait

_STANDS_NEAR = person([2.2, 0.2], wait(600.0))
_LASTS_S = 75.0
"""Long enough for a rule that accepts 1 ms/s as drift to believe these scenes again."""


def _late(name: str, fault: str, since_s: float) -> Incident:
    return Incident(
        name=f"late scenes: {name}",
        people=(_STANDS_NEAR,),
        duration_s=_LASTS_S,
        faults=(fault,),
        settings={"rate_hz": 10},
        not_moving=(since_s, _LASTS_S),
        moving=(1.0, 5.0),
        says=(Reason.CLOCK_DRIFT,),
    )


LATE_SCENES = (
    _late("by 170 ms, for good", "delay@5:delay_s=0.17", 6.0),
    _late("by 500 ms, for good", "delay@5:delay_s=0.5", 6.0),
    _late("ever later, by 1 ms/s", "delay@5:delay_s=0.1,growth=0.001", 60.0),
    Incident(
        name="late scenes: then in time again",
        people=(_STANDS_NEAR,),
        duration_s=60.0,
        faults=("delay@5+20:delay_s=0.25",),
        settings={"rate_hz": 10},
        not_moving=(6.0, 25.0),
        moving=(50.0, 60.0),
        says=(Reason.CLOCK_DRIFT,),
    ),
)
