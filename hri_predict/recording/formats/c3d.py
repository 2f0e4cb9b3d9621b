"""C3D files of optical motion capture: their 3D points; the residual marks unseen points.

Based on the C3D User Guide (Motion Lab Systems, c3d.org): blocks of 512 bytes; a header; parameters
in groups; then for each frame the points (x, y, z and a word of cameras and residual, below 0 where
the point was not reconstructed) and the analog samples, which are skipped. Numbers are integers or
floats of Intel, DEC (VAX F_floating) or MIPS machines.

We use our own reader: the C++ library for these files crashes or hangs on damaged files, which is
not acceptable in a process that watches a robot. The tests compare the reader with that library.
"""

import struct
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from hri_predict.base.arrays import Floats
from hri_predict.base.errors import ConfigError, RecordingError
from hri_predict.contracts.joint_map import METRES_PER_UNIT
from hri_predict.recording.bounded import check_joints, read_bounded
from hri_predict.recording.formats.c3d_parameters import (
    BLOCK,
    MAGIC,
    Damaged,
    Parameters,
    pack_parameters,
    read_parameters,
)
from hri_predict.recording.frames import Written, frames_of
from hri_predict.recording.labels import joined_labels, split_labels
from hri_predict.recording.naming import map_of_names
from hri_predict.recording.recording import Recording, check_rate, converted_by, noted, recording_of
from hri_predict.recording.wanted import Wanted

MM_PER_M = 1000.0
MAX_POINTS, MAX_LABEL = 65535, 127
MAX_BLOCK = 65536  # the last block at which the points may start
MAX_COUNT = 65535  # the most frames that the header can count
MAX_FRAMES = 2**31  # more than any file has
PER_PARAMETER = 255  # labels per parameter: a dimension is one byte
NO_POSITIONS = ("ANGLES", "FORCES", "MOMENTS", "POWERS", "SCALARS")  # labels of model outputs
# Axes that are forward, left and up, where POINT:Y_SCREEN (the screen's vertical) is ...
_AXES = {"Z": ("x", "y", "z"), "Y": ("z", "x", "y"), "X": ("y", "z", "x")}
_AXES |= {"-Z": ("x", "-y", "-z"), "-Y": ("z", "-x", "-y"), "-X": ("y", "-z", "-x")}


@dataclass(frozen=True, kw_only=True)
class _Layout:
    """Offsets of the frames, and the number of values in each."""

    start: int
    frames: int
    points: int
    analog: int
    scale: float

    @property
    def word(self) -> int:
        return 4 if self.scale < 0 else 2

    @property
    def frame_bytes(self) -> int:
        return (4 * self.points + self.analog) * self.word


def read_c3d(path: Path, wanted: Wanted) -> Recording:
    """Read the points of a C3D file; ``Anna:LWrist`` is a marker of the person Anna.

    ``wanted.person`` is the first id for people whose labels give no number. By default, units are
    POINT:UNITS, and up is POINT:Y_SCREEN, or z if the file does not state it.

    Raises:
        RecordingError: the file is not C3D, is truncated or damaged, or has no points.
        ConfigError: impossible units or axes; labels that name no person, or too many people.
    """
    data = read_bounded(path)
    if len(data) < 2 * BLOCK or data[1] != MAGIC:
        raise RecordingError(f"recording {path}: not a C3D file, or truncated; export it again")
    try:
        parameters = read_parameters(data)
        layout, stale = _layout(path, data, parameters)
    except Damaged as error:
        raise RecordingError(
            f"recording {path}: its C3D parameters are damaged ({error}); export it again"
        ) from error
    labels = parameters.texts("POINT", "LABELS")[: layout.points]
    labels += [f"*{k + 1}" for k in range(len(labels), layout.points)]
    left_out = [label for kind in NO_POSITIONS for label in parameters.texts("POINT", kind)]
    markers = split_labels(labels, wanted.person, left_out)
    check_joints(path, layout.frames, *markers.columns.shape)
    rate_hz = parameters.number("POINT", "RATE", 0.0) or parameters.header_float(data, 20)
    check_rate(path, "POINT:RATE", rate_hz)
    unit_m = _unit(path, parameters) if wanted.unit_m is None else None
    axes = _axes(parameters) if wanted.axes is None else None
    joint_map = wanted.of_file(map_of_names(markers.joints), unit_m, axes)
    points, zeros = _points(data, parameters, layout)
    people = markers.people(points)
    recording = recording_of(path, "c3d", joint_map, people, rate_hz=rate_hz, ids=markers.ids)
    at_zero = f"{zeros} points at exactly 0, 0, 0 are not observed" if zeros else ""
    return noted(noted(noted(recording, markers.note), stale), at_zero)


