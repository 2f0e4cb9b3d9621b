"""Refuses recordings whose coordinates are relative to the hips: they do not contain a person's
position."""

import numpy as np

from hri_predict.base.arrays import Bools, Floats
from hri_predict.base.errors import RecordingError
from hri_predict.people.body.relative import hips_are_origin
from hri_predict.people.body.stature import is_adult, stature_m
from hri_predict.recording.recording import Recording
from hri_predict.recording.refusing.unseen import SYNTHETIC

WINDOW_S = 2.0


def check_relative(recording: Recording) -> None:
    """Refuse a recording whose origin is between the hips; see ``people.body.relative``.

    Raises:
        RecordingError: one line with the remedy.
    """
    if recording.kind in SYNTHETIC:
        return
    origin = np.array([0.0, 0.0, -recording.floor_m])
    stamps, positions, observed = _first_person(recording)
    if _relative(stamps, positions, observed, origin):
        raise RecordingError(
            f"recording {recording.path}: its coordinates are relative to the hips, which stay in "
            f"place while the body moves; export positions in the room (MediaPipe's world landmarks"
            f" have none)"
        )


def _first_person(recording: Recording) -> tuple[Floats, Floats, Bools]:
    """Stamps (n,) s, canonical joints (n, J, 3) and (n, J) of the first person in the recording."""
    number = next((p.id for scene in recording.scenes for p in scene.people), None)
    seen = [(s.stamp_ns, p) for s in recording.scenes for p in s.people if p.id == number]
    stamps = np.array([stamp * 1e-9 for stamp, _ in seen])
    if not seen:
        return stamps, np.zeros((0, 0, 3)), np.zeros((0, 0), np.bool_)
    raw = np.stack([p.positions for _, p in seen]), np.stack([p.observed for _, p in seen])
    return stamps, *recording.joint_map.map(*raw)


def _relative(stamps: Floats, positions: Floats, observed: Bools, origin: Floats) -> bool:
    """Whether the hips are the origin in most windows.

    Never of a body of the wrong size: in a wrong unit the whole way lies about the origin.
    """
    stature = stature_m(list(zip(positions, observed, strict=True)))
    if stature is None or not is_adult(stature):
        return False
    found = []
    for start in np.arange(stamps[0], max(stamps[-1] - WINDOW_S, stamps[0]) + 1e-6, WINDOW_S):
        part = (stamps >= start) & (stamps < start + WINDOW_S)
        if part.any():
            found.append(hips_are_origin(positions[part], observed[part], origin))
    return 2 * sum(found) > len(found)
