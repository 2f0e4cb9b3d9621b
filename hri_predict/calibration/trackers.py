"""Recordings as other trackers would deliver them: slower, noisier, with gaps.

Most recordings come from optical motion capture: 120 captures a second, noise below a millimetre.
Zones that were calibrated on these alone would be too small for a camera's tracker, and its every
capture would look like a surprise. So a calibration also sees each recording once as drawn here.
The truth keeps the noise, because the node compares its zones with captures that have it.
"""

import numpy as np

from hri_predict.arrays import Floats, Ints
from hri_predict.calibration.presence import Presence

FASTEST_HZ = 35.0
"""Captures are thinned to at most so many a second before noise is added."""
EVERY = (1, 1, 2, 3, 4)
"""The tracker delivers every such capture of those."""
WHITE_M, SLOW_M = (0.0, 0.02), (0.0, 0.02)
"""Ranges of the standard deviations of each coordinate: of noise that is new in each capture, and
of noise that wanders."""
WANDERS_S = 0.3
"""Correlation time of the latter."""
LOST = 0.03
"""Share of the captures that are not delivered, and of the joints that are not observed in one."""


def as_tracked(presence: Presence, seed: int) -> tuple[Presence, Ints]:
    """Return the presence with noise, and which of its captures the tracker delivers.

    Args:
        presence: as recorded.
        seed: decides everything that is drawn.
    """
    rng = np.random.default_rng(seed)
    thinned = np.arange(0, len(presence.stamps_ns), max(1, round(presence.rate_hz / FASTEST_HZ)))
    stamps, positions = presence.stamps_ns[thinned], presence.positions[thinned]
    shape = positions.shape
    white = rng.uniform(*WHITE_M) * rng.standard_normal(shape)
    slow = rng.uniform(*SLOW_M) * _wandering(rng, stamps, shape)
    observed = presence.observed[thinned] & (rng.random(shape[:2]) >= LOST)
    every = int(rng.choice(EVERY))
    delivered = np.arange(0, len(stamps), every)
    delivered = delivered[rng.random(len(delivered)) >= LOST]
    rate_hz = presence.rate_hz / max(1, round(presence.rate_hz / FASTEST_HZ))
    noisy = np.where(observed[..., None], positions + white + slow, 0.0)
    return Presence(stamps, noisy, observed, rate_hz), delivered


def _wandering(rng: np.random.Generator, stamps: Ints, shape: tuple[int, ...]) -> Floats:
    """(F, J, 3) noise of deviation 1 whose correlation falls by 1/e in ``WANDERS_S``."""
    found = rng.standard_normal(shape)
    kept = np.exp(-np.diff(stamps) * 1e-9 / WANDERS_S)
    for i, share in enumerate(kept, 1):
        found[i] = share * found[i - 1] + np.sqrt(1.0 - share**2) * found[i]
    return found
