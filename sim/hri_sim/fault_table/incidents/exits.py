"""People who vanish in an exit, or at its edge, and have not left by it; and one who has."""

from typing import Any

from hri_predict.base.skeleton import JOINTS
from hri_predict.protocol.reasons import Reason
from hri_sim.fault_table.incident import Incident
from hri_sim.fault_table.people import leave, person, reach, walk

_EXIT = {"polygon": [[3.2, 2.0], [4.2, 2.0], [4.2, 3.0], [3.2, 3.0]]}
_ENDS_S = 16.0
_LEGS = ",".join(name for name in JOINTS if name[2:] in ("knee", "ankle", "foot"))


def _and_back(start: list[float], to: list[float], speed_m_s: float = 1.2) -> dict[str, Any]:
    """Walks somewhere, and at once back to the robot, to reach into its way."""
    return person(
        start,
        walk(to, speed_m_s=speed_m_s),
        walk([1.12, 0.1]),
        reach([0.72, 0.1, 0.64], hold_s=6.0),
    )


def _returns(
    name: str, person: dict[str, Any], gone_s: float, *faults: str, **exit_: Any
) -> Incident:
    """Vanishes at the exit at ``gone_s``, and comes back to the robot unseen."""
    return Incident(
        name=f"exit: {name}",
        people=(person,),
        duration_s=_ENDS_S,
        faults=(*faults, f"vanish@{gone_s}+{_ENDS_S}:person=1"),
        settings={"source": {"keeps_ids": False}, "people": {"exits": [_EXIT | exit_]}},
        not_clear=(gone_s + 1.5, _ENDS_S),
        says=(Reason.PERSON_LOST,),
    )


EXITS = (
    _returns(
        "lost a third of a metre inside, on the way out", _and_back([1.5, 0.5], [3.8, 2.6]), 2.7
    ),
    _returns("turns round before the side that leads out", _and_back([1.8, 0.6], [4.0, 2.8]), 3.45),
    _returns(
        "passes its edge, and a pallet hides the legs",
        _and_back([3.3, 0.2], [3.3, 2.9]),
        2.75,
        f"hide@1.9+1:person=1,joints=[{_LEGS}]",
    ),
    _returns(
        "passes by the line that leads out",
        _and_back([3.7, 0.2], [3.7, 3.3]),
        3.1,
        out=[[4.2, 2.2], [4.2, 2.8]],
    ),
    Incident(
        name="exit: walks out, so the cell works on",
        people=(person([1.8, 0.6], walk([4.6, 3.2]), leave()),),
        duration_s=9.0,
        settings={"source": {"keeps_ids": False}, "people": {"exits": [_EXIT]}},
        moving=(6.5, 9.0),
        never_says=(Reason.PERSON_LOST,),
    ),
)
