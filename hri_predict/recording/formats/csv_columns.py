"""Meaning of the columns of a table of joints, by their names."""

import csv
import io
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from hri_predict.base.errors import RecordingError
from hri_predict.recording.recording import converted_by

OWN = ("time_s", "sees_room", "person")
"""The first columns of the tables that this project writes."""
TIMES = (
    "time_s", "time", "t", "timestamp", "timestamp_s", "seconds", "ts", "stamp", "unix_time",
    "capturetime", "capture_time",
)  # fmt: skip
"""Names of a time, the preferred first; without a unit, seconds or Unix time in any unit."""
SECONDS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
_TIME = re.compile(
    r"(?:(?:\w+[ _])?(?:time|timestamp|stamp|epoch|elapsed|t)[ _]*[_ \[(]|)"
    r"(s|ms|us|\u00b5s|ns|sec|secs|seconds|milliseconds|microseconds|nanoseconds)[\])]?"
)
_LONG = {"sec": "s", "secs": "s", "\u00b5s": "us", "milliseconds": "ms", "microseconds": "us"}
_LONG |= {"seconds": "s", "nanoseconds": "ns"}
FRAMES = ("frame", "framenumber", "frameid", "frameindex", "frameidx", "frameno", "framenum")
"""Names of a frame's number, without case and separators."""
PEOPLE = (
    "person", "personid", "bodyid", "body", "trackid", "trackingid", "subject", "subjectid",
    "skeletonid", "skeleton", "playerid", "player", "userid", "actor", "id",
)  # fmt: skip
"""Names of a column that identifies the person of a row, without case and separators."""
_SURE = (
    "confidence|conf|visibility|vis|score|likelihood|presence|probability|prob|quality|"
    "tracked|tracking_?state|state|valid|observed|seen|c|p|v|w"
)
_COORDINATE = re.compile(r"(.+?)[ _.:\-]([xyz])", re.IGNORECASE)
_OF_JOINT = re.compile(rf"(.+?)[ _.:\-]({_SURE})", re.IGNORECASE)
_PIXELS = re.compile(r".+[ _.:\-](2d|color|colour|depth|image|img|pixel|screen|uv)", re.IGNORECASE)
"""A joint's image coordinates, which Kinect recorders write in addition to its position in
space."""
_MAX_HEAD = 100_000
_SHOWN = 8


@dataclass(frozen=True, kw_only=True)
class Columns:
    """Columns of a row; ``None`` where the table has no such column.

    Attributes:
        count: number of named columns.
        names: names of all columns.
        time: column of the time, or of the frame's number; ``None``: a row is a frame.
        second_s: seconds per unit of the time; ``None``: seconds, or Unix time in any unit.
        not_times: columns of times where a rate was given instead; they must be empty.
        sees_room: column of a flag.
        person: column that identifies the person.
        joints: columns of x, y and z.
        sure: for each joint, its confidence columns.
        unused: names of the columns that are not used.
    """

    count: int
    names: list[str]
    time: int | None
    second_s: float | None
    not_times: list[int]
    sees_room: int | None
    person: int | None
    joints: dict[str, list[int]]
    sure: dict[str, list[int]]
    unused: list[str]

    @property
    def note(self) -> str:
        """Return a note on the unused columns; "" if all are used."""
        shown = ", ".join(f"'{name}'" for name in self.unused[:_SHOWN])
        more = len(self.unused) - _SHOWN
        return f"columns not used: {shown}{f', and {more} more' if more > 0 else ''}" * bool(shown)


def rows_of(text: str) -> tuple[str, Iterator[tuple[int, list[str]]]]:
    """The delimiter of a table, and its rows with the numbers of their lines, the header first.

    Comment lines (#), empty lines, and the ``sep=;`` line that spreadsheets write are skipped.
    """
    start, stated = 0, ""
    for line in io.StringIO(text):
        if match := re.fullmatch(r'"?sep=(.)"?', line.strip(), re.IGNORECASE):
            stated = match[1]
        elif line.strip() and not line.lstrip().startswith("#"):
            break
        start += len(line)
    head = text[start : start + _MAX_HEAD].split("\n", 1)[0]
    delimiter = stated or max(",;\t|", key=head.count)
    if delimiter not in head and " " in head.strip():
        delimiter = " "
    before = text.count("\n", 0, start)
    body = text[start:] if delimiter != " " else re.sub(r"(?m)^[ \t]+|[ \t]+$", "", text[start:])
    rows = csv.reader(
        io.StringIO(body, newline=""), delimiter=delimiter, skipinitialspace=delimiter != "\t"
    )
    return delimiter, _numbered(rows, before)


def _numbered(rows: Iterator[list[str]], before: int) -> Iterator[tuple[int, list[str]]]:
    line = 0
    for row in rows:
        number = before + line + 1
        line = rows.line_num  # type: ignore[attr-defined]  # of csv's reader
        if any(cell.strip() for cell in row) and not row[0].lstrip().startswith("#"):
            yield number, row


