"""Rejects image landmarks: image coordinates with a depth relative to the hips.

MediaPipe's ``pose_landmarks`` (normalised, or times the picture's size) have x to the right and y
down in the image, and z "with the midpoint of hips as the origin" (MediaPipe, "Pose landmark
detection guide", output). No unit makes them a person's place in the room.
"""

import numpy as np

from hri_predict.base.errors import RecordingError
from hri_predict.base.skeleton import JOINTS
from hri_predict.recording.plausibility import judged
from hri_predict.recording.recording import Recording

KINDS = ("csv", "npy")
_SHALLOW = 0.02
"""Depth of the hips' midpoint per size of the body in the picture: the origin, with rounding."""
_MOST = 0.95
"""Share of the judged frames that must match."""
_PAIRS = [[JOINTS.index(f"{side}_{part}") for side in "lr"] for part in ("hip", "shoulder")]


def check_not_picture(recording: Recording) -> None:
    """Refuse coordinates in a picture.

    Raises:
        RecordingError: one line with the remedy.
    """
    if recording.kind not in KINDS:
        return
    found = []
    for scene in judged(recording):
        for person in scene.people:
            raw = person.positions @ recording.joint_map.rotation
            joints, seen = recording.joint_map.map(raw, person.observed)
            if not seen[_PAIRS].all():
                continue
            hips, shoulders = joints[_PAIRS].mean(axis=1)
            size = float(np.ptp(joints[seen][:, :2], axis=0).max())
            below = hips[1] - shoulders[1] > 0.1 * size
            aside = np.abs(hips[:2]).max() > 0.1 * size  # or else the hips are the origin
            found.append(bool(below and aside and abs(hips[2]) < _SHALLOW * size))
    if found and np.mean(found) >= _MOST:
        raise RecordingError(
            f"recording {recording.path}: its coordinates are those of a picture (x and y in the "
            f"image, depth from the hips), which hold no place in the room; record positions in "
            f"metres: a depth camera's, or triangulated ones"
        )
