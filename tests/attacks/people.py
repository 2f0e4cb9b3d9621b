"""Bodies of the attacks: true joints as functions of time, in metres, room frame."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from hri_predict.base.arrays import Floats
from hri_predict.base.skeleton import JOINTS
from hri_sim.people.body import Body

J = {name: index for index, name in enumerate(JOINTS)}
STRIDE_M = 1.4
"""Length of two steps."""
_SWING_M = {"knee": 0.12, "ankle": 0.3, "foot": 0.3, "elbow": -0.06, "wrist": -0.18, "hand": -0.22}
"""How far each joint of a leg or an arm swings at a walk."""


def stand(
    place: Floats | Sequence[float], heading: float = np.pi, height_m: float = 1.75, **pose: Any
) -> Floats:
    """(21, 3) joints of a body that stands; ``pose``: fields of ``Stance`` (crouch, reach, ...)."""
    body = Body(height_m)
    stance = body.standing(np.asarray(place, dtype=float), heading)
    if "target" in pose:
        pose["target"] = np.asarray(pose["target"], dtype=float)
    return body.joints(replace(stance, **pose))


def walk(
    t: float,
    points: Sequence[Floats | Sequence[float]],
    speed_m_s: float,
    start_s: float,
    height_m: float = 1.75,
    soft_s: float = 0.0,
    **pose: Any,
) -> Floats:
    """(21, 3) joints of a body that walks along points; it stands before and after.

    It arrives ``soft_s`` later than at a steady speed: for so long it speeds up, and slows down.
    Without it, it starts and stops from one capture to the next, which no person does.
    """
    way = np.asarray(points, dtype=float)
    lengths = np.hypot(*np.diff(way, axis=0).T)
    gone_m = _gone(t - start_s, float(lengths.sum()), speed_m_s, soft_s)
    moving, leg = 0.0 < gone_m < lengths.sum(), 0
    while leg < len(lengths) - 1 and gone_m > lengths[leg]:
        gone_m -= lengths[leg]
        leg += 1
    ahead = (way[leg + 1] - way[leg]) / lengths[leg]
    heading = float(np.arctan2(ahead[1], ahead[0]))
    joints = stand(way[leg] + ahead * min(gone_m, lengths[leg]), heading, height_m, **pose)
    if moving:
        phase = np.sin(2 * np.pi * (t - start_s) * speed_m_s / STRIDE_M)
        for side, sign in (("l", 1), ("r", -1)):
            for part, swing_m in _SWING_M.items():
                joints[J[f"{side}_{part}"], :2] += sign * swing_m * phase * ahead
    return joints


def _gone(t: float, length_m: float, speed_m_s: float, soft_s: float) -> float:
    """How far a walker is after ``t`` seconds."""
    end_s = length_m / speed_m_s + soft_s
    t = min(max(t, 0.0), end_s)
    late, early = max(t - soft_s, 0.0), max(t - (end_s - soft_s), 0.0)
    if not soft_s:
        return speed_m_s * t
    rising = (t * t - late * late) / (2.0 * soft_s)  # the integral of a speed that rises
    return float(np.clip(speed_m_s * (rising - early * early / (2.0 * soft_s)), 0.0, length_m))


def ease(t: float, start_s: float, seconds: float) -> float:
    """0 before ``start_s``, 1 from ``seconds`` later on, and a smooth rise in between."""
    x = min(max((t - start_s) / seconds, 0.0), 1.0)
    return x * x * (3.0 - 2.0 * x)


def at(bearing: float, away_m: float) -> Floats:
    """(2,) the place at a bearing from the robot's base."""
    return np.array([away_m * np.cos(bearing), away_m * np.sin(bearing)])


def reach_in(t: float, start_s: float, bearing: float, away_m: float = 1.15) -> Floats:
    """(21, 3) joints of a person who reaches into the robot's way from ``start_s`` on."""
    share = ease(t, start_s, 0.6)
    target = [*at(bearing, away_m - 0.43), 0.5]
    return stand(at(bearing, away_m), bearing + np.pi, reach=share, target=target, lean=0.4 * share)


def seen_of(*parts: str) -> Any:
    """(21,) mask of the joints of some parts of the body: ``arms``, ``legs``, ``head``."""
    words = {
        "arms": ("shoulder", "elbow", "wrist", "hand"),
        "legs": ("hip", "knee", "ankle", "foot", "waist"),
        "head": ("head", "neck"),
    }
    return np.array([any(w in name for p in parts for w in words[p]) for name in JOINTS])
