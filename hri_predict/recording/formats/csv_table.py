"""Tables of joints as CSV: one row for each person at each time.

::

    time_s,sees_room,person,waist_x,waist_y,waist_z,neck_x,...
    0.000000000,1,1,0.01,0.22,1.01,0.02,...
    0.033333333,1,,,,,,...             nobody is in the room
    0.066666667,0,,,,,,...             the source is blind

Metres, z up. The reader accepts commas, semicolons (then also decimal commas) or tabs; other names
for the time (``time``, ``t``, ``timestamp``, in seconds); tables without ``sees_room`` or
``person``; and coordinates named ``Waist.X``, ``waist:x`` or ``waist x``. An empty cell or ``nan``
means not observed.
"""

import csv
import io
import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np

from hri_predict.arrays import Floats
from hri_predict.errors import RecordingError
from hri_predict.joint_map import JointMap
from hri_predict.recording.bounded import check_joints, read_text
from hri_predict.recording.cutting import people_of, true_times
from hri_predict.recording.frames import Written
from hri_predict.recording.labels import MAX_ID
from hri_predict.recording.naming import map_of_names
from hri_predict.recording.recording import Recording, check_gaps, check_rate
from hri_predict.scene import Person, Scene
from hri_predict.settings import MAX_COORDINATE_M

TIMES = ("time_s", "time", "t", "timestamp", "timestamp_s", "seconds")
_MAX_HEAD = 100_000
_COORDINATE = re.compile(r"(.+?)[ _.:\-]([xyz])", re.IGNORECASE)


@dataclass(frozen=True)
class _Columns:
    """Columns of a row; ``None`` where the table has no such column."""

    time: int
    sees_room: int | None
    person: int | None
    joints: dict[str, list[int]]


def read_csv(
    path: Path, person: int, unit_m: float | None = None, axes: Sequence[str] | None = None
) -> Recording:
    """Read a table of joints.

    Args:
        path: the file.
        person: the id where the table has no column ``person``.
        unit_m: metres per unit; default 1.
        axes: the table's axes that are forward, left and up; default [x, y, z].

    Raises:
        RecordingError: it is no such table; one line names the row and column.
        ConfigError: impossible units or axes.
    """
    text = read_text(path, "CSV")
    delimiter = _delimiter(text.split("\n", 1)[0])
    rows = csv.reader(io.StringIO(text, newline=""), delimiter=delimiter)
    try:
        columns = _columns(path, next(rows, []))
        table = _Table(path, columns, person, decimal_comma=delimiter == ";")
        for number, row in enumerate(rows, start=2):
            if any(cell.strip() for cell in row):
                table.take(number, row)
    except csv.Error as error:
        raise RecordingError(f"recording {path}: not a CSV table ({error})") from error
    joint_map = map_of_names(list(columns.joints)).with_units(1.0 if unit_m is None else unit_m)
    return table.recording(joint_map if axes is None else joint_map.with_axes(axes))


def is_recording(path: Path) -> bool:
    """Whether a table in a folder is meant as a recording: its first row names joints.

    Raises:
        RecordingError: it names joints, but not as a recording does.
        OSError: it cannot be read.
    """
    with path.open("rb") as file:
        head = file.readline(_MAX_HEAD).decode("utf-8-sig", "replace")
    try:
        names = next(csv.reader([head], delimiter=_delimiter(head)), [])
    except csv.Error:
        return False
    matches = [_COORDINATE.fullmatch(name.strip()) for name in names]
    axes = [(match[1], match[2].lower()) for match in matches if match]
    if not any({(joint, axis) for axis in "xyz"} <= set(axes) for joint, _ in axes):
        return False
    _columns(path, names)
    return True


def _delimiter(head: str) -> str:
    return max(",;\t", key=head[:_MAX_HEAD].count)


def _columns(path: Path, header: Sequence[str]) -> _Columns:
    names = [name.strip() for name in header]
    lower = [name.lower() for name in names]
    found = [lower.index(name) for name in TIMES if name in lower]
    if not found:
        raise RecordingError(
            f"recording {path}: has no column 'time_s' (its first row begins with "
            f"{', '.join(names[:4])[:60]!r}); call the seconds that"
        )
    joints: dict[str, list[int]] = {}
    for k, name in enumerate(names):
        match = _COORDINATE.fullmatch(name)
        if match:
            places = joints.setdefault(match[1], [-1, -1, -1])
            axis = "xyz".index(match[2].lower())
            if places[axis] >= 0:
                raise RecordingError(f"recording {path}: column '{name}' occurs twice; rename one")
            places[axis] = k
    half = [joint for joint, places in joints.items() if -1 in places]
    if not joints or half:
        what = f"'{half[0]}' lacks one of _x, _y, _z" if half else "no joint's _x, _y and _z"
        raise RecordingError(f"recording {path}: {what} in its first row; name three per joint")
    return _Columns(
        time=found[0],
        sees_room=lower.index("sees_room") if "sees_room" in lower else None,
        person=lower.index("person") if "person" in lower else None,
        joints=joints,
    )


