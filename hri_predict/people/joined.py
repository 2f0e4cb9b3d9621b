"""Two ids that a source found to be one person's (``Scene.joined``)."""

from collections.abc import Iterable

from hri_predict.people.roster import Roster


def join(roster: Roster, pairs: Iterable[tuple[int, int]], capture_ns: int) -> None:
    """End the tracks of ids that are gone, whose person continues under another id.

    That person is not lost: the body that is seen is theirs. It counts only where the other id is
    tracked in this very capture. A track of which it was not certain where its body is stays, and
    its person is lost as any other.

    Args:
        roster: the tracked people.
        pairs: of ids (gone, kept).
        capture_ns: of the scene.
    """
    for gone, kept in pairs:
        track, other = roster.tracks.get(gone), roster.tracks.get(kept)
        if track is None or other is None or other.capture_ns != capture_ns:
            continue
        if track.rival is None and track.trail.doubted_ns() is None:
            del roster.tracks[gone]
            roster.note_end(gone, capture_ns)
            roster.counters["joined"] += 1
