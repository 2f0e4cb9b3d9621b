"""TRC files (Track Row Column), as OpenSim and Motion Analysis write and read them.

Tab-separated text: five header lines (rate, units and numbers; names of the markers), then a row
for each frame. A row has the frame's number, its time, and x, y, z of each marker; cells are empty
if a marker was not seen. OpenSim documents the format as "Marker (.trc) Files". The format states
units but no axes; OpenSim's are x forward, y up, z to the right.
"""

import math
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from hri_predict.arrays import Floats
from hri_predict.errors import ConfigError, RecordingError
from hri_predict.joint_map import METRES_PER_UNIT, axes_rotation
from hri_predict.recording.bounded import check_joints, read_text
from hri_predict.recording.frames import Written, frames_of
from hri_predict.recording.labels import joined_labels, split_labels
from hri_predict.recording.naming import map_of_names
from hri_predict.recording.recording import Recording, check_rate, noted, recording_of

AXES = ("x", "-z", "y")  # forward, left, up
HEADER_LINES = 5
MM_PER_M = 1000.0


def read_trc(
    path: Path, person: int, unit_m: float | None = None, axes: Sequence[str] | None = None
) -> Recording:
    """Read a TRC file; ``Anna:LWrist`` is a marker of the person Anna.

    Args:
        path: the file.
        person: the id for people whose labels give no number.
        unit_m: metres per unit; the default comes from the file.
        axes: the file's axes that are forward, left and up; default ``AXES``.

    Raises:
        RecordingError: the file is not TRC, is truncated or empty, or a cell is not a number.
        ConfigError: impossible units or axes; labels that name nobody, or too many people.
    """
    lines = read_text(path, "TRC").splitlines()
    if not lines or not lines[0].startswith("PathFileType"):
        raise RecordingError(f"recording {path}: not a TRC file; it must begin with PathFileType")
    if len(lines) <= HEADER_LINES:
        raise RecordingError(f"recording {path}: truncated (no frames); export it again")
    header = dict(zip(_cells(lines[1]), _cells(lines[2]), strict=False))
    rate_hz = _value(path, header, "DataRate")
    check_rate(path, "'DataRate'", rate_hz)
    labels = [name for name in _cells(lines[3])[2:] if name]
    if len(labels) != _value(path, header, "NumMarkers"):
        raise RecordingError(
            f"recording {path}: 'NumMarkers' is {header['NumMarkers']}, but {len(labels)} are "
            f"named; export it again"
        )
    rows = [line for line in lines[HEADER_LINES:] if line.strip()]
    check_joints(path, len(rows), 1, len(labels))
    promised = _value(path, header, "NumFrames")
    if not rows or len(rows) < promised:
        raise RecordingError(
            f"recording {path}: truncated: {len(rows)} of {promised:g} frames are there; "
            f"export it again"
        )
    scale = METRES_PER_UNIT.get(header.get("Units", "").lower()) if unit_m is None else unit_m
    if scale is None:
        raise RecordingError(
            f"recording {path}: its 'Units' are {header.get('Units', '')[:20]!r}; expected one of "
            f"{', '.join(METRES_PER_UNIT)}; give them by --units"
        )
    markers = split_labels(labels, person)
    check_joints(path, len(rows), *markers.columns.shape)
    points = markers.people(_points(path, rows, len(labels)))
    joint_map = map_of_names(markers.joints).with_units(scale).with_axes(axes or AXES)
    recording = recording_of(
        path=path, kind="trc", joint_map=joint_map, raw=points, rate_hz=rate_hz, ids=markers.ids
    )
    return noted(recording, markers.note)


def _cells(line: str) -> list[str]:
    return [cell.strip() for cell in (line.split("\t") if "\t" in line else line.split())]


def _value(path: Path, header: Mapping[str, str], key: str) -> float:
    try:
        value = float(header[key])
    except KeyError:
        raise RecordingError(f"recording {path}: has no '{key}' in its third line") from None
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise RecordingError(f"recording {path}: '{key}' is {header[key][:20]!r}, no number")
    return value


def _points(path: Path, rows: Sequence[str], count: int) -> Floats:
    """(F, count, 3) in the file's units and axes; NaN where a cell is empty."""
    points = np.full((len(rows), count * 3), np.nan)
    for k, row in enumerate(rows):
        cells = _cells(row)[2:]
        if any(cells[count * 3 :]):
            raise RecordingError(f"recording {path}: frame {k + 1} has more than {count} markers")
        try:
            points[k, : len(cells)] = [float(c) if c else math.nan for c in cells[: count * 3]]
        except ValueError:
            raise RecordingError(
                f"recording {path}: frame {k + 1} holds what is no number; export it again"
            ) from None
    return points.reshape(len(rows), count, 3)


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
    for k, row in enumerate(points.reshape(number, -1).tolist()):
        cells = ["" if math.isnan(v) else f"{v:.4f}" for v in row]
        lines.append("\t".join([str(k + 1), f"{k / frames.rate_hz:.6f}", *cells]))
    path.write_text("\n".join(lines) + "\n", encoding="utf-8", newline="\n")
    return frames.written
