"""Position and motion of a body on the floor, from its hips or both feet.

The mean of all seen joints does not give a position on the floor: it moves by half a metre when a
pallet hides the legs. So positions and motion use the same few joints, and only if those joints
were seen.
"""

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np

from hri_predict.base.arrays import Floats, mean_of
from hri_predict.base.skeleton import JOINTS
from hri_predict.people.track import Track

_STANDS = tuple(
    np.array([JOINTS.index(name) for name in names])
    for names in (
        ("l_hip", "r_hip"),
        ("waist",),
        ("l_hip",),
        ("r_hip",),
        ("l_ankle", "r_ankle"),
        ("l_foot", "r_foot"),
    )
)
"""Joints that give a body's position on the floor, best first. A single foot may swing half a step
ahead."""
_FEET = np.array([JOINTS.index(name) for name in ("l_ankle", "l_foot", "r_ankle", "r_foot")])


class Way(NamedTuple):
    """Motion of a body over the floor: (2,) metres, and the time it took."""

    moved: Floats
    seconds: float

    @property
    def speed_m_s(self) -> float:
        """Metres per second."""
        return float(np.linalg.norm(self.moved)) / self.seconds

    def along(self, direction: Floats) -> float:
        """Return the component (m/s) of the velocity along a unit vector (2,)."""
        return float(self.moved @ direction) / self.seconds


def floor_place(track: Track) -> Floats | None:
    """Return (2,) body position in its newest capture; ``None``: hips and feet are hidden."""
    seen = track.stamps == track.capture_ns
    for joints in _STANDS:
        if seen[joints].all():
            place: Floats = mean_of(track.positions[joints, :2])
            return place
    return None


def floor_way(track: Track, span_s: float) -> Way | None:
    """Return the body's motion over the floor in the ``span_s`` before it was last seen.

    The same joints are used at both ends; ``None``: those joints were not seen, or for
    less than half of ``span_s``.
    """
    stamps, positions, observed = track.history.samples()
    recent = np.flatnonzero(stamps >= track.capture_ns - round(span_s * 1e9))
    if len(recent) < 2:
        return None
    last = recent[-1]
    for joints in _STANDS:
        if not observed[last, joints].all():
            continue
        first = recent[observed[recent][:, joints].all(axis=1)][0]
        seconds = float(stamps[last] - stamps[first]) * 1e-9
        if seconds >= span_s / 2:
            moved = (positions[last, joints] - positions[first, joints])[:, :2].mean(axis=0)
            return Way(moved, seconds)
    return None


def standing_in(tracks: Iterable[Track], capture_ns: int) -> list[Floats]:
    """Return (2,) floor positions of the bodies that a scene shows down to an ankle or a foot.

    Bodies with a stated position error are left out: such bodies prove nothing.
    """
    places = []
    for track in tracks:
        if track.error_m > 0:
            continue
        if track.capture_ns == capture_ns and (track.stamps[_FEET] == capture_ns).any():
            place = floor_place(track)
            places += [] if place is None else [place]
    return places
