"""Handles two ids that a source identified as one person (``Scene.joined``)."""

from collections.abc import Iterable

from hri_predict.people.roster import Roster


def join(roster: Roster, pairs: Iterable[tuple[int, int]], capture_ns: int) -> None:
    """End the tracks of ids that are gone, if the person continues with another id.

    That person is not lost, because the visible body is theirs. This applies only if the other id
    is tracked in this capture. A track with an uncertain position remains, and its person is lost
    like any other.

    Args:
        roster: the tracked people.
        pairs: pairs of ids (gone, kept).
        capture_ns: capture time of the scene.
    """
    for gone, kept in pairs:
        track, other = roster.tracks.get(gone), roster.tracks.get(kept)
        if track is None or other is None or other.capture_ns != capture_ns:
            continue
        if track.rival is None and track.trail.doubted_ns() is None:
            del roster.tracks[gone]
            roster.note_end(gone, capture_ns)
            roster.counters["joined"] += 1
