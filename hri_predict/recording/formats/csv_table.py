"""Tables of joints as CSV: one row for each person at each time.

::

    time_s,sees_room,person,waist_x,waist_y,waist_z,neck_x,...
    0.000000000,1,1,0.01,0.22,1.01,0.02,...
    0.033333333,1,,,,,,...             no person is in the room
    0.066666667,0,,,,,,...             the source is blind

Metres, z up. The reader accepts other delimiters and decimal commas; other names for the time, also
in ms, us or ns, and Unix time; frame numbers instead of times if ``wanted.rate_hz`` gives the frame
rate; tables without ``sees_room`` or ``person``, or with ``body_id`` or similar instead of
``person``; coordinates named ``Waist.X``, ``waist:x`` or ``waist x``; and a joint's
``waist_confidence``. An empty cell or ``nan`` means not observed. See ``csv_columns``.
"""

import csv
import math
from collections import Counter
from collections.abc import Sequence
from datetime import UTC, datetime
from itertools import pairwise
from pathlib import Path

import numpy as np

from hri_predict.base.arrays import Floats
from hri_predict.base.errors import RecordingError
from hri_predict.base.settings import MAX_COORDINATE_M
from hri_predict.contracts.joint_map import JointMap
from hri_predict.contracts.scene import Person, Scene
from hri_predict.recording.bounded import (
    READING,
    WRITING,
    check_joints,
    decoded,
    read_text,
    watched,
)
from hri_predict.recording.cutting import people_of, true_times
from hri_predict.recording.formats.cells import Numbers, RowLengths
from hri_predict.recording.formats.csv_columns import (
    OWN,
    SECONDS,
    Columns,
    columns_of,
    is_own_header,
    names_joints,
    rows_of,
)
from hri_predict.recording.frames import Written
from hri_predict.recording.labels import MAX_ID, numbered
from hri_predict.recording.naming import map_of_names
from hri_predict.recording.recording import Recording, check_gaps, check_rate
from hri_predict.recording.wanted import Wanted

MIN_CONFIDENCE = 0.3
"""Confidence below which a joint is unobserved, as by default in live sources."""
MOST_PEOPLE = 20
"""A column that names more people than this, and more than half as many as there are rows,
identifies something else."""
SLOW_HZ = 2.0
"""Rate up to which times without a stated unit may as well be milliseconds of a fast source."""
_MAX_HEAD = 100_000
_FLAGS = {"true": 1.0, "yes": 1.0, "tracked": 1.0, "inferred": 1.0}
_FLAGS |= {"false": 0.0, "no": 0.0, "nottracked": 0.0, "not tracked": 0.0}
# Unix time in s, ms, us or ns: values from the year 1973 to 5138 begin at these.
_UNIX = ((1e17, "ns"), (1e14, "us"), (1e11, "ms"), (-math.inf, "s"))


def read_csv(path: Path, wanted: Wanted) -> Recording:
    """Read a table of joints; in metres, x forward and z up if nothing else is wanted.

    ``wanted.person`` is the id where the table has no column for it, and the first id for people
    with names.

    Raises:
        RecordingError: the file is not a table of joints; one line names the row and column.
        ConfigError: impossible units or axes.
    """
    text = read_text(path, "CSV")
    _, rows = rows_of(text)
    try:
        header_line, header = next(rows, (1, []))
        columns = columns_of(path, header, wanted.rate_hz)
        body = text.split("\n", header_line)[-1]
        table = _Table(path, columns, wanted.person, Numbers(body))
        for number, row in watched(rows, READING, body.count("\n")):
            table.take(number, row)
    except csv.Error as error:
        raise RecordingError(f"recording {path}: not a CSV table ({error})") from error
    return table.recording(wanted.of_file(map_of_names(list(columns.joints)), 1.0))


def is_recording(path: Path) -> bool:
    """Whether a table in a folder is intended as a recording: its first row names joints.

    Raises:
        RecordingError: the table names joints, but not as a recording does.
        OSError: it cannot be read.
    """
    names = _first_row(path)
    if not names_joints(names):
        return False
    columns_of(path, names)
    return True


def is_own_table(path: Path) -> bool:
    """Whether a table has the columns that ``write_csv`` writes, so it is in metres, z up.

    Raises:
        OSError: it cannot be read.
    """
    return is_own_header(_first_row(path))


def _first_row(path: Path) -> list[str]:
    """The names of the columns; empty if the file is not a table."""
    with path.open("rb") as file:
        head = decoded(file.read(_MAX_HEAD)).replace("\r\n", "\n").replace("\r", "\n")
    try:
        _, names = next(rows_of(head)[1], (1, []))
    except csv.Error:
        return []
    return names


