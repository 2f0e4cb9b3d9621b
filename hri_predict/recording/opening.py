"""Opens a recording of any kind that is known."""

import os
from collections.abc import Sequence
from pathlib import Path

from hri_predict.errors import RecordingError
from hri_predict.recording.bvh import read_bvh
from hri_predict.recording.mcap_reader import read_mcap
from hri_predict.recording.npz import read_npz
from hri_predict.recording.recording import Recording

ACCEPTED = "accepted are .npz (the data pack's layouts), .bvh, and .mcap (recorded by this node)"


def open_recording(
    path: str | Path,
    *,
    person: int = 1,
    unit_m: float | None = None,
    axes: Sequence[str] | None = None,
) -> Recording:
    """Read a recording; its kind follows from the file's ending.

    Args:
        path: the file.
        person: the id of the body, for files that know but one.
        unit_m: metres per unit of a BVH file; default 0.01, centimetres.
        axes: a BVH file's axes that are forward, left and up; default y up.

    Raises:
        RecordingError: missing, truncated, empty, of unknown kind, or with unknown joint names; one
            line that names the file and the remedy.
    """
    path = Path(path)
    if not os.path.exists(path):  # bears a name that is too long
        raise RecordingError(f"recording {path}: no such file; check the path")
    if not path.is_file():
        what = "a folder; name a file in it" if path.is_dir() else "a device, not a file"
        raise RecordingError(f"recording {path}: is {what}; {ACCEPTED}")
    ending = path.suffix.lower()
    try:
        if path.stat().st_size == 0:
            raise RecordingError(f"recording {path}: is empty (0 bytes); copy it again")
        if ending == ".npz":
            return read_npz(path, person)
        if ending == ".bvh":
            return read_bvh(path, person, unit_m, axes)
        if ending == ".mcap":
            return read_mcap(path)
    except OSError as error:
        reason = error.strerror or type(error).__name__
        raise RecordingError(f"recording {path}: cannot be read: {reason}") from error
    raise RecordingError(f"recording {path}: unknown kind '{ending or 'no ending'}'; {ACCEPTED}")
