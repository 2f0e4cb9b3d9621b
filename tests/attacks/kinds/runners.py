"""A9: a person is lost while he accelerates toward the robot."""

import numpy as np

from tests.attacks.people import at, reach_in, stand
from tests.attacks.play import Attack

_ACCELERATION_M_S2 = 6.4


def runner(rng: np.random.Generator) -> Attack:
    """Stands far away, runs, is lost after a moment, and reaches into the robot's way."""
    top, seen_s = float(rng.uniform(3.0, 8.0)), float(rng.uniform(0.1, 0.6))
    away_m, bearing = float(rng.uniform(3.5, 6.5)), float(rng.uniform(-0.3, 0.3))
    start_s = float(rng.uniform(2.0, 5.0))
    end_m = away_m - 1.15

    def gone_m(t: float) -> float:
        s = max(t - start_s, 0.0)
        rising_s = top / _ACCELERATION_M_S2
        if s < rising_s:
            return min(0.5 * _ACCELERATION_M_S2 * s * s, end_m)
        return min(0.5 * top * rising_s + top * (s - rising_s), end_m)

    def joints(t: float) -> np.ndarray:
        moved = gone_m(t)
        if moved >= end_m:
            return reach_in(t, there_s, bearing)
        return stand(at(bearing, away_m - moved), bearing + np.pi)

    there_s = next(s for s in np.arange(start_s, start_s + 9.0, 0.01) if gone_m(s) >= end_m)
    return Attack(
        name=f"a runner of {top:.1f} m/s from {away_m:.1f} m, seen for {seen_s:.2f} s",
        truth=lambda t: [joints(t)],
        seen=lambda t, k: [(1, joints(t))] if t < start_s + seen_s else [],
        seconds=float(there_s) + 3.0,
        near_m=0.0,  # a runner is near within one cycle
    )