def _layout(path: Path, data: bytes, parameters: Parameters) -> tuple[_Layout, str]:
    """The layout, and a note where the file's own counts of frames differ.

    Header and parameters may be stale: a count of 0 is ignored, and of several frame counts, the
    one that matches the file's length is used.
    """
    word = parameters.header_word
    number = parameters.number
    scale = number("POINT", "SCALE", 0.0) or parameters.header_float(data, 12)
    block = number("POINT", "DATA_START", 0.0) or word(data, 16)
    layout = _Layout(
        start=(int(block) - 1) * BLOCK if 0 < block < MAX_BLOCK else 0,
        frames=0,
        points=word(data, 2) or parameters.count("POINT", "USED", MAX_POINTS),
        analog=word(data, 4),
        scale=scale,
    )
    counts = _counts(data, parameters)
    most = max(counts.values(), default=0)
    if layout.points == 0 or most < 1:
        raise RecordingError(f"recording {path}: empty ({layout.points} points, {most} frames)")
    if layout.start < 2 * BLOCK or not abs(layout.scale) <= 1e6 or layout.scale == 0:
        raise Damaged("where the points start, or their scale")
    held, whole = _held(data, layout)
    stated = next(iter(counts.values()))
    confirmed = [n for n in counts.values() if held - whole <= n <= held]
    if confirmed:
        frames = stated if stated in confirmed else max(confirmed)
    elif whole >= 0 and held > 0:
        frames = held - whole
    elif stated <= held:  # something else follows the points
        frames = max(n for n in counts.values() if n <= held)
    else:
        raise RecordingError(
            f"recording {path}: truncated: {held} of {stated} frames are there; export it again"
        )
    said = ", ".join(f"{name} {n}" for name, n in counts.items() if n != frames)
    note = f"{frames} frames are read, according to its length; other counts in it: {said}"
    return replace(layout, frames=frames), note if said else ""


def _counts(data: bytes, parameters: Parameters) -> dict[str, int]:
    """Return the positive frame counts that the file states, most specific first."""
    word = parameters.header_word
    counts: dict[str, int] = {}
    start = parameters.words("TRIAL", "ACTUAL_START_FIELD")
    end = parameters.words("TRIAL", "ACTUAL_END_FIELD")
    if len(start) == len(end) == 2:  # as two words, for more than 65535 frames
        counts["TRIAL:ACTUAL_END_FIELD"] = (
            (end[0] + (end[1] << 16)) - (start[0] + (start[1] << 16)) + 1
        )
    for name in ("LONG_FRAMES", "FRAMES"):  # a float where 65535 are too few
        counts[f"POINT:{name}"] = parameters.count("POINT", name, MAX_FRAMES)
    counts["header"] = word(data, 8) - word(data, 6) + 1
    most = max(counts.values())
    full = (MAX_COUNT - 1, MAX_COUNT, most % (MAX_COUNT + 1))  # what a word can say of more
    return {name: n for name, n in counts.items() if n > 0 and not (most > MAX_COUNT and n in full)}


