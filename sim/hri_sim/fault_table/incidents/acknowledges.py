"""Acknowledges without a person who presses, while a person hides beside the robot."""

from typing import Any

from hri_predict.protocol.reasons import Reason
from hri_sim.fault_table.incident import Incident
from hri_sim.fault_table.people import leave, person, reach, wait, walk

_HIDES = person(
    [3.6, 2.4], walk([1.3, 0.1], via=[[2.4, 0.9]]), wait(12.0), reach([0.72, 0.1, 0.64], hold_s=8.0)
)
"""Walks up to the robot, is no longer seen there, and reaches into its way 12 s later."""

_WENT = person([-2.0, 2.5], wait(4.0), leave())
"""Leaves by a way that the node does not know."""


def _by_itself(
    name: str, says: tuple[Reason, ...], *modes: str, latch: tuple[str, ...] = (), **how: Any
) -> Incident:
    return Incident(
        name=f"acknowledge: {name}",
        people=(_HIDES,),
        duration_s=22.0,
        faults=("vanish@4.2+18:person=1",),
        settings={"risk": {"latch": list(latch)}},
        lies=({"kind": "acknowledges", **how},),
        modes=modes or ("predictive", "iso"),
        not_clear=(4.2, 22.0),
        not_moving=(4.5, 22.0),
        says=says,
    )


_LOST = (Reason.PERSON_LOST,)

ACKNOWLEDGES = (
    _by_itself("a taped button", _LOST, "predictive", "iso", "fixed", period_s=0.2),
    _by_itself("by program every 4 s", _LOST, period_s=4.0),
    _by_itself("by program every 10 s", _LOST, period_s=10.0),
    _by_itself("of nothing, as protocol version 2 did", _LOST, period_s=0.5, names="nothing"),
    _by_itself("two old ones in turn", _LOST, period_s=0.5, ids=2, names="first"),
    # While the person is lost, that is the reason. The latch shows as one once it is over.
    _by_itself("a taped button, latched", _LOST, latch=("stop", "lost"), period_s=1.0),
    Incident(
        name="acknowledge: by an operator, once, and the cell works on",
        people=(_WENT,),
        duration_s=24.0,
        lies=({"kind": "acknowledges", "start_s": 16.0, "duration_s": 0.5},),
        not_moving=(10.0, 16.0),
        moving=(17.0, 24.0),
        says=_LOST,
    ),
)
