"""A1: a hidden person is taken for a colleague who gets the id, or is near the place."""

from collections.abc import Sequence

import numpy as np

from hri_predict.base.arrays import Floats
from tests.attacks.kinds.hider import Hider
from tests.attacks.people import seen_of, stand, walk
from tests.attacks.play import NEAR_M, RATE_HZ, Attack

_WAY_OUT = [3.75, 2.55]
CLEAR_OF_ROBOT_M = 1.1


def one_capture(rng: np.random.Generator) -> Attack:
    """One or a few captures of the hidden person under the id of a colleague far away."""
    hider = Hider.draw(rng)
    count, known = int(rng.integers(1, 4)), bool(rng.random() < 0.5)
    # a person who was never seen before can only be lost from the first capture on: on the way in
    latest_s = 13.0 if known else hider.lost_s - 0.2
    first = int(RATE_HZ * rng.uniform(hider.lost_s - 1.2, latest_s))
    far = stand([rng.uniform(3.5, 4.5), rng.uniform(-3.0, -1.5)])
    return Attack(
        name=f"one capture: {count} from capture {first}, own id: {known}, {hider}",
        truth=lambda t: [hider.joints(t), far],
        seen=lambda t, k: [
            *([(1, hider.joints(t))] if known and t < hider.lost_s else []),
            (2, hider.joints(t) if first <= k < first + count else far),
        ],
        seconds=hider.end_s,
        near_m=NEAR_M if known else 0.0,  # clear until a person is seen for the first time
    )


def slides(rng: np.random.Generator) -> Attack:
    """The id slides to a colleague close behind, who then leaves by the exit."""
    hider = Hider.draw(rng)
    beside = _beside(rng, hider.place, 0.3, 0.8)
    leaves_s = hider.lost_s + rng.uniform(0.3, 2.0)
    speed = rng.uniform(0.9, 1.5)
    colleague = lambda t: walk(t, [beside, [3.0, 1.9], _WAY_OUT], speed, leaves_s)  # noqa: E731
    gone_s = leaves_s + _length(beside, [3.0, 1.9], _WAY_OUT) / speed - rng.uniform(0.0, 0.3)
    return Attack(
        name=f"slides to {np.round(beside, 2)}, leaves at {leaves_s:.1f} s, {hider}",
        truth=lambda t: [hider.joints(t), colleague(t)],
        seen=lambda t, k: (
            [(1, hider.joints(t) if t < hider.lost_s else colleague(t))] if t < gone_s else []
        ),
        seconds=hider.end_s,
    )


def beside(rng: np.random.Generator) -> Attack:
    """A new id near the place where the hider was lost, a moment later, is a colleague."""
    hider = Hider.draw(rng)
    lost_s = hider.lost_s - rng.uniform(0.0, 0.8)  # perhaps still walking
    gap_s = rng.uniform(0.07, 0.6)
    last = hider.joints(lost_s).mean(axis=0)[:2]
    place = _beside(rng, last, 0.25, 0.8)
    leaves_s, speed = lost_s + gap_s + rng.uniform(0.2, 1.5), rng.uniform(0.9, 1.5)
    colleague = lambda t: walk(t, [place, [3.0, 1.9], _WAY_OUT], speed, leaves_s)  # noqa: E731
    gone_s = leaves_s + _length(place, [3.0, 1.9], _WAY_OUT) / speed - rng.uniform(0.0, 0.3)
    return Attack(
        name=f"new id at {np.round(place, 2)} {gap_s:.2f} s after {lost_s:.2f} s, {hider}",
        truth=lambda t: [hider.joints(t), colleague(t)],
        seen=lambda t, k: [
            *([(1, hider.joints(t))] if t < lost_s else []),
            *([(2, colleague(t))] if lost_s + gap_s < t < gone_s else []),
        ],
        seconds=hider.end_s,
    )


def alternates(rng: np.random.Generator) -> Attack:
    """An id alternates between two people for a while, and stays with the one who leaves."""
    hider = Hider.draw(rng)
    period, lasts_s = int(rng.integers(1, 6)), rng.uniform(0.5, 2.5)
    place = _beside(rng, hider.place, 0.4, 2.0)
    leaves_s, speed = hider.lost_s + lasts_s + rng.uniform(0.2, 1.0), rng.uniform(0.9, 1.5)
    colleague = lambda t: walk(t, [place, [3.0, 1.9], _WAY_OUT], speed, leaves_s)  # noqa: E731
    gone_s = leaves_s + _length(place, [3.0, 1.9], _WAY_OUT) / speed - rng.uniform(0.0, 0.3)

    def seen(t: float, k: int) -> list[tuple[int, np.ndarray]]:
        if t >= gone_s:
            return []
        own = t < hider.lost_s or (t < hider.lost_s + lasts_s and (k // period) % 2 == 0)
        return [(1, hider.joints(t) if own else colleague(t))]

    return Attack(
        name=f"alternates every {period} for {lasts_s:.1f} s with {np.round(place, 2)}, {hider}",
        truth=lambda t: [hider.joints(t), colleague(t)],
        seen=seen,
        seconds=hider.end_s,
    )


def half_seen(rng: np.random.Generator) -> Attack:
    """The id slides from a person of whom only arms are seen to the legs of a colleague."""
    hider = Hider.draw(rng)
    parts = [seen_of("arms"), seen_of("legs")]
    first, second = parts if rng.random() < 0.5 else parts[::-1]
    place = _beside(rng, hider.place, 0.4, 0.9)
    leaves_s, speed = hider.lost_s + rng.uniform(0.3, 1.5), rng.uniform(0.9, 1.5)
    colleague = lambda t: walk(t, [place, [3.0, 1.9], _WAY_OUT], speed, leaves_s)  # noqa: E731
    gone_s = leaves_s + _length(place, [3.0, 1.9], _WAY_OUT) / speed - rng.uniform(0.0, 0.3)
    own_s = hider.lost_s - rng.uniform(0.3, 1.0)  # from here on only a part of the hider is seen

    def seen(t: float, k: int) -> list[tuple[int, np.ndarray, np.ndarray]]:
        if t >= gone_s:
            return []
        if t < hider.lost_s:
            whole = np.ones_like(first)
            return [(1, hider.joints(t), whole if t < own_s else first)]
        return [(1, colleague(t), second)]

    return Attack(
        name=f"half seen, colleague at {np.round(place, 2)}, {hider}",
        truth=lambda t: [hider.joints(t), colleague(t)],
        seen=seen,
        seconds=hider.end_s,
    )


def _beside(rng: np.random.Generator, place: np.ndarray, least_m: float, most_m: float) -> Floats:
    """(2,) a place near another, out of the way of a robot that moves before anybody is seen."""
    while True:
        beside: Floats = place + rng.uniform(least_m, most_m) * _direction(rng)
        if np.hypot(*beside) >= CLEAR_OF_ROBOT_M:
            return beside


def _direction(rng: np.random.Generator) -> np.ndarray:
    angle = rng.uniform(-np.pi, np.pi)
    return np.array([np.cos(angle), np.sin(angle)])


def _length(*points: Sequence[float] | np.ndarray) -> float:
    return float(np.hypot(*np.diff(np.array([list(p) for p in points]), axis=0).T).sum())
