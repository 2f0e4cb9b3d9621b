"""Zones of lost people whose possible places are limited, because other places were seen free.

Each place is a disc on the floor. A person in it may stand, crouch or reach out in any direction,
so each zone is an upright capsule around the disc, enlarged by an arm's reach. A person at the
disc's edge is within it up to ``TOP_M``, and an outstretched arm up to ``TOP_M - ARM_M``.
"""

import numpy as np

from hri_predict.base.arrays import Floats
from hri_predict.base.geometry import Capsules
from hri_predict.people.snapshot import LostPerson

ARM_M = 0.85
"""Reach of a hand from the body's middle: ISO 13855:2010 assumes 850 mm for an arm."""
TOP_M = 2.5
"""Maximum reach above the place where a person stands: a tall man's grip is at 2.2 m."""


def anywhere_in(person: LostPerson, until_s: Floats, segments: int) -> Capsules:
    """Return (K, S) capsules that hold a person who is in one of ``places``.

    Args:
        person: a lost person with ``places``.
        until_s: (K,) possible walking times since ``places_ns``, in seconds.
        segments: S; the places are distributed over them, and merged if there are more.
    """
    assert person.places is not None
    held = _at_most(person.places, segments)
    places = held[np.arange(segments) % len(held)]
    radius = places[:, 2] + ARM_M + person.speed_m_s * until_s[:, None]
    a = np.full((*radius.shape, 3), person.floor_m)
    a[..., :2] = places[:, :2]
    b = a.copy()
    b[..., 2] += person.platform_m + TOP_M - ARM_M
    return Capsules(a, b, radius)


def _at_most(places: Floats, count: int) -> Floats:
    """Return (min(D, count), 3) discs that cover all of ``places``: neighbours are merged."""
    if len(places) <= count:
        return places
    joined = []
    for group in np.array_split(places, count):
        middle = 0.5 * (group[:, :2].min(0) + group[:, :2].max(0))
        apart = np.hypot(*(group[:, :2] - middle).T)
        joined.append([*middle, (apart + group[:, 2]).max()])
    return np.array(joined)