def names_joints(header: Sequence[str]) -> bool:
    """Whether at least one joint has an x, y and z in this header."""
    matches = [_COORDINATE.fullmatch(name.strip()) for name in header]
    axes = {(match[1], match[2].lower()) for match in matches if match}
    return any({(joint, axis) for axis in "xyz"} <= axes for joint, _ in axes)


def columns_of(path: Path, header: Sequence[str], rate_hz: float | None = None) -> Columns:
    """Find the columns by their names.

    Args:
        path: the file.
        header: its first row.
        rate_hz: frames per second, if the table has no times.

    Raises:
        RecordingError: the table has no time, or no complete joint.
    """
    names = [name.strip() for name in header]
    while names and not names[-1]:
        names.pop()
    time, second_s = _time(path, names) if rate_hz is None else _frame(names, rate_hz)
    joints = _joints(path, names)
    lower = [name.lower() for name in names]
    plain = [re.sub("[^a-z0-9]", "", name) for name in lower]
    person = next((plain.index(name) for name in PEOPLE if name in plain), None)
    sees_room = lower.index("sees_room") if "sees_room" in lower else None
    sure = _sure(names, joints)
    used = {time, person, sees_room, *(k for own in joints.values() for k in own)}
    used |= {k for own in sure.values() for k in own}
    return Columns(
        count=len(names),
        names=names,
        time=time,
        second_s=second_s,
        not_times=[] if rate_hz is None else _times(names),
        sees_room=sees_room,
        person=person,
        joints=joints,
        sure=sure,
        unused=[name for k, name in enumerate(names) if name and k not in used],
    )


def is_own_header(names: Sequence[str]) -> bool:
    """Whether these are the columns that this project writes: in metres, z up."""
    return [name.strip() for name in names[: len(OWN)]] == list(OWN)


def _times(names: Sequence[str]) -> list[int]:
    """Columns of times, the preferred first."""
    lower = [name.lower() for name in names]
    found = [lower.index(name) for name in TIMES if name in lower]
    return list(dict.fromkeys([*found, *(k for k, n in enumerate(lower) if _TIME.fullmatch(n))]))


def _time(path: Path, names: Sequence[str]) -> tuple[int, float | None]:
    found = _times(names)
    if not found:
        raise RecordingError(
            f"recording {path}: no column 'time_s' (its first row begins with "
            f"{', '.join(names[:4])[:60]!r}); rename the column of times in seconds to 'time_s', "
            f"or give the frame rate: {converted_by(path, '--fps 30')} (for 30 frames per second)"
        )
    unit = _TIME.fullmatch(names[found[0]].lower())
    return found[0], None if unit is None else SECONDS[_LONG.get(unit[1], unit[1])]


def _frame(names: Sequence[str], rate_hz: float) -> tuple[int | None, float]:
    """Return the column of the frame number, and the duration of a frame in seconds."""
    bare = [re.sub("[^a-z]", "", name.lower()) for name in names]
    return next((bare.index(name) for name in FRAMES if name in bare), None), 1.0 / rate_hz


def _joints(path: Path, names: Sequence[str]) -> dict[str, list[int]]:
    joints: dict[str, list[int]] = {}
    for k, name in enumerate(names):
        match = _COORDINATE.fullmatch(name)
        if match:
            places = joints.setdefault(match[1], [-1, -1, -1])
            axis = "xyz".index(match[2].lower())
            if places[axis] >= 0:
                raise RecordingError(f"recording {path}: column '{name}' occurs twice; rename one")
            places[axis] = k
    flat = [joint for joint, (*_, z) in joints.items() if z < 0]
    if flat and len(flat) == len(joints):
        raise RecordingError(
            f"recording {path}: its joints have no z ('{flat[0]}'): image coordinates do not give "
            f"a position in the room; record 3-D positions in metres"
        )
    for joint in filter(_PIXELS.fullmatch, flat):
        del joints[joint]
    half = [joint for joint, places in joints.items() if -1 in places]
    if not joints or half:
        if {"x", "y", "z"} <= {name.lower() for name in names}:
            raise RecordingError(
                f"recording {path}: has a row for each joint; give a table with a row for each "
                f"frame (of FreeMoCap *_by_trajectory.csv, or output_data/*_body_3d_xyz.csv)"
            )
        what = f"'{half[0]}' lacks one of _x, _y, _z" if half else "no joint's _x, _y and _z"
        raise RecordingError(f"recording {path}: {what} in its first row; name three per joint")
    return joints


def _sure(names: Sequence[str], joints: dict[str, list[int]]) -> dict[str, list[int]]:
    by_name = {joint.lower(): joint for joint in joints}
    found: dict[str, list[int]] = {joint: [] for joint in joints}
    for k, name in enumerate(names):
        match = _OF_JOINT.fullmatch(name)
        if match and match[1].lower() in by_name:
            found[by_name[match[1].lower()]].append(k)
    return found
