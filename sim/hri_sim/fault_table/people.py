"""People of the stories: entries of ``source.people``, and what they do."""

from collections.abc import Mapping, Sequence
from typing import Any

Step = Mapping[str, Any]
Person = dict[str, Any]


def person(start: Sequence[float], *script: Step, **more: Any) -> Person:
    """Return a person who plays this script once from a place; ``more`` as in ``source.people``."""
    return {"start": start, "repeat": False, "script": list(script), **more}


def stands(place: Sequence[float], seconds: float = 30.0) -> Person:
    """Return a person who stands at a place."""
    return {"start": place, "script": [wait(seconds)]}


def wait(seconds: float) -> Step:
    """Stand."""
    return {"do": "wait", "seconds": seconds}


def leave() -> Step:
    """Return a step: leave for good."""
    return {"do": "leave", "seconds": 3600.0}


def walk(to: Sequence[float], **how: Any) -> Step:
    """Return a step: walk to a place on the floor."""
    return {"do": "walk", "to": to, **how}


def reach(to: Sequence[float], **how: Any) -> Step:
    """Return a step: reach to a point with the right hand."""
    return {"do": "reach", "hand": "right", "to": to, **how}


FAR = stands([4.5, 0.2])
"""A person who stands far enough away for the robot to run."""


DEMO_ROBOT = {
    "name": "arm",
    "model": "ur5e",
    "room_from_robot": {"xyz": [0, 0, 0]},
    "payload_kg": 2.0,
    "max_speed_m_s": 1.0,
}
"""The robot of the demo, for stories that change its settings."""


def comes(hold_s: float) -> Person:
    """Return a person who walks up to a robot at full speed and reaches into its path."""
    return person(
        [4.5, 0.2],
        wait(4.0),
        walk([1.0, 0.1], speed_m_s=1.4),
        reach([0.6, 0.1, 0.8], hold_s=hold_s),
    )


def reaches_out(waits_s: float, **more: Any) -> Person:
    """Return a person who walks to 1.2 m from the robot, waits long, then reaches into its path."""
    return person(
        [3.6, 2.4],
        walk([1.75, 0.1], via=[[2.4, 0.9]]),
        wait(waits_s),
        walk([1.12, 0.1], speed_m_s=1.0),
        reach([0.72, 0.1, 0.64], hold_s=8.0),
        id=1,
        **more,
    )


def walks_out(waits_s: float, place: Sequence[float]) -> Person:
    """Return a colleague with id 2, who stands at a place and walks out through the exit."""
    return person(place, wait(waits_s), walk([4.0, 2.8], via=[[3.3, 2.1]]), leave(), id=2)
