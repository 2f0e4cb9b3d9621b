"""Robots that travel far and are reported at a wrong place, while a person stands in their way."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from hri_predict.protocol.reasons import Reason
from hri_sim.fault_table.incident import ALL_MODES, Incident
from hri_sim.fault_table.people import person, reach, wait, walk

_PATHS = Path(__file__).parent.parent / "paths"
_VEHICLE = {
    "model": "ur5e",
    "payload_kg": 2.0,
    "max_speed_m_s": 1.1,
    "base": {
        "kind": "state",
        "base_from_robot": {"xyz": [0.15, 0, 0.6]},
        "capsules": [{"name": "body", "a": [-0.25, 0, 0.3], "b": [0.25, 0, 0.3], "radius": 0.35}],
        "max_speed_m_s": 1.0,
        "max_turn_rad_s": 0.6,
        "uncertainty_m": 0.02,
        "uncertainty_rad": 0.01,
        "stopping": {
            "source": "Made up: full speed for 0.1 s, then uniform deceleration of 2 m/s2.",
            "speed_m_s": [0.1, 0.25, 0.5, 1.0, 1.5],
            "rows": [
                {
                    "payload_kg": 100,
                    "time_s": [0.15, 0.225, 0.35, 0.6, 0.85],
                    "distance_m": [0.0125, 0.0407, 0.1125, 0.35, 0.7125],
                }
            ],
        },
    },
}
"""As in ``configs/simulate_mobile.yaml``."""


def _walks_up(start: list[float], to: list[float], wait_s: float) -> Mapping[str, Any]:
    """A person who walks into the robot's path in full view, and stays there."""
    return person(start, wait(wait_s), walk(to, speed_m_s=1.4), wait(60.0))


def _elsewhere(
    name: str,
    path: str,
    robot: Mapping[str, Any],
    person: Mapping[str, Any],
    **story: Any,
) -> Incident:
    """Return a story of the demo's cell with another robot, which follows a path of this folder."""
    usual: dict[str, Any] = {"name": "arm", "motion": {"kind": "state", "stale_s": 0.1}}
    if "base" not in robot:
        usual["room_from_robot"] = {"xyz": [0, 0, 0]}
    robots = [{**usual, **robot}]
    return Incident(
        name=f"robot elsewhere: {name}",
        people=(person,),
        settings={"robots": robots, "people": {"exits": []}},
        simulate={"trajectory": str(_PATHS / path), "max_age_s": 0.4},
        **story,
    )


def _drives(name: str, **story: Any) -> Incident:
    """Return a story in which a vehicle drives a long way, and a person walks up to its path."""
    walker = _walks_up([6.5, -2.5], [2.6, -0.2], 6.0)
    return _elsewhere(name, _LONG_WAY, _VEHICLE, walker, modes=ALL_MODES, **story)


def _reaches_into_its_way(wait_s: float, speed_m_s: float) -> Mapping[str, Any]:
    return person(
        [2.5, -4.5],
        wait(wait_s),
        walk([0.25, -1.5], speed_m_s=speed_m_s),
        wait(0.4),
        reach([0.1, -1.05, 0.9], hold_s=8.0),
        wait(20.0),
    )


def _frozen_on_its_way(since_s: float, wait_s: float, speed_m_s: float) -> Incident:
    """Return a story: both controllers report a still arm, and a person reaches into its path."""
    return _elsewhere(
        f"an arm that swings to another station is frozen at {since_s} s",
        "swings_across.yaml",
        _UR10E,
        _reaches_into_its_way(wait_s, speed_m_s),
        duration_s=16.0,
        lies=({"kind": "stand", "start_s": since_s},),
        not_moving=(since_s + 0.2, 16.0),
        says=(Reason.ROBOT_STATE_FROZEN,),
    )


def _frozen_while_it_stands(since_s: float, wait_s: float, speed_m_s: float) -> Incident:
    """Return the same story with an arm still at its first station; ``still_s`` detects the lie."""
    return _elsewhere(
        f"an arm that stands at a station is frozen at {since_s} s",
        "swings_across.yaml",
        _DOUBTED,
        _reaches_into_its_way(wait_s, speed_m_s),
        duration_s=20.0,
        lies=({"kind": "stand", "start_s": since_s},),
        modes=ALL_MODES,
        not_moving=(4.0, 20.0),
        says=(Reason.ROBOT_STATE_FROZEN,),
    )


def _waits(name: str, script: Sequence[Mapping[str, Any]], **story: Any) -> Incident:
    """Return a story of an arm that reports the truth and waits at a station for 4 s."""
    return _elsewhere(
        f"not frozen: an arm waits at a station, {name}",
        "swings_and_waits.yaml",
        _DOUBTED,
        person([2.5, -4.5], *script),
        **story,
    )


_UR10E: Mapping[str, Any] = {"model": "ur10e", "payload_kg": 5.0, "max_speed_m_s": 1.2}
_DOUBTED = {**_UR10E, "motion": {"kind": "state", "stale_s": 0.1, "still_s": 2.0}}
_LONG_WAY = "vehicle_drives_far.yaml"
_RAIL = "rail_end_to_end.yaml"

ROBOTS_ELSEWHERE = (
    _drives(
        "a vehicle's place is frozen while it drives",
        duration_s=16.0,
        lies=({"kind": "stand", "start_s": 6.0},),
        not_moving=(6.2, 16.0),
        says=(Reason.ROBOT_STATE_FROZEN,),
    ),
    _drives(
        "one of two controllers reports that the vehicle stands",
        duration_s=16.0,
        lies=({"kind": "stand", "start_s": 3.0},),
        liars=("monitor",),
        not_moving=(6.0, 16.0),
        says=(Reason.ROBOT_STATES_CONTRADICT,),
    ),
    _drives(
        "not frozen: a vehicle drives up",
        duration_s=9.0,
        moving=(1.0, 6.0),
        never_says=(Reason.ROBOT_STATE_FROZEN, Reason.ROBOT_STATES_CONTRADICT),
    ),
    _frozen_on_its_way(4.7, wait_s=5.2, speed_m_s=1.2),
    _frozen_on_its_way(4.9, wait_s=4.4, speed_m_s=1.3),
    _frozen_while_it_stands(0.0, wait_s=2.5, speed_m_s=1.0),
    _frozen_while_it_stands(1.0, wait_s=2.5, speed_m_s=1.0),
    _waits(
        "people are far away",
        [wait(20.0)],
        duration_s=8.0,
        modes=ALL_MODES,
        moving=(4.0, 8.0),
        never_says=(Reason.ROBOT_STATE_FROZEN,),
    ),
    _waits(
        "a person comes within its reach and goes again",
        [
            walk([1.5, -2.6], speed_m_s=1.4),
            wait(4.0),
            walk([2.5, -4.8], speed_m_s=1.4),
            wait(20.0),
        ],
        duration_s=13.0,
        not_moving=(4.0, 5.5),
        moving=(10.0, 13.0),
        says=(Reason.ROBOT_STATE_FROZEN,),
    ),
    _elsewhere(
        "obeys, and is configured to follow a file",
        _RAIL,
        {
            "model": "ur10e_rail",
            "payload_kg": 5.0,
            "max_speed_m_s": 1.2,
            "motion": {"kind": "trajectory", "file": str(_PATHS / _RAIL)},
        },
        _walks_up([6.5, 0.3], [2.6, 0.15], 5.0),
        duration_s=28.0,
        modes=ALL_MODES,
        not_moving=(4.0, 28.0),
        says=(Reason.ROBOT_STATES_CONTRADICT,),
    ),
)
