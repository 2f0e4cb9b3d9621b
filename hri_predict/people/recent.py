"""The newest captures of all people as received, from which speeds are measured."""

from collections.abc import Sequence

import numpy as np

from hri_predict.people.ring_buffer import RingBuffer
from hri_predict.people.snapshot import RecentCaptures

SPAN_S = 0.25
"""Time for which captures are kept: slightly longer than the span of a speed measurement."""
LEAST = 5
"""Minimum number of captures kept, regardless of their age: a source may deliver only 5 a
second."""
MOST = LEAST + round(SPAN_S * 240)
"""Maximum number of captures kept: a source may deliver 240 a second despite its nominal rate."""


def recent_captures(rings: Sequence[RingBuffer], joints: int) -> RecentCaptures:
    """The newest captures of P people.

    Args:
        rings: ring buffer of each person.
        joints: J, joints per person.
    """
    found = []
    for ring in rings:
        stamps, positions, observed = ring.samples(newest=MOST)
        age_s = (stamps[-1:] - stamps) * 1e-9
        first = min(int(np.searchsorted(-age_s, -SPAN_S)), max(0, len(stamps) - LEAST))
        found.append((age_s[first:], positions[first:], observed[first:]))
    columns = max((len(ages) for ages, _, _ in found), default=0)
    recent = RecentCaptures(
        np.full((len(rings), columns), np.inf),
        np.zeros((len(rings), columns, joints, 3)),
        np.zeros((len(rings), columns, joints), np.bool_),
    )
    for person, (ages, positions, observed) in enumerate(found):
        filled = slice(columns - len(ages), columns)
        recent.age_s[person, filled] = ages
        recent.positions[person, filled] = positions
        recent.observed[person, filled] = observed
    return recent
