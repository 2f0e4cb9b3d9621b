"""Latches, and acknowledges and muting requests that must have no effect."""

from collections.abc import Mapping
from typing import Any

from hri_predict.protocol.reasons import Reason
from hri_sim.fault_table.incident import ALL_MODES, Incident
from hri_sim.fault_table.people import (
    DEMO_ROBOT,
    FAR,
    comes,
    leave,
    person,
    reach,
    stands,
    wait,
    walk,
)

# -- motion that must wait for an acknowledgement: after the start, blindness, and lost people -----

_UNSEEN = stands([0.6, 0.3])
"""A person next to the robot from the start, not seen by the source."""


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


# -- acknowledges without a person who presses, while a person hides beside the robot --------------

_HIDES = person(
    [3.6, 2.4], walk([1.3, 0.1], via=[[2.4, 0.9]]), wait(12.0), reach([0.72, 0.1, 0.64], hold_s=8.0)
)
"""A person who walks up to the robot, is hidden there, and reaches into its path 12 s later."""

_WENT = person([-2.0, 2.5], wait(4.0), leave())
"""A person who leaves by an exit that the node does not know."""


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
    _by_itself("two old latch ids in turn", _LOST, period_s=0.5, ids=2, names="first"),
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


# -- requests for muting that are repeated: people are ignored for the configured time in all ------

_COMES = comes(hold_s=8.0)

_MUTABLE = {"robots": [{**DEMO_ROBOT, "modes": {"muting": {"max_s": 2}}}]}
"""The demo's robot, which may be muted."""


def _repeated(name: str, period_s: float, released_s: float) -> Incident:
    """Return a request that is briefly released every ``period_s``, from 2 s on."""
    asked = tuple(
        {"request": "muted", "start_s": 2.0 + k * period_s, "duration_s": period_s - released_s}
        for k in range(round(11.0 / period_s))
    )
    return Incident(
        name=name,
        people=(_COMES,),
        duration_s=12.0,
        settings=_MUTABLE,
        requests=asked,
        modes=ALL_MODES,
        not_moving=(6.6, 12.0),
        says=(Reason.MUTED,),
    )


MUTING = (
    _repeated("muting: the request is released for a moment every 2 s", 2.0, 0.06),
    _repeated("muting: the request is released for a moment every 0.7 s", 0.7, 0.06),
    _repeated("muting: the request is released for half of the time", 1.0, 0.5),
)
