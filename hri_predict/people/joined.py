"""Handles two ids that a source identified as one person (``Scene.joined``)."""

from collections.abc import Iterable

from hri_predict.people.roster import Roster
from hri_predict.people.track import Track

ONE_M = 0.5
"""Maximum distance of two bodies of one person, as two sensors with inexact poses see it; the
largest ``apart_m`` of a merged source, and noise."""
MOVED_M_S, MOVED_NS = 3.0, 200_000_000
"""Speed of a body, and longest time, between the last capture of the gone id and this one. A body
that moved farther is reported lost, which an Acknowledge ends."""


def join(roster: Roster, pairs: Iterable[tuple[int, int]], capture_ns: int) -> None:
    """End the tracks of ids that are gone, if the person continues with another id.

    That person is not lost, because the visible body is theirs. This applies only if the other id
    is tracked in this capture, near the place where the gone id was last seen: two bodies that were
    just seen apart are two people. A track with an uncertain position remains, and its person is
    lost like any other.

    Args:
        roster: the tracked people; counts the pairs that were too far apart.
        pairs: pairs of ids (gone, kept).
        capture_ns: capture time of the scene.
    """
    for gone, kept in pairs:
        track, other = roster.tracks.get(gone), roster.tracks.get(kept)
        if track is None or other is None or track is other or other.capture_ns != capture_ns:
            continue
        if not _may_be_one(track, other):
            roster.counters["joined_too_far_apart"] += 1
        elif track.rival is None and track.trail.doubted_ns() is None:
            del roster.tracks[gone]
            roster.note_end(gone, capture_ns)
            roster.counters["joined"] += 1


def _may_be_one(track: Track, other: Track) -> bool:
    """Return whether one body can have been at the last places of both tracks."""
    between_ns = min(max(other.capture_ns - track.capture_ns, 0), MOVED_NS)
    most_m = ONE_M + MOVED_M_S * between_ns * 1e-9 + track.error_m + other.error_m
    return track.apart(other.body) <= most_m
