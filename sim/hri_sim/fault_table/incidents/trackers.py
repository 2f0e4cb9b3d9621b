"""Trackers that are late, lie, have wrong axes, or measure people's speed too coarsely."""

from typing import Any

from hri_predict.protocol.reasons import Reason
from hri_sim.fault_table.incident import ALL_MODES, Incident
from hri_sim.fault_table.people import person, reach, wait, walk

# -- scenes that arrive late for a long time, with true stamps -------------------------------------

_STANDS_NEAR = person([2.2, 0.2], wait(600.0))
_LASTS_S = 75.0
"""Long enough that a rule which accepts 1 ms/s as drift would accept these scenes again."""


def _late(name: str, fault: str, since_s: float) -> Incident:
    return Incident(
        name=f"late scenes: {name}",
        people=(_STANDS_NEAR,),
        duration_s=_LASTS_S,
        faults=(fault,),
        settings={"rate_hz": 10},
        not_moving=(since_s, _LASTS_S),
        moving=(1.0, 5.0),
        says=(Reason.CLOCK_DRIFT,),
    )


LATE_SCENES = (
    _late("by 170 ms, for good", "delay@5:delay_s=0.17", 6.0),
    _late("by 500 ms, for good", "delay@5:delay_s=0.5", 6.0),
    _late("ever later, by 1 ms/s", "delay@5:delay_s=0.1,growth=0.001", 60.0),
    Incident(
        name="late scenes: then in time again",
        people=(_STANDS_NEAR,),
        duration_s=60.0,
        faults=("delay@5+20:delay_s=0.25",),
        settings={"rate_hz": 10},
        not_moving=(6.0, 25.0),
        moving=(50.0, 60.0),
        says=(Reason.CLOCK_DRIFT,),
    ),
)


# -- trackers that lost a person and go on sending one, while the person walks to the robot --------

_WALKS_UP = person([4.6, 0.3], wait(1.0), walk([1.0, 0.1]), wait(9.0))
_STANDS = person([4.6, 0.3], wait(30.0))
_LOST_S = 2.3
"""A time in the middle of a step."""


def _lie(name: str, fault: str, known_s: float) -> Incident:
    """Return a story in which the lie must be detected within ``known_s`` of its start."""
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
    _lie("the last motion continues sideways", "how=coast", 0.8),
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


# -- sources with wrong axes: impossible bodies are never a reason for *clear* ---------------------

_WALKS_BY = person([4.4, -1.6], walk([4.4, 1.6]), wait(2.0), walk([4.4, -1.6]), wait(9.0))
"""A person who passes far enough away for the robot to work, so that only wrong axes stop it."""
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
        "room axes taken for camera axes",
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


# -- people who are faster than the standard assumes, and sensors that hardly measure their --------


def _comes(speed_m_s: float, seconds: float = 6.0) -> dict[str, Any]:
    """Return a person who walks straight to the robot at a speed and stops one metre from it."""
    return person([9.0, 0.1], walk([1.2, 0.1], speed_m_s=speed_m_s), wait(seconds))


_HIPS_AND_HANDS = "hide@0+20:joints=[waist, torso, l_hip, r_hip, l_wrist, l_hand, r_wrist, r_hand]"
_SLOW_CAMERA = {"source": {"rate_hz": 8.0}, "people": {"max_gap_s": 0.1, "exits": []}}
"""Captures too far apart for resampling. Without exits: the person is too near one by then."""

FAST_PEOPLE = (
    Incident(
        name="fast: runs up to the robot",
        people=(_comes(4.0),),
        duration_s=8.0,
        moving=(0.5, 1.3),
        not_moving=(1.9, 6.0),
    ),
    Incident(
        name="fast: a runner whose hips and hands are hidden",
        people=(_comes(4.0),),
        duration_s=8.0,
        faults=(_HIPS_AND_HANDS,),
        not_moving=(1.9, 6.0),
    ),
    Incident(
        name="fast: a runner, seen 8 times a second",
        people=(_comes(4.0),),
        duration_s=8.0,
        settings=_SLOW_CAMERA,
        not_moving=(1.9, 6.0),
    ),
    Incident(
        name="fast: a walker, seen 8 times a second, is not",
        people=(_comes(1.0, seconds=2.0),),
        duration_s=9.0,
        settings=_SLOW_CAMERA,
        modes=("iso",),
        moving=(2.0, 5.0),
        never_says=(Reason.PERSON_FAST,),
    ),
)
