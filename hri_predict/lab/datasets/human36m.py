"""Human3.6M in the layout usual for motion prediction; users bring their own copy.

``S5/walking_1.txt``: one folder per subject, one file per action and take, a frame per line, 99
comma-separated numbers: root translation and 32 exponential maps, at 50 Hz. Every second frame is
kept, root rotation and translation are excluded, and the error is counted over the 22 joints that
move (Mao et al., "Learning Trajectory Dependencies for Human Motion Prediction", ICCV 2019; 22
joints: Dang et al., "MSR-GCN", ICCV 2021). Subject 5 is the test set.
"""

import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from hri_predict.base.arrays import Floats
from hri_predict.base.errors import ConfigError, RecordingError
from hri_predict.base.skeleton import Skeleton, make_skeleton
from hri_predict.lab.datasets.cmu_benchmark import check_values
from hri_predict.lab.datasets.expmap import joint_positions

TEST_SUBJECT, VALIDATION_SUBJECT = "S5", "S11"
FIT_SUBJECTS = ("S1", "S6", "S7", "S8", "S9")
_STEP = 2
_COLUMNS = 99
_SEED = 1234567890
_SEEDED_PAIRS = 4

# name, parent, offset from the parent in mm; x to the left, y up, z forward
_TABLE = (
    ("Hips", -1, (0.0, 0.0, 0.0)),
    ("RightUpLeg", 0, (-132.948591, 0.0, 0.0)),
    ("RightLeg", 1, (0.0, -442.894612, 0.0)),
    ("RightFoot", 2, (0.0, -454.206447, 0.0)),
    ("RightToeBase", 3, (0.0, 0.0, 162.767078)),
    ("RightToeBase_End", 4, (0.0, 0.0, 74.999437)),
    ("LeftUpLeg", 0, (132.948826, 0.0, 0.0)),
    ("LeftLeg", 6, (0.0, -442.894413, 0.0)),
    ("LeftFoot", 7, (0.0, -454.20659, 0.0)),
    ("LeftToeBase", 8, (0.0, 0.0, 162.767426)),
    ("LeftToeBase_End", 9, (0.0, 0.0, 74.999948)),
    ("Spine", 0, (0.0, 0.1, 0.0)),
    ("Spine1", 11, (0.0, 233.383263, 0.0)),
    ("Neck", 12, (0.0, 257.077681, 0.0)),
    ("Head", 13, (0.0, 121.134938, 0.0)),
    ("Head_End", 14, (0.0, 115.002227, 0.0)),
    ("LeftShoulder", 12, (0.0, 257.077681, 0.0)),
    ("LeftArm", 16, (0.0, 151.034226, 0.0)),
    ("LeftForeArm", 17, (0.0, 278.882773, 0.0)),
    ("LeftHand", 18, (0.0, 251.733451, 0.0)),
    ("LeftHand_Twin", 19, (0.0, 0.0, 0.0)),
    ("LeftHandThumb", 20, (0.0, 0.0, 99.999627)),
    ("LeftHand_End", 19, (0.0, 100.000188, 0.0)),
    ("LeftHand_EndTwin", 22, (0.0, 0.0, 0.0)),
    ("RightShoulder", 12, (0.0, 257.077681, 0.0)),
    ("RightArm", 24, (0.0, 151.031437, 0.0)),
    ("RightForeArm", 25, (0.0, 278.892924, 0.0)),
    ("RightHand", 26, (0.0, 251.72868, 0.0)),
    ("RightHand_Twin", 27, (0.0, 0.0, 0.0)),
    ("RightHandThumb", 28, (0.0, 0.0, 99.999888)),
    ("RightHand_End", 27, (0.0, 137.499922, 0.0)),
    ("RightHand_EndTwin", 30, (0.0, 0.0, 0.0)),
)
OFFSETS_MM = np.array([row[2] for row in _TABLE])
PARENTS = tuple(row[1] for row in _TABLE)

_NOT_SCORED = (0, 1, 6, 11, 16, 20, 23, 24, 28, 31)
"""Joints that do not move, or lie on another joint."""
SCORED = tuple(j for j in range(len(_TABLE)) if j not in _NOT_SCORED)
_TWINS = {16: 13, 24: 13, 20: 19, 28: 27}

