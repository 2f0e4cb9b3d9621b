"""A6, A7: a robot that is not where RobotState says, and muting beyond its time."""

from typing import Any

import numpy as np

from hri_predict.base.arrays import Floats
from tests.attacks.kinds.controllers import report_instead
from tests.attacks.people import at, ease, reach_in, walk
from tests.attacks.play import Attack

_BOTH = ("drive", "monitor")


def _visitor(rng: np.random.Generator, start_s: float) -> tuple[Any, float]:
    """A person who walks up in full view and reaches in; when the hand goes in."""
    bearing, speed = float(rng.uniform(-0.3, 0.3)), float(rng.uniform(1.0, 1.6))
    there_s = start_s + 2.9 / speed
    target = [*at(bearing, 0.7), 0.5]

    def joints(t: float) -> Floats:
        share = ease(t, there_s - 0.3, 0.5)
        way = [at(bearing, 4.0), at(bearing, 1.1)]
        return walk(t, way, speed, start_s, reach=share, target=target)

    return joints, there_s


def frozen(rng: np.random.Generator) -> Attack:
    """Every controller repeats one RobotState with a counter that advances."""
    since_s, zero = float(rng.uniform(0.5, 6.0)), bool(rng.random() < 0.5)
    joints, there_s = _visitor(rng, since_s + float(rng.uniform(-2.0, 1.0)))
    kept: dict[str, Any] = {}

    def reported(t: float, q: Floats, qd: Floats) -> tuple[Floats, Floats]:
        if t < since_s:
            kept["q"], kept["qd"] = q, qd
        return kept.get("q", q), (0.0 if zero and t >= since_s else 1.0) * kept.get("qd", qd)

    return Attack(
        name=f"RobotState frozen at {since_s:.1f} s, velocity {'0' if zero else 'kept'}",
        truth=lambda t: [joints(t)],
        seen=lambda t, k: [(1, joints(t))],
        seconds=there_s + 4.0,
        cell=lambda cell: report_instead(cell, reported, _BOTH),
        near_m=0.0,  # what the robot may do is judged by contacts alone
    )


def contradict(rng: np.random.Generator) -> Attack:
    """Two controllers report one robot at different places."""
    link = str(rng.choice(_BOTH))
    joint, off = int(rng.integers(0, 3)), float(rng.choice([-1, 1]) * rng.uniform(0.4, 1.2))
    since_s = float(rng.choice([0.0, rng.uniform(1.0, 5.0)]))
    joints, there_s = _visitor(rng, float(rng.uniform(1.0, 4.0)))

    def reported(t: float, q: Floats, qd: Floats) -> tuple[Floats, Floats]:
        shift = np.zeros_like(q)
        shift[joint] = off * float(np.clip((t - since_s) / 2.0, 0.0, 1.0)) if since_s else off
        return q + shift, qd

    return Attack(
        name=f"{link} reports joint {joint} off by {off:.2f} rad from {since_s:.1f} s on",
        truth=lambda t: [joints(t)],
        seen=lambda t, k: [(1, joints(t))],
        seconds=there_s + 4.0,
        cell=lambda cell: report_instead(cell, reported, (link,)),
        near_m=0.0,
    )


def muted_again(rng: np.random.Generator) -> Attack:
    """Muting is released for a moment and asked for again and again."""
    max_s, pause_s = float(rng.uniform(1.0, 3.0)), float(rng.choice([0.02, 0.1, 0.3, 0.6]))
    period_s = max_s * float(rng.uniform(0.7, 1.3))
    bearing = float(rng.uniform(-0.3, 0.3))
    reach_s = float(rng.uniform(10.0, 14.0))
    requests = [
        {"request": "muted", "start_s": 1.0 + n * (period_s + pause_s), "duration_s": period_s}
        for n in range(round(20.0 / period_s))
    ]

    def joints(t: float) -> Floats:
        return reach_in(t, reach_s, bearing)

    def change(data: dict[str, Any]) -> None:
        data["robots"][0]["modes"] = {"muting": {"max_s": max_s}}
        for link in data["links"]:
            link["simulate"]["requests"] = requests

    return Attack(
        name=f"muting of {max_s:.1f} s, asked for {period_s:.1f} s, released for {pause_s} s",
        truth=lambda t: [joints(t)],
        seen=lambda t, k: [(1, joints(t))],
        seconds=reach_s + 5.0,
        change=change,
        near_m=0.0,
    )
