"""Robots that send false reports or do not follow their advice; two nodes on one wire."""

from collections.abc import Mapping
from typing import Any

from hri_predict.protocol.reasons import Reason
from hri_sim.fault_table.incident import ALL_MODES, Incident
from hri_sim.fault_table.people import DEMO_ROBOT, FAR, comes, person, stands, wait, walk

_COMES = comes(hold_s=4.0)
_STAYS = person([3.2, 0.2], walk([1.8, 0.2]), wait(4.0))
"""A person who stays at a distance at which the robot slows down but need not stop."""


_BY_FILE = {"robots": [{**DEMO_ROBOT, "motion": {"kind": "trajectory", "file": "pick_and_place"}}]}
"""The demo's robot, configured to follow its file although it obeys advice."""


def _robot(name: str, says: Reason, lie: Mapping[str, Any] | None = None, **story: Any) -> Incident:
    """Return a story with one lie and, by default, a person who approaches."""
    usual: dict[str, Any] = {"people": (_COMES,), "duration_s": 9.0, "lies": (lie,) if lie else ()}
    return Incident(name=f"robot: {name}", says=(says,), **usual | story)


_FROZEN, _CONTRADICT = Reason.ROBOT_STATE_FROZEN, Reason.ROBOT_STATES_CONTRADICT
_FAR: dict[str, Any] = {"people": (FAR,), "duration_s": 8.0}

ROBOT_LIES = (
    *(
        _robot(
            f"velocities lie ({kind})",
            Reason.ROBOT_VELOCITY_WRONG,
            {"kind": kind, "start_s": 3.0},
            not_moving=(3.4, 6.0),
        )
        for kind in ("flip", "zero")
    ),
    _robot(  # its reason names the unit
        "velocities in degrees", Reason.ROBOT_STATE_INVALID, {"kind": "degrees"}
    ),
    _robot(
        "position jumps",
        Reason.ROBOT_STATE_JUMPED,
        {"kind": "jump", "start_s": 3.0, "jump_rad": 0.8},
        **_FAR | {"not_moving": (3.2, 5.5)},
    ),
    _robot(
        "both controllers repeat one state of its motion",
        _FROZEN,
        {"kind": "freeze", "start_s": 2.5},
        **_FAR | {"not_moving": (2.8, 8.0)},
    ),
    _robot(
        "both controllers repeat its position, with true velocities",
        _FROZEN,
        {"kind": "hold", "start_s": 2.5},
        **_FAR | {"not_moving": (2.8, 3.2)},  # then it stands, as it says, until it is released
    ),
    _robot(
        "both controllers suddenly report that it stands",
        _FROZEN,
        {"kind": "stand", "start_s": 3.5},
        modes=ALL_MODES,
        not_moving=(3.7, 9.0),
    ),
    _robot(
        "one controller reports no motion since the start",
        _CONTRADICT,
        {"kind": "stand"},
        liars=("monitor",),
        not_moving=(2.0, 4.5),
    ),
    _robot(
        "two controllers report places 0.5 m apart",
        _CONTRADICT,
        {"kind": "jump", "jump_rad": 0.7},
        liars=("drive",),
        **_FAR | {"duration_s": 5.0, "not_moving": (0.0, 5.0)},
    ),
    _robot(
        "obeys, and is configured to follow a file",
        _CONTRADICT,
        settings=_BY_FILE,
        modes=ALL_MODES,
        not_moving=(1.0, 9.0),
    ),
    _robot("ignores the advised speed", Reason.ROBOT_TOO_FAST, {"kind": "runs"}, people=(_STAYS,)),
    _robot(
        "brakes six times slower",
        Reason.ROBOT_STOPS_LATE,
        {"kind": "brakes_late", "factor": 6.0},
        people=(FAR,),
        faults=("blind@3.8+1.5",),
    ),
    Incident(
        name="robot: truthful",
        people=(_COMES,),
        duration_s=9.0,
        moving=(3.0, 5.0),
        never_says=(
            _FROZEN,
            _CONTRADICT,
            Reason.ROBOT_VELOCITY_WRONG,
            Reason.ROBOT_STATE_JUMPED,
            Reason.ROBOT_TOO_FAST,
            Reason.ROBOT_STOPS_LATE,
        ),
    ),
)


# -- two nodes with the same ids on one wire -------------------------------------------------------

_FAR_OFF = stands([5.0, 3.0], 20.0)
"""A person who stands far enough away for the robot to move."""

_WALKS_IN = person([5.0, 3.0], wait(3.0), walk([1.3, 0.2]), wait(9.0))
"""A person who walks up to the robot while another node on the bus sees an empty room."""

SECOND_SENDER = (
    Incident(
        name="second sender: stops an idle cell, and releases it",
        people=(_FAR_OFF,),
        duration_s=18.0,
        faults=("monitor:second_sender@5+3",),
        moving=(13.0, 18.0),
        not_moving=(5.1, 9.9),
        says=(Reason.SECOND_SENDER,),
    ),
    Incident(
        name="second sender: says clear while a person walks in",
        people=(_WALKS_IN,),
        duration_s=14.0,
        faults=("drive:second_sender@2+12", "monitor:second_sender@2+12"),
        not_moving=(2.1, 14.0),
        says=(Reason.SECOND_SENDER,),
    ),
)
