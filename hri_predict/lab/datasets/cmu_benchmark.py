"""The CMU-Mocap prediction benchmark: its poses and its windows, exactly as in the papers.

Frames 0, 2, 4, ... of each recording, the rest pose at frame 0 included, count as 25 per second
(in truth 60). Poses are in "millimetres", 1.24 of which are a true one, in the frame of a root that
neither turns nor moves. All times and lengths here are nominal; see the data's own description.

Seeds and window rules: Li et al., "Convolutional Sequence to Sequence Model for Human Dynamics",
CVPR 2018; 3D poses: Mao et al., "Learning Trajectory Dependencies for Human Motion Prediction",
ICCV 2019.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hri_predict.base.arrays import Floats
from hri_predict.base.errors import ConfigError, RecordingError
from hri_predict.lab.datasets.expmap import joint_positions
from hri_predict.predictors.neural.cmu_skeleton import (
    CMU38,
    CONSTANT,
    DUPLICATES,
    MM_PER_UNIT,
    MOVING,
    OFFSETS,
)
from hri_predict.recording.formats.npz import read_arrays

ACTIONS = (
    "basketball",
    "basketball_signal",
    "directing_traffic",
    "jumping",
    "running",
    "soccer",
    "walking",
    "washwindow",
)
MEAN_OVER = ("basketball", "jumping", "running", "soccer", "walking")
"""The actions whose train and test recordings are all available."""

RATE_HZ = 25.0
"""Nominal frames per second."""

_STEP = 2
_SEED = 1234567890
_CLIP = 75  # frames that a seeded window is drawn for: 50 before the origin and 25 after it
_ORIGIN = 50
_COLUMNS = 3 + 3 * len(CMU38.joints)
MAX_MAGNITUDE = 1e6  # of angles and root positions: more is damage and would overflow
_AXES = (2, 0, 1)  # the benchmark's left, up, forward to forward, left, up


@dataclass(frozen=True, slots=True, eq=False)
class Clip:
    """A recording at the benchmark's nominal 25 frames per second.

    Attributes:
        name: ``train/walking_1``.
        expmaps: (n, 38, 3) exponential maps as stored, radians, the root's included.
    """

    name: str
    action: str
    expmaps: Floats

    def positions(self) -> Floats:
        """(n, 38, 3) benchmark pose in benchmark mm: x left, y up, z forward."""
        return joint_positions(self.expmaps, CMU38.parents, MM_PER_UNIT * OFFSETS)


def data_root(directory: Path) -> Path:
    """Return the folder that holds ``train/`` and ``test/``: ``directory`` or its ``cmu_mocap``.

    Raises:
        ConfigError: neither has them.
    """
    for root in (directory, directory / "cmu_mocap"):
        if (root / "test").is_dir():
            return root
    raise ConfigError(
        f"--data {directory}: no folder 'test' of CMU recordings (.npz with 'expmap') there or in "
        f"its 'cmu_mocap'; give the folder that holds 'train' and 'test'"
    )


def action_of(name: str) -> str:
    """``train/basketball_signal_3`` to ``basketball_signal``."""
    return name.rpartition("/")[2].rpartition("_")[0]


def read_clip(root: Path, name: str) -> Clip:
    """Read every second frame of ``<root>/<name>.npz``.

    Raises:
        RecordingError: missing, damaged, too large, or without exponential maps of 38 joints.
    """
    path = root / f"{name}.npz"
    stored = read_arrays(path, ("expmap",)).get("expmap")
    if stored is None:
        raise RecordingError(f"recording {path}: lacks 'expmap'; give the benchmark's own file")
    if stored.ndim != 2 or stored.shape[1] != _COLUMNS or stored.dtype.kind not in "fiu":
        raise RecordingError(
            f"recording {path}: 'expmap' is {stored.dtype} of shape {stored.shape}; expected "
            f"numbers of shape (frames, {_COLUMNS})"
        )
    check_values(path, stored)
    frames = stored[::_STEP].astype(np.float64)
    return Clip(name, action_of(name), frames[:, 3:].reshape(-1, len(CMU38.joints), 3))


def check_values(path: Path, stored: NDArray[Any]) -> None:
    """Reject numbers that no recorded pose can have.

    Args:
        path: the file, for the error.
        stored: (frames, columns) numbers: exponential maps, and a translation.

    Raises:
        RecordingError: there are none, or some is NaN, infinite or beyond ``MAX_MAGNITUDE``.
    """
    if len(stored) == 0:
        raise RecordingError(f"recording {path}: empty (no frames); leave it out")
    finite = np.isfinite(stored)
    if not finite.all():
        frame = int(np.flatnonzero(~finite.all(axis=1))[0])
        raise RecordingError(
            f"recording {path}: NaN or infinite in frame {frame}; repair it, or leave it out"
        )
    if (np.abs(stored.astype(np.float64)) > MAX_MAGNITUDE).any():
        raise RecordingError(
            f"recording {path}: values beyond {MAX_MAGNITUDE:g} are not a pose; copy it again"
        )


def benchmark_names(root: Path, split: str) -> list[str]:
    """Names of the benchmark's recordings in ``split`` (``train`` or ``test``), sorted."""
    names = [f"{split}/{path.stem}" for path in (root / split).glob("*.npz")]
    return sorted(name for name in names if action_of(name) in ACTIONS)


