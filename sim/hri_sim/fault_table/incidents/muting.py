"""Requests for muting that are repeated: people are ignored for the configured time in all."""

from hri_predict.protocol.reasons import Reason
from hri_sim.fault_table.incident import Incident

_COMES = {
    "start": [4.5, 0.2],
    "repeat": False,
    "script": [
        {"do": "wait", "seconds": 4.0},
        {"do": "walk", "to": [1.0, 0.1], "speed_m_s": 1.4},
        {"do": "reach", "hand": "right", "to": [0.6, 0.1, 0.8], "hold_s": 8.0},
    ],
}
"""Walks up to a robot at full speed and reaches into its way."""

_MUTABLE = {
    "robots": [
        {
            "name": "arm",
            "model": "ur5e",
            "room_from_robot": {"xyz": [0, 0, 0]},
            "payload_kg": 2.0,
            "max_speed_m_s": 1.0,
            "modes": {"muting": {"max_s": 2}},
        }
    ]
}
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
        modes=("predictive", "iso", "fixed"),
        not_moving=(6.6, 12.0),
        says=(Reason.MUTED,),
    )


MUTING = (
    _repeated("muting: the request is released for a moment every 2 s", 2.0, 0.06),
    _repeated("muting: the request is released for a moment every 0.7 s", 0.7, 0.06),
    _repeated("muting: the request is released for half of the time", 1.0, 0.5),
)
