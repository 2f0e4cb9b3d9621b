"""Sources with wrong axes: impossible bodies are never a reason for *clear*."""

from hri_predict.protocol.reasons import Reason
from hri_sim.fault_table.incident import Incident
from hri_sim.fault_table.people import person, reach, wait, walk

_WALKS_BY = person([4.4, -1.6], walk([4.4, 1.6]), wait(2.0), walk([4.4, -1.6]), wait(9.0))
"""Walks past the cell, far enough for the robot to work: only the axes can be wrong here."""
_BENDS = person(
    [4.0, 0.5],
    wait(1.0),
    reach([3.4, 0.4, 0.7], hold_s=2.0),
    walk([4.4, -1.0], backwards=True),
    wait(2.0),
    walk([4.4, 1.0]),
    wait(9.0),
)
_S = "0.7071067811865476"
_ABOUT = "about=[4.4,0,1.4]"


def _wrong(name: str, fault: str, not_clear: tuple[float, float]) -> Incident:
    return Incident(
        name=f"wrong axes: {name}",
        people=(_WALKS_BY,),
        duration_s=8.0,
        faults=(fault,),
        not_moving=not_clear,
        says=(Reason.BODY_NOT_UPRIGHT,),
    )


WRONG_AXES = (
    _wrong(
        "the room's taken for a camera's",
        f"rotate:quaternion_xyzw=[0.5,-0.5,0.5,-0.5],{_ABOUT}",
        (0.5, 8.0),
    ),
    _wrong("bodies lie", f"rotate:quaternion_xyzw=[{_S},0,0,{_S}],{_ABOUT}", (0.5, 8.0)),
    _wrong("bodies hang upside down", f"rotate:quaternion_xyzw=[1,0,0,0],{_ABOUT}", (0.5, 8.0)),
    _wrong("left and right are swapped", "mirror:at_y=0", (1.0, 8.0)),
    _wrong(
        "the camera falls over", f"rotate@3:quaternion_xyzw=[0,{_S},0,{_S}],{_ABOUT}", (4.5, 8.0)
    ),
    Incident(
        name="wrong axes: none, a person reaches low and walks backwards",
        people=(_BENDS,),
        duration_s=14.0,
        moving=(1.0, 14.0),
        never_says=(Reason.BODY_NOT_UPRIGHT,),
    ),
)
