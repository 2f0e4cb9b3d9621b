"""Human3.6M in the layout usual for motion prediction; users bring their own copy.

``S5/walking_1.txt``: one folder per subject, one file per action and take, a frame per line, 99
comma-separated numbers: root translation and 32 exponential maps, at 50 Hz. Every second frame is
kept. Of positions, root rotation and translation are excluded, and the error is counted over the 22
joints that move (Mao et al., "Learning Trajectory Dependencies for Human Motion Prediction", ICCV
2019; 22 joints: Dang et al., "MSR-GCN", ICCV 2021). Exponential maps are those of all 32 joints as
stored, the root's rotation included (KD-Former). Subject 5 is the test set.
"""

import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from hri_predict.base.arrays import Floats
from hri_predict.base.errors import ConfigError, RecordingError
from hri_predict.lab.datasets.cmu_benchmark import check_values
from hri_predict.lab.datasets.expmap import joint_positions
from hri_predict.predictors.neural.human_skeleton import HUMAN32, OFFSETS_MM

TEST_SUBJECT, VALIDATION_SUBJECT = "S5", "S11"
FIT_SUBJECTS = ("S1", "S6", "S7", "S8", "S9")
_STEP = 2
_COLUMNS = 99
_SEED = 1234567890
SEEDED = {"8-seeds": 4, "256-seeds": 128}
"""Windows of each of an action's two takes, by name."""


@dataclass(frozen=True, slots=True, eq=False)
class Take:
    """One take of an action.

    Attributes:
        name: ``S5/walking_1``.
        positions: (n, 32, 3) millimetres at 25 frames per second: x left, y up, z forward.
        maps: (n, 32, 3) exponential maps as stored, radians; the root's first.
    """

    name: str
    action: str
    positions: Floats
    maps: Floats


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
    maps = stored[::_STEP, 3:].reshape(-1, len(HUMAN32.joints), 3)
    name = f"{path.parent.name}/{path.stem}"
    action = path.stem.rpartition("_")[0]
    return Take(name, action, joint_positions(maps, HUMAN32.parents, OFFSETS_MM), maps)


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


def seeded_windows(
    frames: list[int], n_in: int, windows: str = "8-seeds"
) -> list[NDArray[np.intp]]:
    """First frames of the windows of an action, drawn from each of its two takes in turn.

    The draws are those of Jain et al., "Structural-RNN", CVPR 2016, which all papers repeat; with
    ``256-seeds`` they go on (Dang et al., "MSR-GCN", ICCV 2021).

    Raises:
        RecordingError: there are not two takes, or one is too short.
    """
    if len(frames) != 2 or min(frames) <= 150 + 16:
        raise RecordingError(
            f"seeded windows need two takes of more than 166 frames at 25 Hz of each action, "
            f"found takes of {', '.join(map(str, frames))} frames; use --windows all"
        )
    draw = np.random.RandomState(_SEED)
    pairs = range(SEEDED[windows])
    starts = [[draw.randint(16, n - 150) + 50 - n_in for n in frames] for _ in pairs]
    return [np.array([pair[take] for pair in starts], dtype=np.intp) for take in range(2)]
