"""Opens a recording of any known kind."""

import logging
import os
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

from hri_predict.base.errors import (
    ConfigError,
    RecordingError,
    UnusableRecordingError,
    nearest_file,
)
from hri_predict.contracts.joint_map import METRES_PER_UNIT, JointMap, load_joint_map, map_names
from hri_predict.recording.bounded import names_in_zip
from hri_predict.recording.format_table import ENDINGS, FORMATS, Format, of_ending
from hri_predict.recording.formats.csv_table import is_own_table
from hri_predict.recording.formats.openpose import frames_in
from hri_predict.recording.naming import check_known, with_map
from hri_predict.recording.plausibility import PUBLISHED, check_possible, check_size
from hri_predict.recording.recording import Recording, check_rate, noted, turned
from hri_predict.recording.refusing import check_not_picture, check_relative, without_unseen
from hri_predict.recording.ros.bag import file_of
from hri_predict.recording.ros.people import read_bag
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


HEAD_BYTES = 4096
# First bytes, and what they begin, of kinds that are not read.
_OTHERS: tuple[tuple[bytes, str], ...] = (
    (b"\x89HDF\r\n\x1a\n", "HDF5, or MATLAB 7.3"),
    (b"MATLAB 5.0 MAT-file", "MATLAB"),
    (b"Kaydara FBX Binary", "FBX"),
    (b"; FBX", "FBX as text"),
    (b"glTF", "glTF, or VRM"),
    (b"LOGG", "Vector's BLF: bus traffic, not motion"),
    (b";$FILEVERSION", "PEAK's trace of a CAN bus: bus traffic, not motion"),
    (b"date ", "Vector's ASC: bus traffic, not motion"),
    (b":ASF", "Acclaim's skeleton (ASF)"),
    (b"# AST/ASF", "Acclaim's skeleton (ASF)"),
    (b"#!OML:ASF", "Acclaim's motion (AMC)"),
    (b":FULLY-SPECIFIED", "Acclaim's motion (AMC)"),
    (b"PAR1", "Parquet"),
    (b"ARROW1", "Arrow"),
    (b"PXR-USDC", "USD"),
    (b"\x1f\x8b", "gzip: unpack it"),
    (b"7z\xbc\xaf\x27\x1c", "7-Zip: unpack it"),
    (b"Rar!", "RAR: unpack it"),
    (b"BZh", "bzip2: unpack it"),
    (b"\xfd7zXZ", "xz: unpack it"),
    (b"\x28\xb5\x2f\xfd", "Zstandard: unpack it"),
    (b"\x89PNG", "an image (PNG)"),
    (b"\xff\xd8\xff", "an image (JPEG)"),
    (b"%PDF", "PDF"),
    (b"\x7fELF", "a program"),
    (b"version https://git-lfs", "a Git LFS pointer: fetch the file itself by git lfs pull"),
)


def seems(path: Path) -> tuple[str, str]:
    """Return the probable ending and content of a file by its first bytes; only for explanations.

    They are (".bvh", "BVH") or ("", "FBX"): the ending is "" for a kind that is not read, and both
    are "" for an unknown one.

    Raises:
        OSError: it cannot be read.
    """
    with path.open("rb") as file:
        head = file.read(HEAD_BYTES)
    if head[4:8] == b"ftyp":
        return "", "a film (MP4)"
    text = head.removeprefix(b"\xef\xbb\xbf").lstrip()
    for magic, what in _OTHERS:
        if head.startswith(magic) or (magic.isascii() and text.startswith(magic)):
            return "", what
    for each in FORMATS:
        if each.looks(path, head):
            return each.ending, each.content
    if head[:1] == b"\x80" and head[1:2] in (b"\2", b"\3", b"\4", b"\5"):
        return ".pkl", "a Python pickle, of which only 3DPW's are read, as data"
    if head.startswith(b"PK\x03\x04"):
        return "", _zip(path)
    return "", "" if b"\0" in head else _text(text)


def _zip(path: Path) -> str:
    names = names_in_zip(path)
    if names is None:
        return "a damaged zip archive"
    if "[Content_Types].xml" in names:
        return "an Office document: save it as CSV"
    return "a zip archive: unpack it"


def _text(text: bytes) -> str:
    if text.startswith((b"{", b"[")):
        return "JSON"
    if text.startswith(b"<"):
        return "Xsens MVNX" if b"<mvnx" in text else "XML"
    return ""


KINDS = ("csv", "npy", "openpose", "3dpw")
UP = ("x", "y", "z"), ("x", "-z", "y"), ("z", "-x", "-y")
"""Axes that are forward, left and up: z up, y up, and a camera's (x right, y down, z away)."""
_UNITS = (1.0, 0.001)

Reopened = Callable[[float], Recording]


def in_own_frame(recording: Recording, reopened: Reopened) -> Recording:
    """Return the recording in the units and axes in which people stand, with a note if it changed.

    For dumps that state neither, if the joints' names identify the tracker. A table of Azure Kinect
    is in millimetres, y down; FreeMoCap writes the same names as MediaPipe, but millimetres, z up.
    The horizontal axis that points ahead is only a convention: no body shows the room's heading.

    Unchanged are recordings that make sense as they are, of other formats, of unknown trackers,
    tables that this project wrote, whose units and axes are known (a person may lie there), and
    those that make no sense in any of these frames: ``check_possible`` says why.

    Args:
        recording: as its format's usual units and axes give it.
        reopened: reads the file again with other metres per unit.
    """
    name = recording.joint_map.name.removesuffix(" by name")
    known = name in map_names() and name not in ("bvh", "canonical")
    tracker = load_joint_map(name) if known else None
    if recording.kind not in KINDS or tracker is None:
        return recording
    if not _refused(recording, partial(check_possible, reopened=reopened)):
        return recording
    if recording.kind == "csv" and is_own_table(recording.path):
        return recording
    for unit_m in dict.fromkeys((recording.joint_map.scale_to_m, tracker.scale_to_m, *_UNITS)):
        same = unit_m == recording.joint_map.scale_to_m
        sized = recording if same else reopened(unit_m)
        if _refused(sized, check_size):
            continue
        for joint_map in _turns(sized.joint_map, tracker):
            found = turned(sized, joint_map)
            if not _refused(found, check_possible):
                return noted(found, _note(joint_map, name))
    return recording


def _refused(recording: Recording, check: Callable[[Recording], None]) -> str:
    try:
        check(recording)
    except RecordingError as error:
        return str(error)
    return ""


def _turns(own: JointMap, tracker: JointMap) -> list[JointMap]:
    rotations = [tracker.rotation, *(own.with_axes(axes).rotation for axes in UP)]
    return [replace(own, rotation=rotation) for rotation in rotations]


def _note(joint_map: JointMap, name: str) -> str:
    units = {scale: unit for unit, scale in METRES_PER_UNIT.items()}
    unit = units.get(joint_map.scale_to_m, f"{joint_map.scale_to_m:g} m")
    axes = []
    for row in joint_map.rotation:
        axis = int(np.argmax(np.abs(row)))
        axes.append(("-" if row[axis] < 0 else "") + "xyz"[axis])
    return (
        f"by the names of its joints ({name}) and by how people stand it is in {unit}, with "
        f"{','.join(axes)} forward, left and up (--units and --axes of convert say otherwise)"
    )
