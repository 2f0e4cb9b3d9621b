"""TRC files (Track Row Column), as OpenSim and Motion Analysis write and read them.

Tab-separated text: five header lines (rate, units and numbers; names of the markers), then a row
for each frame. A row has the frame's number, its time, and x, y, z of each marker; cells are empty
if a marker was not seen. OpenSim documents the format as "Marker (.trc) Files". The format states
units but no axes; OpenSim's are x forward, y up, z to the right.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from hri_predict.base.arrays import Floats
from hri_predict.base.errors import ConfigError, RecordingError
from hri_predict.contracts.joint_map import METRES_PER_UNIT, axes_rotation
from hri_predict.recording.bounded import READING, WRITING, check_joints, read_text, watched
from hri_predict.recording.formats.cells import Numbers, wrong_length
from hri_predict.recording.frames import Written, frames_of
from hri_predict.recording.labels import joined_labels, split_labels
from hri_predict.recording.naming import map_of_names
from hri_predict.recording.recording import (
    Recording,
    check_gaps,
    check_rate,
    converted_by,
    noted,
    recording_of,
)
from hri_predict.recording.wanted import Wanted

AXES = ("x", "-z", "y")  # forward, left, up
HEADER_LINES = 5
MM_PER_M = 1000.0


def read_trc(path: Path, wanted: Wanted) -> Recording:
    """Read a TRC file; ``Anna:LWrist`` is a marker of the person Anna.

    ``wanted.person`` is the first id for people whose labels give no number. By default, units are
    the file's, and axes are ``AXES``.

    Raises:
        RecordingError: the file is not TRC, is truncated or empty, or a cell is not a number.
        ConfigError: impossible units or axes; labels that name no person, or too many people.
    """
    text = read_text(path, "TRC")
    lines = text.split("\n")
    while lines and not lines[0].strip():
        lines.pop(0)
    if not lines or not lines[0].startswith("PathFileType"):
        raise RecordingError(f"recording {path}: not a TRC file; it must begin with PathFileType")
    if len(lines) <= HEADER_LINES:
        raise RecordingError(f"recording {path}: truncated (no frames); export it again")
    header = dict(zip(_cells(lines[1]), _cells(lines[2]), strict=False))
    numbers = Numbers("\n".join(lines[HEADER_LINES:]))
    nominal_hz = _value(path, header, "DataRate", numbers)
    first = text.count("\n") - len(lines) + 2  # number of the first line
    labels = _labels(path, first + 3, lines[3], _value(path, header, "NumMarkers", numbers))
    rows = [(first + k, line) for k, line in enumerate(lines) if k >= HEADER_LINES and line.strip()]
    check_joints(path, len(rows), 1, len(labels))
    if not rows:
        raise RecordingError(f"recording {path}: truncated (no frames); export it again")
    promised = _value(path, header, "NumFrames", numbers)
    scale = METRES_PER_UNIT.get(header.get("Units", "").lower())
    if scale is None and wanted.unit_m is None:
        raise RecordingError(
            f"recording {path}: its 'Units' are {header.get('Units', '')[:20]!r}; expected one of "
            f"{', '.join(METRES_PER_UNIT)}; {converted_by(path, '--units mm')} (if it is in mm)"
        )
    markers = split_labels(labels, wanted.person)
    check_joints(path, len(rows), *markers.columns.shape)
    table = _table(path, rows, len(labels), numbers)
    points = markers.people(table[:, 2:].reshape(len(rows), len(labels), 3))
    joint_map = wanted.of_file(map_of_names(markers.joints), scale, AXES)
    times = frame_times(path, table[:, 0], table[:, 1], nominal_hz)
    recording = recording_of(
        path,
        "trc",
        joint_map,
        points,
        rate_hz=times.rate_hz,
        ids=markers.ids,
        stamps_ns=times.stamps_ns,
    )
    counted = f"'NumFrames' is {promised:g}, but there are {len(rows)} frames: all of them are read"
    recording = noted(noted(recording, markers.note), times.note)
    return noted(recording, counted if promised != len(rows) else "")


def _labels(path: Path, row: int, line: str, promised: float) -> list[str]:
    """Names of the markers, each above the first of its three columns.

    Raises:
        RecordingError: a name is above another column, a marker has none, or their number differs
            from the header.
    """
    names = _cells(line)[2:]
    while names and not names[-1]:
        names.pop()
    if all(names):  # nothing between them
        labels = names
    else:
        labels = names[::3]
        astray = next((name for k, name in enumerate(names) if name and k % 3), "")
        if astray:
            raise RecordingError(
                f"recording {path}: the name '{astray[:40]}' is not above the first of a marker's "
                f"three columns; export it again"
            )
    named = sum(map(bool, labels))
    if not named == len(labels) == promised:
        nameless = f": marker {labels.index('') + 1} has no name" if "" in labels else ""
        raise RecordingError(
            f"recording {path}: row {row}: 'NumMarkers' is {promised:g}, but {named} are "
            f"named{nameless}; export it again"
        )
    return labels


def _cells(line: str) -> list[str]:
    return [cell.strip() for cell in (line.split("\t") if "\t" in line else line.split())]


def _value(path: Path, header: Mapping[str, str], key: str, numbers: Numbers) -> float:
    try:
        value = numbers.read(header[key])
    except KeyError:
        raise RecordingError(f"recording {path}: no '{key}' in its third line") from None
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise RecordingError(f"recording {path}: '{key}' is {header[key][:20]!r}, not a number")
    return value


def _table(path: Path, rows: Sequence[tuple[int, str]], count: int, numbers: Numbers) -> Floats:
    """(F, 2 + 3 count) numbers of all rows; NaN for empty cells.

    Raises:
        RecordingError: a row has too few or too many cells, or a marker does not have three cells:
            joints would then be metres away.
    """
    table = np.full((len(rows), 2 + 3 * count), np.nan)
    for k, (line, row) in enumerate(watched(rows, READING, len(rows))):
        cells = _cells(row)
        if wrong := wrong_length(cells, 2 + 3 * count):
            raise RecordingError(
                f"recording {path}: row {line}: {wrong}; leave the cells of a missing marker "
                f"empty, or export it again"
            )
        for column in range(2 + 3 * count):
            try:
                table[k, column] = numbers.read(cells[column])
            except ValueError as error:
                raise RecordingError(
                    f"recording {path}: row {line}: column {column + 1} holds "
                    f"{cells[column][:20]!r}, which {error}; export it again"
                ) from None
    known = np.isfinite(table[:, 2:]).reshape(len(rows), count, 3).sum(axis=2)
    half = np.argwhere((known > 0) & (known < 3))
    if len(half):
        k, marker = half[0]
        raise RecordingError(
            f"recording {path}: row {rows[k][0]}: marker {marker + 1} has {known[k, marker]} of 3 "
            f"coordinates; correct the row, or export it again"
        )
    return table


def write_trc(path: Path, recording: Recording) -> Written:
    """Write all people, millimetres with y up, to 0.1 micrometres.

    Raises:
        ConfigError: a joint's name contains a tab or a line break.
    """
    frames = frames_of(recording)
    labels = joined_labels(frames.ids, frames.joints)
    if any(not label.isprintable() or not label.strip() for label in labels):
        raise ConfigError("TRC: a joint's name is empty or not printable; rename it")
    count = len(labels)
    points = frames.positions.reshape(frames.written.frames, count, 3)
    points = points @ axes_rotation(AXES) * MM_PER_M  # from forward, left, up: transposed twice
    rate, number = f"{frames.rate_hz:.10g}", frames.written.frames
    keys = "DataRate CameraRate NumFrames NumMarkers Units OrigDataRate OrigDataStartFrame "
    values = [rate, rate, number, count, "mm", rate, 1, number]
    lines = [
        f"PathFileType\t4\t(X/Y/Z)\t{path.name.removesuffix('.partial')}",
        "\t".join([*keys.split(), "OrigNumFrames"]),
        "\t".join(map(str, values)),
        "\t".join(["Frame#", "Time", *(cell for name in labels for cell in (name, "", ""))]),
        "\t".join(["", "", *(f"{axis}{k}" for k in range(1, count + 1) for axis in "XYZ")]),
        "",
    ]
    for k, row in enumerate(watched(points.reshape(number, -1).tolist(), WRITING, number)):
        cells = ["" if math.isnan(v) else f"{v:.4f}" for v in row]
        lines.append("\t".join([str(k + 1), f"{k / frames.rate_hz:.6f}", *cells]))
    path.write_text("\n".join(lines) + "\n", encoding="utf-8", newline="\n")
    return frames.written


_ROUNDED = 0.1
"""Part of a period by which a rounded time may be off where the nominal rate explains it."""
_COARSE_S = 0.0055
"""Rounding error of a time with two decimals."""
_SAME = 0.01
"""Rates that differ by less are considered equal."""
_FAR_S = 1e9
"""Times are clipped to this value, which ``check_gaps`` rejects and which fits nanoseconds."""


@dataclass(frozen=True)
class FrameTimes:
    """Times of frames.

    Attributes:
        rate_hz: frames per second, where none is missing.
        stamps_ns: nanoseconds since the first frame.
        note: note for the user; "" if none.
    """

    rate_hz: float
    stamps_ns: list[int]
    note: str


def frame_times(path: Path, numbers: Floats, times_s: Floats, nominal_hz: float) -> FrameTimes:
    """Find the times of frames.

    Times in a file are rounded, and its rate may be stale. The nominal rate is used if it explains
    all times; otherwise the times are used. A jump in both numbers and times is a gap.

    Args:
        path: the file, for errors.
        numbers: (F,) the frames' own numbers; NaN for a frame without a number.
        times_s: (F,) the frames' own times; NaN for a frame without a time.
        nominal_hz: the rate that the file states.

    Raises:
        RecordingError: there are neither times nor a rate, or times go back.
    """
    steps = np.diff(numbers)
    counts = numbers - numbers[0]
    counted = bool(np.isfinite(counts).all() and (steps >= 1).all() and (counts % 1 == 0).all())
    if not counted:
        counts = np.arange(len(numbers), dtype=np.float64)
    notes = [] if counted else ["'Frame#' does not count upwards and is not used"]
    known = np.isfinite(times_s)
    if not known.all() or (len(times_s) > 1 and not np.ptp(times_s)):
        check_rate(path, "'DataRate'", nominal_hz)
        notes.append("rows without a 'Time': 'DataRate' is used")
        return _made(path, counts / nominal_hz, nominal_hz, notes)
    since_s = times_s - times_s[0]
    if len(times_s) == 1 or _explains(nominal_hz, counts, since_s):
        check_rate(path, "'DataRate'", nominal_hz)
        return _made(path, counts / nominal_hz, nominal_hz, notes)
    back = np.flatnonzero(np.diff(since_s) <= 0)
    if len(back):
        raise RecordingError(
            f"recording {path}: frame {back[0] + 2}: its 'Time' is not after that of the frame "
            f"before it; correct the times"
        )
    period_s = float(np.median(np.diff(since_s)))
    periods = np.maximum(1.0, np.round(np.diff(since_s) / period_s))
    rate_hz = float(f"{periods.sum() / since_s[-1]:.6g}")  # its times are rounded
    check_rate(path, "'Time'", rate_hz)
    if abs(nominal_hz / rate_hz - 1) > _SAME:
        notes.append(
            f"'DataRate' is {nominal_hz:g}, but by 'Time' it is {rate_hz:g} per second: 'Time' is "
            f"used"
        )
    elif counted and not np.array_equal(periods, steps):
        notes.append("'Frame#' and 'Time' differ: 'Time' is used")
    return _made(path, since_s, rate_hz, notes)


def _explains(nominal_hz: float, counts: Floats, since_s: Floats) -> bool:
    """Whether all times match evenly spaced frames, except for rounding."""
    if not nominal_hz > 0:
        return False
    off_s = np.abs(since_s - counts / nominal_hz)
    return bool((off_s <= max(_COARSE_S, _ROUNDED / nominal_hz)).all())


def _made(path: Path, since_s: Floats, rate_hz: float, notes: list[str]) -> FrameTimes:
    stamps = [round(min(s, _FAR_S) * 1e9) for s in since_s.tolist()]
    check_gaps(path, stamps)
    return FrameTimes(rate_hz, stamps, "; ".join([*notes, *gaps(stamps, rate_hz)]))


def gaps(stamps_ns: list[int], rate_hz: float) -> list[str]:
    """Return a note on missing frames, if any gap reaches two periods."""
    steps_s = np.diff(np.asarray(stamps_ns, np.float64)) * 1e-9
    missing = np.round(steps_s * rate_hz) - 1
    if not (missing > 0).any():
        return []
    worst = int(np.argmax(steps_s))
    return [
        f"{missing[missing > 0].sum():.0f} frames are missing; the longest gap is "
        f"{steps_s[worst]:.2f} s, after {stamps_ns[worst] * 1e-9:.2f} s"
    ]