def _held(data: bytes, layout: _Layout) -> tuple[int, int]:
    """Return the number of frames that fit in the data, and how many of them may be padding.

    Files are padded with zeros to a whole block; -1 if the data end elsewhere, such as in a
    truncated file.
    """
    parameters_at = (data[0] - 1) * BLOCK
    end = parameters_at if parameters_at > layout.start else len(data)
    room = max(0, end - layout.start)
    held, rest = divmod(room, layout.frame_bytes)
    zeros = room - len(data[layout.start : end].rstrip(b"\0"))
    padding = zeros if room % BLOCK == 0 else 0
    if rest > padding:
        return held, -1
    return held, min(held, min(padding, BLOCK - 1) // layout.frame_bytes)


def _points(data: bytes, parameters: Parameters, layout: _Layout) -> tuple[Floats, int]:
    """(F, points, 3) in the file's units and axes; NaN where a point was not seen.

    Programs also write a missing point as 0, 0, 0 with a good residual: such points are counted.
    """
    count = layout.frames * layout.frame_bytes // layout.word
    floats = layout.word == 4
    values = parameters.array(data, layout.start, count, floats=floats).reshape(layout.frames, -1)
    words = values[:, : 4 * layout.points].reshape(layout.frames, layout.points, 4)
    with np.errstate(invalid="ignore"):  # of signalling NaNs
        points = np.array(words[..., :3], dtype=np.float64)
    if not floats:
        points *= layout.scale
    with np.errstate(invalid="ignore"):
        points[~(words[..., 3] >= 0)] = np.nan
    zero = (points == 0).all(axis=-1)
    points[zero] = np.nan
    return points, int(np.count_nonzero(zero))


def _unit(path: Path, parameters: Parameters) -> float:
    name = (parameters.texts("POINT", "UNITS") or ["mm"])[0].lower()
    if name not in METRES_PER_UNIT:
        raise RecordingError(
            f"recording {path}: POINT:UNITS are {name[:20]!r}; expected one of "
            f"{', '.join(METRES_PER_UNIT)}; {converted_by(path, '--units mm')} (if it is in mm)"
        )
    return METRES_PER_UNIT[name]


def _axes(parameters: Parameters) -> Sequence[str]:
    up = (parameters.texts("POINT", "Y_SCREEN") or ["+Z"])[0].upper().removeprefix("+")
    return _AXES.get(up, _AXES["Z"])


def write_c3d(path: Path, recording: Recording) -> Written:
    """Write all people as points: 32-bit floats, millimetres, z up, residual -1 where not seen.

    Raises:
        ConfigError: there are too many points for the format, or the format cannot hold a joint's
            name.
    """
    frames = frames_of(recording)
    labels = joined_labels(frames.ids, frames.joints)
    number = frames.written.frames
    if len(labels) > MAX_POINTS:
        raise ConfigError(f"C3D holds {MAX_POINTS} points, not {len(labels)}; choose with --person")
    if any(not label.isascii() or len(label) > MAX_LABEL for label in labels):
        raise ConfigError(
            f"C3D: a joint's name is not ASCII, or longer than {MAX_LABEL}; rename it"
        )
    points: NDArray[np.float32] = np.zeros((number, len(labels), 4), dtype="<f4")
    xyz = frames.positions.reshape(number, len(labels), 3) * MM_PER_M
    points[..., :3] = np.nan_to_num(xyz)
    points[..., 3] = np.where(np.isnan(xyz).any(axis=-1), -1.0, 0.0)
    parameters = _parameters(labels, number, frames.rate_hz)
    header = struct.pack(
        "<BBHHHHHfHHf", 2, MAGIC, len(labels), 0, 1, min(number, MAX_COUNT), 0, -1.0,
        parameters.data_start, 0, frames.rate_hz,
    )  # fmt: skip
    path.write_bytes(header.ljust(BLOCK, b"\0") + parameters.packed + points.tobytes())
    return frames.written


@dataclass(frozen=True)
class _Packed:
    packed: bytes
    data_start: int


def _parameters(labels: Sequence[str], frames: int, rate_hz: float) -> _Packed:
    """The section of parameters, and the number of the block after the section."""
    point: dict[str, object] = {
        "USED": len(labels),
        "SCALE": -1.0,
        "RATE": rate_hz,
        "DATA_START": 0,
        "FRAMES": min(frames, MAX_COUNT),
        "UNITS": "mm",
        "X_SCREEN": "+X",
        "Y_SCREEN": "+Z",
    }
    for k in range(0, len(labels), PER_PARAMETER):
        name = "LABELS" if k == 0 else f"LABELS{k // PER_PARAMETER + 1}"
        point[name] = list(labels[k : k + PER_PARAMETER])
    groups: dict[str, dict[str, object]] = {
        "POINT": point,
        "ANALOG": {"USED": 0, "GEN_SCALE": 1.0, "RATE": rate_hz},
        "TRIAL": {
            "ACTUAL_START_FIELD": (1, 0),
            "ACTUAL_END_FIELD": (frames & 0xFFFF, frames >> 16),
        },
    }
    point["DATA_START"] = 2 + len(pack_parameters(groups)) // BLOCK
    if int(str(point["DATA_START"])) > 255 + 2:
        raise ConfigError(f"C3D: {len(labels)} names of points are too long; choose with --person")
    return _Packed(pack_parameters(groups), int(str(point["DATA_START"])))
