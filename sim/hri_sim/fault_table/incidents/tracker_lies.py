"""Trackers that lost a person and go on sending one, while the person walks to the robot."""

from hri_predict.protocol.reasons import Reason
from hri_sim.fault_table.incident import ALL_MODES, Incident
from hri_sim.fault_table.people import person, wait, walk

_WALKS_UP = person([4.6, 0.3], wait(1.0), walk([1.0, 0.1]), wait(9.0))
_STANDS = person([4.6, 0.3], wait(30.0))
_LOST_S = 2.3
"""In the middle of a step."""


def _lie(name: str, fault: str, known_s: float) -> Incident:
    """A story in which the lie must be known ``known_s`` after it began."""
    return Incident(
        name=f"tracker lies: {name}",
        people=(_WALKS_UP,),
        duration_s=9.0,
        faults=(f"made_up@{_LOST_S}:{fault}",),
        modes=ALL_MODES,
        not_clear=(_LOST_S + known_s, 9.0),
        says=(Reason.INPUT_REPEATS,),
    )


TRACKER_LIES = (
    _lie("the last skeleton again, with noise", "how=hold", 0.5),
    _lie("the last motion goes on sideways", "how=coast", 0.8),
    _lie("the last 12 captures again and again, with noise", "how=loop,captures=12", 1.2),
    Incident(
        name="tracker lies: none, a person stands still",
        people=(_STANDS,),
        duration_s=9.0,
        moving=(2.0, 9.0),
        never_says=(Reason.INPUT_REPEATS, Reason.INPUT_RELATIVE, Reason.INPUT_FROZEN),
    ),
    Incident(
        name="tracker lies: none, a person walks up and stops",
        people=(_WALKS_UP,),
        duration_s=9.0,
        never_says=(Reason.INPUT_REPEATS, Reason.INPUT_RELATIVE, Reason.INPUT_FROZEN),
    ),
)
