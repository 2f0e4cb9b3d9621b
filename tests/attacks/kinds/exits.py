"""A2: a person who did not leave counts as left, because an exit is near in space."""

from collections.abc import Callable

import numpy as np

from hri_predict.base.arrays import Floats
from tests.attacks.people import at, reach_in, seen_of, walk
from tests.attacks.play import ALL, Attack

_DOOR = np.array([3.7, 2.5])
"""The middle of the exit."""


def _returns(
    rng: np.random.Generator, turn: Floats, back_s: float, speed: float
) -> tuple[float, Callable[[float], Floats]]:
    """A walk from a turning point to a place beside the robot, and when the hand goes in."""
    bearing = float(rng.uniform(-0.3, 0.3))
    there_s = back_s + float(np.hypot(*(turn - at(bearing, 1.15)))) / speed
    reach_s = there_s + float(rng.uniform(0.5, 4.0))

    def joints(t: float) -> Floats:
        if t < there_s + 0.1:
            return walk(t, [turn, at(bearing, 1.15)], speed, back_s)
        return reach_in(t, reach_s, bearing)

    return reach_s, joints


def inside(rng: np.random.Generator) -> Attack:
    """Lost some way inside the exit on the way out; turns there and comes back unseen."""
    depth_m, speed = rng.uniform(0.1, 0.5), rng.uniform(0.8, 1.5)
    start = np.array([1.5, 0.5])
    way = (_DOOR - start) / np.hypot(*(_DOOR - start))
    edge_m = min((3.2 - start[0]) / way[0], (2.0 - start[1]) / way[1])
    edge_m = max((3.2 - start[0]) / way[0], (2.0 - start[1]) / way[1], edge_m)
    lost = start + way * (edge_m + depth_m)
    turn = lost + way * rng.uniform(0.0, 0.2)
    out_s = 2.0
    turn_s = out_s + float(np.hypot(*(turn - start))) / speed
    lost_s = out_s + float(np.hypot(*(lost - start))) / speed
    reach_s, back = _returns(rng, turn, turn_s + rng.uniform(0.3, 2.0), rng.uniform(0.8, 1.5))

    def joints(t: float) -> Floats:
        return walk(t, [start, turn], speed, out_s) if t < turn_s else back(t)

    return Attack(
        name=f"lost {depth_m:.2f} m inside the exit at {speed:.1f} m/s, comes back unseen",
        truth=lambda t: [joints(t)],
        seen=lambda t, k: [(1, joints(t))] if t < lost_s else [],
        seconds=reach_s + 3.0,
    )


def passes(rng: np.random.Generator) -> Attack:
    """Passes the exit at a small distance, while something hides the legs or the upper body."""
    side_m, speed = rng.uniform(0.02, 0.25), rng.uniform(0.8, 1.5)
    start, turn = np.array([3.2 - side_m, 0.3]), np.array([3.2 - side_m, rng.uniform(2.2, 2.8)])
    out_s = 2.0
    turn_s = out_s + float(turn[1] - start[1]) / speed
    hidden_s = out_s + float(rng.uniform(1.2, 1.8)) / speed
    lost_s = float(rng.uniform(hidden_s + 0.1, turn_s))
    visible = seen_of("arms", "head") if rng.random() < 0.7 else seen_of("legs")
    reach_s, back = _returns(rng, turn, turn_s + rng.uniform(0.1, 2.0), rng.uniform(0.8, 1.5))

    def joints(t: float) -> Floats:
        return walk(t, [start, turn], speed, out_s) if t < turn_s else back(t)

    return Attack(
        name=f"passes the exit {side_m:.2f} m beside it, half hidden, comes back unseen",
        truth=lambda t: [joints(t)],
        seen=lambda t, k: [(1, joints(t), ALL if t < hidden_s else visible)] if t < lost_s else [],
        seconds=reach_s + 3.0,
    )


def crouches(rng: np.random.Generator) -> Attack:
    """Steps a little into the exit, crouches there and is hidden; comes back unseen."""
    depth_m, speed = rng.uniform(0.05, 0.4), rng.uniform(0.7, 1.3)
    start, turn = np.array([1.6, 2.5]), np.array([3.2 + depth_m, 2.5])
    out_s = 1.5
    turn_s = out_s + float(turn[0] - start[0]) / speed
    lost_s = turn_s + float(rng.uniform(-0.1, 0.8))
    back_s = turn_s + float(rng.uniform(1.0, 3.0))
    reach_s, back = _returns(rng, turn, back_s, rng.uniform(0.8, 1.5))

    def joints(t: float) -> Floats:
        if t >= back_s:
            return back(t)
        down = float(np.clip((t - turn_s) / 0.5, 0.0, 1.0)) * 0.45
        return walk(t, [start, turn], speed, out_s, crouch=down)

    return Attack(
        name=f"crouches {depth_m:.2f} m inside the exit, hidden, comes back unseen",
        truth=lambda t: [joints(t)],
        seen=lambda t, k: [(1, joints(t))] if t < lost_s else [],
        seconds=reach_s + 3.0,
    )
