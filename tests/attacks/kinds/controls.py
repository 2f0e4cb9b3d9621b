"""No attacks: what people and trackers do every day, after which the robot must work again."""

from collections.abc import Callable

import numpy as np

from hri_predict.base.arrays import Floats
from tests.attacks.people import at, seen_of, stand, walk
from tests.attacks.play import ALL, EXIT, RATE_HZ, Attack

_VIA, _OUT = np.array([2.5, 2.5]), np.array([EXIT[1][0] + 0.45, 2.5])
"""Straight into the exit and out of it on the far side, where people are no longer seen."""
_SOFT_S = 1.0
"""People need about a second to begin to walk, and to stop."""


def stands(rng: np.random.Generator) -> Attack:
    """A person stands far away, seen with white noise."""
    body, noise_m = stand(at(float(rng.uniform(-0.3, 0.3)), 4.2)), float(rng.uniform(0.0, 0.015))
    return Attack(
        name=f"stands far away, {noise_m * 1e3:.0f} mm of noise",
        truth=lambda t: [body],
        seen=lambda t, k: [(1, body)],
        seconds=20.0,
        noise_m=noise_m,
        declares_noise=noise_m > 0.0,
        moving=(17.0, 20.0),
    )


def _visit(rng: np.random.Generator) -> tuple[Callable[[float], Floats], float, float]:
    """Comes, stays beside the robot and leaves by the exit: joints, leaving, gone."""
    place, speed = at(float(rng.uniform(-0.4, 0.4)), 1.5), float(rng.uniform(0.9, 1.5))
    leaves_s = float(rng.uniform(5.0, 8.0))
    way = [place, _VIA, _OUT]
    gone_s = leaves_s + float(np.hypot(*np.diff(np.array(way), axis=0).T).sum()) / speed + _SOFT_S

    def joints(t: float) -> Floats:
        if t < leaves_s:
            return walk(t, [[4.0, 0.5], place], speed, 1.0, soft_s=_SOFT_S)
        return walk(t, way, speed, leaves_s, soft_s=_SOFT_S)

    return joints, leaves_s, gone_s


def leaves(rng: np.random.Generator) -> Attack:
    """A person comes, works beside the robot and walks out through the exit."""
    joints, _, gone_s = _visit(rng)
    return Attack(
        name=f"leaves through the exit at {gone_s:.1f} s",
        truth=lambda t: [joints(t)] if t < gone_s else [],
        seen=lambda t, k: [(1, joints(t))] if t < gone_s else [],
        seconds=gone_s + 6.0,
        moving=(gone_s + 3.0, gone_s + 6.0),
    )


def other_ids(rng: np.random.Generator) -> Attack:
    """A person comes and goes far away; the tracker gives another id every few captures."""
    place, speed = at(float(rng.uniform(-0.4, 0.4)), 1.5), float(rng.uniform(0.9, 1.5))
    leaves_s, far = float(rng.uniform(5.0, 8.0)), np.array([4.4, -0.5])
    away_s = leaves_s + float(np.hypot(*(far - place))) / speed + _SOFT_S
    period = int(rng.choice([1, 5, 30]))

    def joints(t: float) -> Floats:
        if t < leaves_s:
            return walk(t, [[4.0, 0.5], place], speed, 1.0, soft_s=_SOFT_S)
        return walk(t, [place, far], speed, leaves_s, soft_s=_SOFT_S)

    return Attack(
        name=f"another id every {period} captures, far away at {away_s:.1f} s",
        truth=lambda t: [joints(t)],
        seen=lambda t, k: [(1 + k // period, joints(t))],
        seconds=away_s + 6.0,
        moving=(away_s + 3.0, away_s + 6.0),
    )


def half_seen(rng: np.random.Generator) -> Attack:
    """The same; a bench hides the legs beside the robot."""
    joints, leaves_s, gone_s = _visit(rng)
    visible = seen_of("arms", "head")
    return Attack(
        name=f"legs hidden beside the robot, leaves at {gone_s:.1f} s",
        truth=lambda t: [joints(t)] if t < gone_s else [],
        seen=lambda t, k: (
            [(1, joints(t), visible if 3.0 < t < leaves_s + 0.5 else ALL)] if t < gone_s else []
        ),
        seconds=gone_s + 6.0,
        moving=(gone_s + 3.0, gone_s + 6.0),
    )


def returns(rng: np.random.Generator) -> Attack:
    """The tracker drops a person for a moment, and sees the same body there again."""
    joints, leaves_s, gone_s = _visit(rng)
    since, count = int(RATE_HZ * rng.uniform(2.0, leaves_s + 1.0)), int(rng.integers(1, 6))
    other = bool(rng.random() < 0.5)
    return Attack(
        name=f"dropped for {count} captures, other id {other}, leaves at {gone_s:.1f} s",
        truth=lambda t: [joints(t)] if t < gone_s else [],
        seen=lambda t, k: (
            [(1 + (other and k > since), joints(t))]
            if t < gone_s and not since <= k < since + count
            else []
        ),
        seconds=gone_s + 6.0,
        moving=(gone_s + 3.0, gone_s + 6.0),
    )
