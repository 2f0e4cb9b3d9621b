"""Exits and entrances: where people leave and enter the room.

A person who vanishes in an exit has left only if the last motion led there: the person was seen in
the room, walked into the exit, and was still walking when last seen. A person who stands in a
doorway and is hidden by a colleague has not left. A person who has just come in has not left.
"""

from collections.abc import Sequence

import numpy as np

from hri_predict.arrays import Floats
from hri_predict.people.track import Track
from hri_predict.settings import Region

LAST_MOTION_S = 1.0
"""The last motion is the motion during this time before a person was last seen."""
ON_THE_WAY_M = 0.2
"""A person who moved less than this in ``LAST_MOTION_S`` stood: a slow step is 0.3 m."""
RESUMED_M = 0.1
"""A person found again on the way out has left after moving on by this much."""
INSIDE_M = 0.3
"""A person who got less far into an exit may only have passed its edge."""


class Doors:
    """The exits and entrances of a room.

    Args:
        exits: where people may leave.
        entrances: where people may appear; ``None``: in the exits.
    """

    def __init__(self, exits: Sequence[Region], entrances: Sequence[Region] | None) -> None:
        self._exits = tuple(exits)
        self._entrances = self._exits if entrances is None else tuple(entrances)

    def is_entrance(self, point: Floats) -> bool:
        """Whether people may enter at ``point`` (3,), room frame."""
        return any(region.contains(point) for region in self._entrances)

    def follow(self, track: Track) -> None:
        """Note whether the newest capture of ``track`` lies in an exit, and where it came in."""
        if not self._exits:
            return
        place = track.centroid
        if not any(region.contains(place) for region in self._exits):
            track.was_in_room, track.doorstep = True, None
        elif track.was_in_room and track.doorstep is None:
            track.doorstep = place

    def has_left(self, track: Track) -> bool:
        """Whether a person who has vanished left by an exit that the last motion led to."""
        if track.doorstep is None:
            return False
        moved, _ = track.moved(LAST_MOTION_S)
        if float(np.linalg.norm(moved)) < ON_THE_WAY_M:
            return False
        inward = track.centroid - track.doorstep  # from where the exit began
        depth_m = float(np.linalg.norm(inward))
        if depth_m < INSIDE_M or float(moved @ inward) <= 0.0:
            return False
        since_s = (track.capture_ns - track.resumed_ns) * 1e-9
        if since_s >= LAST_MOTION_S or track.resumed_ns == track.began_ns:
            return True
        # somebody else may have come in past who left, and got that track
        onward, _ = track.moved(since_s)
        return float(onward @ inward) >= RESUMED_M * depth_m
