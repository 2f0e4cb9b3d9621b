"""People who vanished anywhere but at an exit: where they may be, and what proves them gone.

A lost person is a zone that grows at walking speed for ``lost_growth_s`` (the risk stage grows it).
After that nobody knows where that body is, and the room cannot be trusted: ``unaccounted``.

What ends it:

- the same id is seen again where that body can have got to, or another id appears inside the zone
  while it grows: the body is found;
- ``empty_scenes`` scenes in a row, in which the source saw the room and nobody in it. They count
  only once the growth of *every* lost person is over: somebody hidden behind a machine yields empty
  scenes from the very moment he vanishes, and must not be forgotten sooner for it;
- ``acknowledge``, likewise only for those whose growth is over.

Time alone never does.
"""

import numpy as np

from hri_predict.people_settings import PeopleSettings
from hri_predict.ring_buffer import NEVER
from hri_predict.scene import Floats
from hri_predict.settings import Region
from hri_predict.snapshot import LostPerson
from hri_predict.track import Track

PLACE_SLACK_M = 0.5
"""How far the means of two sets of joints of one body may lie apart: it turned, or shows others."""


class LostPeople:
    """Those who vanished and are not accounted for.

    Args:
        settings: growth, empty scenes, exits, bounds.
        pause_ns: scenes farther apart than this are not "in a row".
    """

    def __init__(self, settings: PeopleSettings, pause_ns: int) -> None:
        self.tracks: list[Track] = []
        self._settings = settings
        self._growth_ns = round(settings.lost_growth_s * 1e9)
        self._pause_ns = pause_ns
        self._empty_run = 0
        self._capture_ns = NEVER
        self._forgotten = False  # more were lost than are kept: only an empty room mends that

    def add(self, track: Track) -> None:
        """Somebody vanished; beyond ``max_people`` the oldest is no longer kept as a place."""
        self.tracks.append(track)
        self._empty_run = 0
        if len(self.tracks) > self._settings.max_people:
            oldest = min(self.tracks, key=lambda t: t.capture_ns)
            self.tracks.remove(oldest)
            self._forgotten = True

    def is_growing(self, track: Track, now_ns: int) -> bool:
        """Whether the zone of ``track`` still grows."""
        return now_ns - track.capture_ns <= self._growth_ns

    def growing(self, now_ns: int) -> tuple[LostPerson, ...]:
        """Those whose zone still grows."""
        return tuple(
            LostPerson(track.id, track.positions.copy(), track.capture_ns)
            for track in self.tracks
            if self.is_growing(track, now_ns)
        )

    def unaccounted(self, now_ns: int) -> bool:
        """Whether somebody was lost so long ago that he may be anywhere."""
        return self._forgotten or any(not self.is_growing(t, now_ns) for t in self.tracks)

    def see_room(self, empty: bool, capture_ns: int) -> bool:
        """Take note of a scene, ``empty`` if the room was seen and nobody in it.

        Returns:
            whether it proved that the lost are gone.
        """
        if capture_ns - self._capture_ns > self._pause_ns:
            self._empty_run = 0
        self._capture_ns = capture_ns
        counts = empty and not any(self.is_growing(t, capture_ns) for t in self.tracks)
        self._empty_run = self._empty_run + 1 if counts else 0
        if self._empty_run < self._settings.empty_scenes:
            return False
        proof = bool(self.tracks) or self._forgotten
        self.tracks.clear()
        self._forgotten = False
        return proof

    def acknowledge(self, now_ns: int) -> None:
        """An operator vouches that those are gone whose growth is over."""
        self.tracks = [t for t in self.tracks if self.is_growing(t, now_ns)]
        self._forgotten = False


def in_region(region: Region, point: Floats) -> bool:
    """Whether ``point`` (3,) lies in the prism; by counting the edges that a ray crosses."""
    x, y, z = (float(v) for v in point)
    if not region.z_min <= z <= region.z_max:
        return False
    inside = False
    previous = region.polygon[-1]
    for corner in region.polygon:
        (x0, y0), (x1, y1) = previous, corner
        if (y0 > y) != (y1 > y) and x < x0 + (y - y0) * (x1 - x0) / (y1 - y0):
            inside = not inside
        previous = corner
    return inside


def match_places(starts: list[Floats], places: list[Floats], radii: Floats) -> dict[int, int]:
    """Pair each start with the nearest place whose zone it lies in, each place once.

    Args:
        starts: S points (3,) where bodies appear.
        places: V points (3,) where bodies vanished.
        radii: (S, V) metres; negative where the pair is out of the question.

    Returns:
        index of start -> index of place.
    """
    if not starts or not places:
        return {}
    distance = np.linalg.norm(np.array(starts)[:, None] - np.array(places)[None], axis=-1)
    distance[distance > radii] = np.inf
    pairs: dict[int, int] = {}
    while np.isfinite(distance).any():
        start, place = np.unravel_index(int(distance.argmin()), distance.shape)
        pairs[int(start)] = int(place)
        distance[start, :] = np.inf
        distance[:, place] = np.inf
    return pairs