class _Table:
    """Rows that become scenes; rows with the same time form one scene."""

    def __init__(self, path: Path, columns: _Columns, person: int, *, decimal_comma: bool) -> None:
        self._path, self._columns, self._person = path, columns, person
        self._comma = decimal_comma
        self._places = np.array(list(columns.joints.values())).ravel().tolist()
        self._times_ns: list[int] = []
        self._sees: list[bool] = []
        self._people: list[dict[int, list[float]]] = []
        self._rows = 0

    def take(self, number: int, row: Sequence[str]) -> None:
        """Read a row; ``number`` is its line number, if no quoted text has line breaks."""
        self._rows += 1  # rows without people count, too: each time stamp takes memory
        if self._rows % 1000 == 0:
            check_joints(self._path, self._rows, 1, len(self._columns.joints))
        time_s = self._number(number, row, self._columns.time)
        if not abs(time_s) < 1e9:
            raise self._wrong(number, f"its time is {time_s}, not seconds")
        time_ns = round(time_s * 1e9)
        if not self._times_ns or time_ns != self._times_ns[-1]:
            if self._times_ns and time_ns < self._times_ns[-1]:
                raise self._wrong(number, "its time is before that of the row above; sort them")
            self._times_ns.append(time_ns)
            self._sees.append(True)
            self._people.append({})
        if self._columns.sees_room is not None:
            self._sees[-1] &= self._number(number, row, self._columns.sees_room) == 1
        values = [self._number(number, row, k) for k in self._places]
        person = self._id(number, row)
        if person is None:
            if not all(math.isnan(v) for v in values):
                raise self._wrong(number, "has joints, but no person")
            return
        if person in self._people[-1]:
            raise self._wrong(number, f"person {person} occurs twice at one time")
        self._people[-1][person] = values

    def recording(self, joint_map: JointMap) -> Recording:
        """The recording of these rows."""
        if len(self._times_ns) < 2:
            raise RecordingError(
                f"recording {self._path}: has {len(self._times_ns)} times; a rate needs two or more"
            )
        steps = np.array([b - a for a, b in pairwise(self._times_ns)])
        rate_hz = float(f"{1e9 / max(float(np.median(steps)), 1.0):.6g}")  # its times are rounded
        check_rate(self._path, "'time_s'", rate_hz)
        first = self._times_ns[0]
        stamps = [ns - first for ns in self._times_ns]
        check_gaps(self._path, stamps)
        limit = MAX_COORDINATE_M / joint_map.scale_to_m
        scenes = []
        for k, (ns, sees) in enumerate(zip(stamps, self._sees, strict=True)):
            people = tuple(
                _person(n, np.array(values).reshape(-1, 3), joint_map, limit)
                for n, values in self._people[k].items()
            )
            scenes.append(Scene(ns, k, sees, people))
        return Recording(
            path=self._path,
            kind="csv",
            joint_map=joint_map,
            rate_hz=rate_hz,
            scenes=scenes,
            arrival_ns=stamps,
        )

    def _id(self, number: int, row: Sequence[str]) -> int | None:
        if self._columns.person is None:
            return self._person
        value = self._number(number, row, self._columns.person)
        if math.isnan(value):
            return None
        if not (0 <= value <= MAX_ID and value == int(value)):
            raise self._wrong(number, f"person is {value:g}; expected 0 to {MAX_ID}")
        return int(value)

    def _number(self, number: int, row: Sequence[str], column: int) -> float:
        text = row[column].strip() if column < len(row) else ""
        if not text:
            return math.nan
        try:
            return float(text.replace(",", ".") if self._comma else text)
        except ValueError:
            raise self._wrong(
                number, f"column {column + 1} holds {text[:20]!r}, which is not a number"
            ) from None

    def _wrong(self, number: int, what: str) -> RecordingError:
        return RecordingError(f"recording {self._path}: row {number}: {what}")


def _person(number: int, raw: Floats, joint_map: JointMap, limit: float) -> Person:
    observed = np.asarray((np.abs(raw) <= limit).all(axis=-1))
    positions = joint_map.to_metres_z_up(np.where(observed[:, None], raw, np.nan))
    return Person(number, positions, observed)


def write_csv(path: Path, recording: Recording) -> Written:
    """Write every scene with its capture time since the first; positions to a micrometre."""
    written = Written(len(recording.scenes), people_of(recording))
    written.dropped["messages of controllers"] += len(recording.received)
    joints = recording.joint_map.source_joints
    head = [f"{joint}_{axis}" for joint in joints for axis in "xyz"]
    with path.open("w", encoding="utf-8", newline="") as file:
        rows = csv.writer(file, lineterminator="\n")
        rows.writerow(["time_s", "sees_room", "person", *head])
        for scene, ns in zip(recording.scenes, _since(recording), strict=True):
            time = [f"{ns / 1e9:.9f}", int(scene.sees_room)]
            for person in scene.people:
                rows.writerow([*time, person.id, *_cells(person)])
            if not scene.people:
                rows.writerow([*time, "", *([""] * len(head))])
    return written


def _since(recording: Recording) -> list[int]:
    """ns since the first scene; scenes received together are 1 ns apart.

    Rows with the same time form one scene.
    """
    times_ns = true_times(recording)
    since = [0]
    for ns in times_ns[1:]:
        since.append(max(ns - times_ns[0], since[-1] + 1))
    return since


def _cells(person: Person) -> list[str]:
    seen = person.observed & np.isfinite(person.positions).all(axis=-1)
    cells = []
    for joint, known in zip(person.positions.tolist(), seen.tolist(), strict=True):
        cells += [f"{v:.6f}" for v in joint] if known else ["", "", ""]
    return cells
