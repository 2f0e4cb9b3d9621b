"""Lost people: people who vanished, but not at an exit.

A lost person is a zone that grows at walking speed for ``lost_growth_s`` (the risk stage grows it).
After that the person may be anywhere, and the room cannot be trusted: ``unaccounted``.

A lost person is found or forgotten by one of these:

- The same id is seen again within reach, or another id appears inside the zone while it grows.
- The source sees the room empty for ``empty_scenes`` scenes in a row. They count only once the zone
  of *every* lost person has stopped growing: a person hidden behind a machine causes empty scenes
  from the first moment, and these must not let the node forget that person sooner.
- ``acknowledge``, again only for people whose zone has stopped growing.

Time alone never ends it.
"""

import numpy as np

from hri_predict.arrays import Floats
from hri_predict.people.ring_buffer import NEVER
from hri_predict.people.settings import PeopleSettings
from hri_predict.people.snapshot import LostPerson
from hri_predict.people.track import Track

PLACE_SLACK_M = 0.5
"""How far the mean of a body's visible joints may move when it turns or shows other joints."""


class LostPeople:
    """People who vanished and are not accounted for.

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
        self.forgotten = (
            False  # more people were lost than are kept: only an empty room clears this
        )

    def add(self, track: Track) -> None:
        """Add a lost person. Beyond ``max_people`` the oldest place is dropped, and that person
        may be anywhere."""
        self.tracks.append(track)
        self._empty_run = 0
        if len(self.tracks) > self._settings.max_people:
            oldest = min(self.tracks, key=lambda t: t.capture_ns)
            self.tracks.remove(oldest)
            self.forgotten = True

    def is_growing(self, track: Track, now_ns: int) -> bool:
        """Whether the zone of ``track`` still grows."""
        return now_ns - track.capture_ns <= self._growth_ns

    def growing(self, now_ns: int) -> tuple[LostPerson, ...]:
        """Lost people whose zone still grows."""
        return tuple(
            LostPerson(track.id, track.positions.copy(), track.capture_ns)
            for track in self.tracks
            if self.is_growing(track, now_ns)
        )

    def unaccounted(self, now_ns: int) -> bool:
        """Whether a person has been lost for so long that they may be anywhere."""
        return self.forgotten or any(not self.is_growing(t, now_ns) for t in self.tracks)

    def see_room(self, empty: bool, capture_ns: int) -> bool:
        """Note a scene; ``empty`` means that the source saw the room with nobody in it.

        Returns:
            whether the scene proved that all lost people are gone.
        """
        if capture_ns - self._capture_ns > self._pause_ns:
            self._empty_run = 0
        self._capture_ns = capture_ns
        counts = empty and not any(self.is_growing(t, capture_ns) for t in self.tracks)
        self._empty_run = self._empty_run + 1 if counts else 0
        if self._empty_run < self._settings.empty_scenes:
            return False
        proof = bool(self.tracks) or self.forgotten
        self.tracks.clear()
        self.forgotten = False
        return proof

    def acknowledge(self, now_ns: int) -> None:
        """Forget people whose zone has stopped growing: an operator states that they are gone."""
        self.tracks = [t for t in self.tracks if self.is_growing(t, now_ns)]
        self.forgotten = False


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
