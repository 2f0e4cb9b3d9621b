"""Opens a recording of any known kind."""

import logging
import os
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from hri_predict.base.errors import (
    ConfigError,
    RecordingError,
    UnusableRecordingError,
    nearest_file,
)
from hri_predict.contracts.joint_map import JointMap
from hri_predict.recording.format_table import ENDINGS, Format, of_ending
from hri_predict.recording.formats.openpose import frames_in
from hri_predict.recording.naming import check_known, with_map
from hri_predict.recording.own_frame import in_own_frame
from hri_predict.recording.plausibility import PUBLISHED, check_possible
from hri_predict.recording.recording import Recording, check_rate
from hri_predict.recording.refusing.picture import check_not_picture
from hri_predict.recording.refusing.relative import check_relative
from hri_predict.recording.refusing.unseen import without_unseen
from hri_predict.recording.ros.bag import file_of
from hri_predict.recording.ros.people import read_bag
from hri_predict.recording.sniffing import seems
from hri_predict.recording.unused import tell_unused
from hri_predict.recording.wanted import Wanted

log = logging.getLogger(__name__)
_noted: set[Path] = set()
"""Recordings with notes already logged, because commands open some several times."""


def open_recording(
    path: str | Path,
    *,
    person: int = 1,
    unit_m: float | None = None,
    axes: Sequence[str] | None = None,
    rate_hz: float | None = None,
    any_joints: bool = False,
    joint_map: JointMap | None = None,
    topic: str | None = None,
    frame: str | None = None,
) -> Recording:
    """Read a recording; its kind follows from the file's ending.

    Args:
        path: the file, or the folder of a ROS 2 bag or of OpenPose's frames.
        person: id of the body, for formats with a single one.
        unit_m: metres per unit of a motion file; default: as the file or its format states.
        axes: a motion file's axes that are forward, left and up; default: its format's.
        rate_hz: frames per second of a file without times.
        any_joints: read it even if the joints' names give no canonical joint.
        joint_map: the user's own map, instead of the one that the names give.
        topic: topic of the people in a ROS bag; default: the only one.
        frame: frame in which they are wanted; default: the topmost one above theirs.

    Raises:
        RecordingError: the file is missing, truncated, empty, of unknown kind, or relative to the
            hips; one line that names the file and the remedy.
        UnusableRecordingError: it is whole, but the names of its joints are unknown.
    """
    path = Path(path)
    if not os.path.exists(path):  # takes names that are too long
        raise RecordingError(f"recording {path}: no such file{nearest_file(path)}; check the path")
    path = next(iter(frames_in(path)), file_of(path))
    if not path.is_file():
        what = "a folder; name a file in it" if path.is_dir() else "a device, not a file"
        raise RecordingError(f"recording {path}: is {what}; {_accepted()}")
    ending = path.suffix.lower()
    try:
        if path.stat().st_size == 0:
            raise RecordingError(f"recording {path}: empty (0 bytes); copy it again")
        if ending not in ENDINGS:
            raise RecordingError(f"recording {path}: {_unknown(path, ending)}")
        try:
            chosen = next(each for each in of_ending(ending) if each.is_mine(path))
            if rate_hz is not None:
                check_rate(path, "--fps", rate_hz)
            wanted = Wanted(
                person=person, unit_m=unit_m, axes=axes, rate_hz=rate_hz, topic=topic, frame=frame,
                joint_map=joint_map,
            )  # fmt: skip
            recording = _read(chosen, path, wanted)
            # only now: a damaged file is to be said first
            if topic is not None and chosen.read is not read_bag:
                raise RecordingError(f"recording {path}: no topics; leave --topic out")
            if rate_hz is not None and not chosen.may_lack_times:
                raise RecordingError(f"recording {path}: has times of its own; leave --fps out")
        except RecordingError as error:
            raise RecordingError(f"{error}{_but(path, ending)}") from error
        if joint_map is not None:
            recording = with_map(recording, joint_map)
        elif not any_joints:
            _check_known(path, recording.joint_map)
        if not any_joints:
            tell_unused(path, recording.joint_map)
        check_relative(recording)
        check_not_picture(recording)
        recording = without_unseen(recording)
    except OSError as error:
        reason = error.strerror or type(error).__name__
        raise RecordingError(f"recording {path}: cannot be read: {reason}") from error
    except ConfigError as error:
        raise RecordingError(f"recording {path}: {error}") from error
    return recording


def _read(chosen: Format, path: Path, wanted: Wanted) -> Recording:
    recording = chosen.read(path, wanted)
    if wanted.unit_m is not None or wanted.axes is not None:
        return recording
    return in_own_frame(recording, lambda unit_m: chosen.read(path, replace(wanted, unit_m=unit_m)))


def opened(entry: Path | Recording, joint_map: JointMap | None = None) -> Recording:
    """Return a recording in memory unchanged, or a file from ``open_recording`` if it is plausible.

    Its note is logged.

    Raises:
        RecordingError: the file cannot be read, or ``check_possible`` refuses it.
    """
    if isinstance(entry, Recording):
        return entry
    recording = open_recording(entry, joint_map=joint_map)
    if recording.note and recording.kind not in PUBLISHED and recording.path not in _noted:
        _noted.add(recording.path)
        log.warning("recording %s: %s", recording.path, recording.note)
    check_possible(
        recording, lambda unit_m: open_recording(entry, unit_m=unit_m, joint_map=joint_map)
    )
    return recording


def _check_known(path: Path, joint_map: JointMap) -> None:
    try:
        check_known(joint_map)
    except ConfigError as error:
        raise UnusableRecordingError(f"recording {path}: {error}") from error


def _accepted() -> str:
    """Return the names of the kinds that can be read."""
    kinds = []
    for ending in ENDINGS:
        only = ", ".join(each.only for each in of_ending(ending) if each.only)
        kinds.append(f"{ending} ({only})" if only else ending)
    return f"accepted are {', '.join(kinds[:-1])}, and {kinds[-1]}"


def _unknown(path: Path, ending: str) -> str:
    """Return why a file with this ending is not opened, and its probable kind."""
    own, what = seems(path)
    if own:
        return f"seems to be {own}, {what}; name it so (its ending is '{ending}')"
    seeming = f", and its content seems to be {what}" if what else ""
    return f"unknown kind '{ending or 'no ending'}'{seeming}; {_accepted()}"


def _but(path: Path, ending: str) -> str:
    """Return the file's probable format, if its name says something else."""
    own, what = seems(path)
    if not what or own == ending:
        return ""
    return f" (its content seems to be {f'{own}, {what}' if own else what})"
