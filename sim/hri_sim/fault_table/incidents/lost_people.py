"""People whom the tracker loses while they are in the room."""

from hri_sim.fault_table.incident import Incident

_REACHES_OUT = {
    "start": [3.6, 2.4],
    "repeat": False,
    "script": [
        {"do": "walk", "via": [[2.4, 0.9]], "to": [1.75, 0.1]},
        {"do": "wait", "seconds": 12.0},
        {"do": "walk", "to": [1.3, 0.1], "speed_m_s": 1.0},
        {"do": "reach", "hand": "right", "to": [0.75, 0.1, 1.0], "hold_s": 4.0},
    ],
}
"""Walks up to 1.2 m from the robot's base, stands there for long, then reaches for the robot."""

LOST_PEOPLE = (
    Incident(
        name="lost: behind a pallet, then reaches out",
        people=(_REACHES_OUT,),
        duration_s=24.0,
        faults=("vanish@5+19:person=1",),
        not_clear=(5.0, 24.0),
    ),
)
