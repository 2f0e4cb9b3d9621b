"""Scripts of people at work beside a robot, by name: they need no recording.

Each person works about the origin; the robot is on the side of -x, where the person looks.
"""

from typing import Any

_TO_ROBOT = 3.1415926


def _gesture(hand: str, at: tuple[float, float, float], hold_s: float) -> dict[str, Any]:
    """A hand rises at some words."""
    ahead, aside, up = at
    to = [-ahead, aside, up]
    return {"do": "reach", "hand": hand, "to": to, "hold_s": hold_s}


def _reach_in() -> dict[str, Any]:
    """An easy reach toward the robot, and back."""
    return {"do": "reach", "hand": "right", "to": [-0.6, 0.05, 1.05], "hold_s": 0.8}


SCRIPTS: dict[str, dict[str, Any]] = {
    "talking": {
        "start": [0.0, 0.0],
        "yaw": _TO_ROBOT,
        "script": [
            {"do": "wait", "seconds": 1.5},
            _gesture("right", (0.35, 0.25, 1.2), 0.6),
            _gesture("left", (0.4, -0.2, 1.25), 0.4),
            {"do": "wait", "seconds": 1.0},
            _gesture("right", (0.4, 0.15, 1.3), 0.3),
            _gesture("right", (0.3, 0.3, 1.15), 0.8),
            {"do": "wait", "seconds": 2.0},
        ],
    },
    "reaching": {
        "start": [0.0, 0.0],
        "yaw": _TO_ROBOT,
        "script": [
            {"do": "wait", "seconds": 2.0},
            _reach_in(),
            {"do": "wait", "seconds": 1.5},
            _reach_in(),
            {"do": "wait", "seconds": 2.0},
        ],
    },
    "passing": {
        "start": [0.0, -2.5],
        "script": [
            {"do": "walk", "to": [0.0, 2.5]},
            {"do": "walk", "to": [0.0, -2.5]},
        ],
    },
}
"""``PersonSettings`` of each."""
