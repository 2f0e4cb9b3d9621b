"""Robots that send false reports, or do not follow their advice."""

from hri_predict.protocol.reasons import Reason
from hri_sim.fault_table.incident import ALL_MODES, Incident
from hri_sim.fault_table.people import DEMO_ROBOT, FAR, comes, person, wait, walk

_COMES = comes(hold_s=4.0)
_STAYS = person([3.2, 0.2], walk([1.8, 0.2]), wait(4.0))
"""Stays where the robot is slowed, and need not stop."""


_BY_FILE = {"robots": [{**DEMO_ROBOT, "motion": {"kind": "trajectory", "file": "pick_and_place"}}]}
"""The demo's robot, taken to follow its file although it does as advised."""


def _velocities(kind: str) -> Incident:
    return Incident(
        name=f"robot: velocities lie ({kind})",
        people=(_COMES,),
        duration_s=9.0,
        lies=({"kind": kind, "start_s": 3.0},),
        not_moving=(3.4, 6.0),
        says=(Reason.ROBOT_VELOCITY_WRONG,),
    )


ROBOT_LIES = (
    _velocities("flip"),
    _velocities("zero"),
    Incident(
        name="robot: velocities in degrees",
        people=(_COMES,),
        duration_s=9.0,
        lies=({"kind": "degrees"},),
        says=(Reason.ROBOT_STATE_INVALID,),  # which names the unit
    ),
    Incident(
        name="robot: position jumps",
        people=(FAR,),
        duration_s=8.0,
        lies=({"kind": "jump", "start_s": 3.0, "jump_rad": 0.8},),
        not_moving=(3.2, 5.5),
        says=(Reason.ROBOT_STATE_JUMPED,),
    ),
    Incident(
        name="robot: both controllers repeat a state of its motion",
        people=(FAR,),
        duration_s=8.0,
        lies=({"kind": "freeze", "start_s": 2.5},),
        not_moving=(2.8, 8.0),
        says=(Reason.ROBOT_STATE_FROZEN,),
    ),
    Incident(
        name="robot: both controllers hold its place, with true velocities",
        people=(FAR,),
        duration_s=8.0,
        lies=({"kind": "hold", "start_s": 2.5},),
        not_moving=(2.8, 3.2),  # then it stands, as it says, until it is released
        says=(Reason.ROBOT_STATE_FROZEN,),
    ),
    Incident(
        name="robot: both controllers say from one state to the next that it stands",
        people=(_COMES,),
        duration_s=9.0,
        lies=({"kind": "stand", "start_s": 3.5},),
        modes=ALL_MODES,
        not_moving=(3.7, 9.0),
        says=(Reason.ROBOT_STATE_FROZEN,),
    ),
    Incident(
        name="robot: one controller says that it has not moved since its start",
        people=(_COMES,),
        duration_s=9.0,
        lies=({"kind": "stand"},),
        liars=("monitor",),
        not_moving=(2.0, 4.5),
        says=(Reason.ROBOT_STATES_CONTRADICT,),
    ),
    Incident(
        name="robot: two controllers put it 0.5 m apart",
        people=(FAR,),
        duration_s=5.0,
        lies=({"kind": "jump", "jump_rad": 0.7},),
        liars=("drive",),
        not_moving=(0.0, 5.0),
        says=(Reason.ROBOT_STATES_CONTRADICT,),
    ),
    Incident(
        name="robot: obeys, and is configured to follow a file",
        people=(_COMES,),
        duration_s=9.0,
        settings=_BY_FILE,
        modes=ALL_MODES,
        not_moving=(1.0, 9.0),
        says=(Reason.ROBOT_STATES_CONTRADICT,),
    ),
    Incident(
        name="robot: ignores the advised speed",
        people=(_STAYS,),
        duration_s=9.0,
        lies=({"kind": "runs"},),
        says=(Reason.ROBOT_TOO_FAST,),
    ),
    Incident(
        name="robot: brakes six times slower",
        people=(FAR,),
        duration_s=9.0,
        faults=("blind@3.8+1.5",),
        lies=({"kind": "brakes_late", "factor": 6.0},),
        says=(Reason.ROBOT_STOPS_LATE,),
    ),
    Incident(
        name="robot: is truthful",
        people=(_COMES,),
        duration_s=9.0,
        moving=(3.0, 5.0),
        never_says=(
            Reason.ROBOT_STATE_FROZEN,
            Reason.ROBOT_STATES_CONTRADICT,
            Reason.ROBOT_VELOCITY_WRONG,
            Reason.ROBOT_STATE_JUMPED,
            Reason.ROBOT_TOO_FAST,
            Reason.ROBOT_STOPS_LATE,
        ),
    ),
)