def all_windows(frames: int, n_in: int, n_out: int) -> NDArray[np.intp]:
    """First frames of all windows of ``n_in + n_out``; empty for a shorter recording."""
    return np.arange(max(0, frames - n_in - n_out + 1))


def seeded_windows(frames: int, n_in: int, count: int) -> NDArray[np.intp]:
    """First frames of the ``count`` windows that the papers draw, the same for every file.

    Windows are drawn for 50 + 25 frames, however many of them are observed and predicted.

    Raises:
        RecordingError: the recording is too short to draw any.
    """
    if frames <= _CLIP:
        raise RecordingError(
            f"its {frames} frames at the nominal rate are too few: seeded windows need more than "
            f"{_CLIP}; use --windows all"
        )
    draw = np.random.RandomState(_SEED)
    return np.asarray(draw.randint(0, frames - _CLIP, count) + _ORIGIN - n_in, dtype=np.intp)


def windows_of(choice: str, frames: int, n_in: int, n_out: int) -> NDArray[np.intp]:
    """First frames of the test windows: ``all``, ``8-seeds`` or ``80-seeds``."""
    if choice == "all":
        return all_windows(frames, n_in, n_out)
    return seeded_windows(frames, n_in, int(choice.removesuffix("-seeds")))


def cut(frames: Floats, starts: NDArray[np.intp], n_in: int, n_out: int) -> tuple[Floats, Floats]:
    """Histories (N, n_in, ...) and futures (N, n_out, ...) of windows that begin at ``starts``."""
    history = frames[starts[:, None] + np.arange(n_in)]
    future = frames[starts[:, None] + np.arange(n_in, n_in + n_out)]
    return history, future


def joint_errors(predicted: Floats, true: Floats) -> Floats:
    """(N, H, 38) distance of each joint, as the papers count it.

    The seven duplicates have the error of the joint they copy; the six constant ones have none.

    Args:
        predicted: (N, H, 25, 3) of ``MOVING``.
        true: (N, H, 25, 3).
    """
    errors = np.zeros((*predicted.shape[:2], len(CMU38.joints)))
    errors[..., MOVING] = np.linalg.norm(predicted - true, axis=-1)
    for joint, twin in DUPLICATES.items():
        errors[..., joint] = errors[..., twin]
    assert not errors[..., CONSTANT].any()
    return errors


def to_model(millimetres: Floats) -> Floats:
    """Benchmark mm (..., 3) with axes left, up, forward to metres with forward, left, up."""
    return np.asarray(millimetres[..., _AXES]) / 1000.0


def from_model(metres: Floats) -> Floats:
    """The inverse of ``to_model``."""
    return 1000.0 * np.asarray(metres)[..., np.argsort(_AXES)]