_PARTS = {
    "torso": (11, 12, 13, 14, 15),
    "left_arm": tuple(range(16, 24)),
    "right_arm": tuple(range(24, 32)),
    "left_leg": tuple(range(6, 11)),
    "right_leg": tuple(range(1, 6)),
}


def _skeleton() -> Skeleton:
    names = [_TABLE[j][0] for j in SCORED]
    parents = []
    for joint in SCORED:
        parent = PARENTS[joint]
        while parent >= 0 and parent not in SCORED:
            parent = _TWINS.get(parent, PARENTS[parent])
        parents.append(SCORED.index(parent) if parent >= 0 else -1)
    pairs = [(i, names.index("Right" + n[4:])) for i, n in enumerate(names) if n[:4] == "Left"]
    parts = {
        part: tuple(i for i, j in enumerate(SCORED) if j in members)
        for part, members in _PARTS.items()
    }
    return make_skeleton("human22", names, parents, left_right_pairs=pairs, parts=parts)


HUMAN22: Skeleton = _skeleton()
"""The joints that are predicted and scored."""


@dataclass(frozen=True, slots=True, eq=False)
class Take:
    """One take of an action.

    Attributes:
        name: ``S5/walking_1``.
        positions: (n, 32, 3) millimetres at 25 frames per second: x left, y up, z forward.
    """

    name: str
    action: str
    positions: Floats


def read_take(path: Path) -> Take:
    """Read every second frame of one file.

    Raises:
        RecordingError: it cannot be read, or is not of this layout.
    """
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)  # about an empty file, refused below
            stored = np.loadtxt(path, delimiter=",", ndmin=2)
    except (OSError, ValueError) as error:
        raise RecordingError(
            f"recording {path}: not lines of {_COLUMNS} comma-separated numbers; copy it again"
        ) from error
    if stored.size and stored.shape[1] != _COLUMNS:
        raise RecordingError(
            f"recording {path}: {stored.shape[1]} columns; expected {_COLUMNS} numbers a line: "
            f"root translation and 32 exponential maps"
        )
    check_values(path, stored)
    maps = stored[::_STEP, 3:].reshape(-1, len(_TABLE), 3)
    name = f"{path.parent.name}/{path.stem}"
    action = path.stem.rpartition("_")[0]
    return Take(name, action, joint_positions(maps, PARENTS, OFFSETS_MM))


def read_takes(directory: Path, subjects: Sequence[str] = (TEST_SUBJECT,)) -> dict[str, list[Take]]:
    """The takes of these subjects by action, in order.

    Args:
        directory: folder that holds the subjects' folders, itself or in its ``dataset``.
        subjects: names of their folders; some may be missing.

    Raises:
        ConfigError: the folder does not exist, or is empty.
        RecordingError: a file cannot be read.
    """
    for root in (directory, directory / "dataset"):
        files = [path for each in subjects for path in sorted((root / each).glob("*_*.txt"))]
        if files:
            found: dict[str, list[Take]] = {}
            for take in map(read_take, files):
                found.setdefault(take.action, []).append(take)
            return found
    raise ConfigError(
        f"--data {directory}: no {' or '.join(subjects)}/<action>_<n>.txt there or in its "
        f"'dataset'; give the folder that holds the subjects' folders"
    )


def seeded_windows(frames: list[int], n_in: int) -> list[NDArray[np.intp]]:
    """First frames of the eight windows of an action: four of each of its two takes, in turn.

    The draws are those of Jain et al., "Structural-RNN", CVPR 2016, which all papers repeat.

    Raises:
        RecordingError: there are not two takes, or one is too short.
    """
    if len(frames) != 2 or min(frames) <= 150 + 16:
        raise RecordingError(
            f"seeded windows need two takes of more than 166 frames at 25 Hz of each action, "
            f"found takes of {', '.join(map(str, frames))} frames; use --windows all"
        )
    draw = np.random.RandomState(_SEED)
    starts = [[draw.randint(16, n - 150) + 50 - n_in for n in frames] for _ in range(_SEEDED_PAIRS)]
    return [np.array([pair[take] for pair in starts], dtype=np.intp) for take in range(2)]