class _Table:
    """Rows that become scenes; rows with the same time form one scene."""

    def __init__(self, path: Path, columns: Columns, person: int, numbers: Numbers) -> None:
        self._path, self._columns, self._person = path, columns, person
        self._numbers, self._lengths = numbers, RowLengths(columns.count)
        self._places = [k for own in columns.joints.values() for k in own]
        self._sure = [(k, own) for k, own in enumerate(columns.sure.values()) if own]
        self._second_s = columns.second_s
        self._guessed = False  # that plain numbers are seconds
        self._times_ns: list[int] = []
        self._sees: list[bool] = []
        self._people: list[dict[str, list[float]]] = []
        self._rows = 0
        self._stated = ""  # a time that contradicts the rate that was given
        self._counted: Counter[str] = Counter()

    def take(self, number: int, row: Sequence[str]) -> None:
        """Read a row; ``number`` is its line number."""
        self._rows += 1  # rows without people count, too: each time stamp takes memory
        if self._rows % 1000 == 0:
            check_joints(self._path, self._rows, 1, len(self._columns.joints))
        if [cell.strip() for cell in row[: self._columns.count]] == self._columns.names:
            self._counted["repeated header rows are skipped"] += 1
            return
        if wrong := self._lengths.wrong(row):
            raise self._wrong(number, f"{wrong}; correct it, or export the table again")
        self._look_for_times(row)
        time = self._columns.time
        time_ns = self._time_ns(number, str(self._rows) if time is None else row[time])
        if not self._times_ns or time_ns != self._times_ns[-1]:
            if self._times_ns and time_ns < self._times_ns[-1]:
                raise self._wrong(number, "its time is before that of the row above; sort the rows")
            self._times_ns.append(time_ns)
            self._sees.append(True)
            self._people.append({})
        if self._columns.sees_room is not None:
            self._sees[-1] &= self._flag(number, row, self._columns.sees_room) == 1
        values = [self._number(number, row, k) for k in self._places]
        self._hide_unsure(number, row, values)
        person = self._name(row)
        if person is None:
            if not all(math.isnan(v) for v in values):
                raise self._wrong(number, "has joints, but no person")
            return
        if person in self._people[-1]:
            raise self._wrong(
                number,
                f"person {person} occurs twice at one time; correct the times, or name "
                f"different people in a column 'person'",
            )
        self._people[-1][person] = values

    def recording(self, joint_map: JointMap) -> Recording:
        """The recording of these rows."""
        if self._stated:
            raise RecordingError(
                f"recording {self._path}: has times of its own ({self._stated}); leave --fps out, "
                f"or remove that column if its times are wrong"
            )
        if len(self._times_ns) < 2:
            raise RecordingError(
                f"recording {self._path}: has {len(self._times_ns)} times; a rate needs two or more"
            )
        rate_hz = self._rate_hz()
        first = self._times_ns[0]
        stamps = [ns - first for ns in self._times_ns]
        check_gaps(self._path, stamps)
        limit = MAX_COORDINATE_M / joint_map.scale_to_m
        ids = self._ids()
        scenes = []
        for k, (ns, sees) in enumerate(zip(stamps, self._sees, strict=True)):
            people = tuple(
                _person(ids[name], np.array(values).reshape(-1, 3), joint_map, limit)
                for name, values in self._people[k].items()
            )
            scenes.append(Scene(ns, k, sees, people))
        return Recording(
            path=self._path,
            kind="csv",
            joint_map=joint_map,
            rate_hz=rate_hz,
            scenes=scenes,
            arrival_ns=stamps,
            note="; ".join(self._notes(ids)),
        )

    def _ids(self) -> dict[str, int]:
        names = list(dict.fromkeys(name for people in self._people for name in people))
        if self._columns.time is None and len(names) > 1:
            raise RecordingError(
                f"recording {self._path}: has several people, but neither times nor a column "
                f"'frame'; add one"
            )
        if len(names) > max(MOST_PEOPLE, self._rows // 2):
            assert self._columns.person is not None  # or else there is one
            raise RecordingError(
                f"recording {self._path}: column '{self._columns.names[self._columns.person]}' "
                f"names {len(names)} people in {self._rows} rows; rename the column if it does not "
                f"identify the person of a row"
            )
        if len(names) > MAX_ID:
            raise RecordingError(
                f"recording {self._path}: names {len(names)} people; cut it into parts"
            )
        return numbered(names, self._person)

    def _rate_hz(self) -> float:
        """Scenes per second, by the usual step of the times."""
        steps = np.array([b - a for a, b in pairwise(self._times_ns)])
        rate_hz = float(f"{1e9 / max(float(np.median(steps)), 1.0):.6g}")  # its times are rounded
        name = "--fps" if self._columns.time is None else self._columns.names[self._columns.time]
        try:
            check_rate(self._path, f"'{name}'", rate_hz)
        except RecordingError as error:
            would = [
                u for u, s in SECONDS.items() if 5 <= rate_hz * (self._second_s or 1) / s <= 500
            ]
            hint = f"; if the time is in {would[0]}, name it 'time_{would[0]}'" if would else ""
            raise RecordingError(f"{error}{hint}") from None
        if self._guessed and rate_hz <= SLOW_HZ:
            raise RecordingError(
                f"recording {self._path}: '{name}' does not state its unit, and in seconds gives "
                f"only {rate_hz:g} frames per second; if the time is in ms, name it 'time_ms', if "
                f"it is in s, 'time_s'"
            )
        return rate_hz

    def _notes(self, ids: dict[str, int]) -> list[str]:
        notes = [f"{count} {what}" for what, count in self._counted.items()]
        notes += [f"'{name}' is person {n}" for name, n in ids.items() if name != str(n)]
        return [*notes, *([self._columns.note] if self._columns.note else [])]

    def _time_ns(self, number: int, cell: str) -> int:
        is_number = True
        try:
            time = self._numbers.read(cell)
        except ValueError:
            time, is_number = _clock_s(cell), False
        if self._second_s is None and math.isfinite(time):
            unit = next(unit for least, unit in _UNIX if abs(time) >= least)
            self._second_s = SECONDS[unit]
            self._guessed = unit == "s" and is_number
        time_s = time * (self._second_s or 1.0)
        if not abs(time_s) < 1e11:
            raise self._wrong(number, f"its time is {cell.strip()[:30]!r}, not a number of seconds")
        return round(time_s * 1e9)

    def _look_for_times(self, row: Sequence[str]) -> None:
        """Record the first time in a table that was to get its times from a rate."""
        for column in self._columns.not_times:
            if self._stated or not (cell := row[column].strip()):
                continue
            try:
                time = self._numbers.read(cell)
            except ValueError:
                time = _clock_s(cell)
            if math.isfinite(time):
                self._stated = f"'{self._columns.names[column]}' is {cell[:30]!r}"

    def _hide_unsure(self, number: int, row: Sequence[str], values: list[float]) -> None:
        """Mark joints with a low confidence as unobserved."""
        for k, columns in self._sure:
            if any(not self._flag(number, row, c) >= MIN_CONFIDENCE for c in columns):
                if not math.isnan(values[3 * k]):
                    what = f"joints with a confidence below {MIN_CONFIDENCE:g} are not observed"
                    self._counted[what] += 1
                values[3 * k : 3 * k + 3] = [math.nan] * 3

    def _name(self, row: Sequence[str]) -> str | None:
        """The person of a row as text; ``None`` where there is none."""
        if self._columns.person is None:
            return str(self._person)
        text = row[self._columns.person].strip()
        try:
            value = self._numbers.read(text)
        except ValueError:
            return text
        if math.isnan(value) or value < 0:
            return None
        return str(int(value)) if value <= MAX_ID and value == int(value) else text

    def _flag(self, number: int, row: Sequence[str], column: int) -> float:
        flag = _FLAGS.get(row[column].strip().lower())
        return self._number(number, row, column) if flag is None else flag

    def _number(self, number: int, row: Sequence[str], column: int) -> float:
        try:
            return self._numbers.read(row[column])
        except ValueError as error:
            cell, name = row[column].strip()[:20], self._columns.names[column]
            raise self._wrong(
                number, f"column {column + 1} ('{name}') holds {cell!r}, which {error}"
            ) from None

    def _wrong(self, number: int, what: str) -> RecordingError:
        return RecordingError(f"recording {self._path}: row {number}: {what}")


def _clock_s(cell: str) -> float:
    """Return a date with time, or a time of day, in seconds; NaN if the cell holds neither."""
    for text in (cell.strip(), f"1970-01-01T{cell.strip()}"):
        try:
            moment = datetime.fromisoformat(text)
        except ValueError:
            continue
        return (moment if moment.tzinfo else moment.replace(tzinfo=UTC)).timestamp()
    return math.nan


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
        rows.writerow([*OWN, *head])
        scenes = watched(recording.scenes, WRITING, len(recording.scenes))
        for scene, ns in zip(scenes, _since(recording), strict=True):
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
