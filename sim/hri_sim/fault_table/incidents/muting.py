"""Requests for muting that are repeated: people are ignored for the configured time in all."""

from hri_predict.protocol.reasons import Reason
from hri_sim.fault_table.incident import ALL_MODES, Incident
from hri_sim.fault_table.people import DEMO_ROBOT, comes

_COMES = comes(hold_s=8.0)

_MUTABLE = {"robots": [{**DEMO_ROBOT, "modes": {"muting": {"max_s": 2}}}]}
"""The demo's robot, which may be muted."""


def _repeated(name: str, period_s: float, released_s: float) -> Incident:
    """A request that is released for a moment every ``period_s``, from 2 s on."""
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
