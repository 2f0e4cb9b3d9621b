"""Draws the people found in an image onto a copy of it."""

from itertools import pairwise
from pathlib import Path

import numpy as np

from hri_drivers.camera.place.placed import MIN_VISIBILITY
from hri_drivers.camera.seen import Image, Seen
from hri_predict.base.errors import ConfigError
from hri_predict.contracts.joint_map import load_joint_map

ENDINGS = (".png", ".jpg", ".jpeg")
_ARM = ("shoulder", "elbow", "wrist", "index")
_LEG = ("hip", "knee", "ankle", "heel", "foot_index")
BONES = [
    *(
        (f"{side}_{a}", f"{side}_{b}")
        for side in ("left", "right")
        for chain in (_ARM, _LEG, ("shoulder", "hip"))
        for a, b in pairwise(chain)
    ),
    ("left_shoulder", "right_shoulder"),
    ("left_hip", "right_hip"),
    ("left_ear", "nose"),
    ("right_ear", "nose"),
]
_COLOURS = ((0, 200, 255), (255, 160, 0), (80, 220, 80), (220, 100, 255))


def check(path: Path) -> None:
    """Reject, before starting, a path to which the image cannot be written.

    Raises:
        ConfigError: the ending is wrong, or the folder does not exist.
    """
    if path.suffix.lower() not in ENDINGS:
        raise ConfigError(f"--preview {path}: name a file that ends with {' or '.join(ENDINGS)}")
    if not path.absolute().parent.is_dir():
        raise ConfigError(f"--preview {path}: the folder does not exist; create it first")


def write(path: Path, image: Image, people: list[Seen]) -> None:
    """Draw people onto a copy of the image they were found in: joints, bones and ids.

    Hidden joints are hollow.

    Raises:
        ConfigError: the file cannot be written.
    """
    import cv2

    picture = image.pixels.copy()
    thick = max(1, round(max(picture.shape[:2]) / 400))
    for seen in people:
        colour = _COLOURS[seen.id % len(_COLOURS)]
        names = {name: k for k, name in enumerate(load_joint_map(seen.layout).source_joints)}
        known = np.isfinite(seen.pixels).all(axis=1)
        at = [(int(x), int(y)) for x, y in np.nan_to_num(seen.pixels)]
        shown = known & (seen.visibility >= MIN_VISIBILITY)
        for a, b in BONES:
            i, j = names.get(a), names.get(b)
            if i is not None and j is not None and shown[i] and shown[j]:
                cv2.line(picture, at[i], at[j], colour, thick)
        for k in np.flatnonzero(known):
            cv2.circle(picture, at[k], 2 * thick, colour, -1 if shown[k] else 1)
        if known.any():
            top = at[int(np.nanargmin(seen.pixels[:, 1]))]
            text = f"{seen.id}"
            cv2.putText(picture, text, top, cv2.FONT_HERSHEY_SIMPLEX, 0.5 * thick, colour, thick)
    try:
        done = cv2.imwrite(str(path), picture)
    except cv2.error:
        done = False
    if not done:
        raise ConfigError(f"--preview {path}: cannot be written; name another file")
