"""Tables as other programs write them: times, people, confidences, cells and lines."""

import pytest

from hri_predict.base.errors import RecordingError
from hri_predict.recording import open_recording

HEAD = "time_s,waist_x,waist_y,waist_z,head_x,head_y,head_z"
ROWS = [[f"{k / 10:.1f}", "1.5", f"{k}.25", "0.5", "1.5", f"{k}.25", "1.2"] for k in range(6)]
WAIST = [[1.5, k + 0.25, 0.5] for k in range(6)]


@pytest.fixture
def path(tmp_path):
    return tmp_path / "a.csv"


def table(rows=ROWS, head=HEAD, separator=",", end="\n"):
    lines = [separator.join(head.split(",")), *(separator.join(row) for row in rows)]
    return end.join(lines) + end


def waists(path):
    recording = open_recording(path)
    assert recording.rate_hz == pytest.approx(10.0, rel=1e-4)  # times are rounded to 1 us
    return [scene.people[0].positions[0].tolist() for scene in recording.scenes]


def error(path):
    with pytest.raises(RecordingError) as caught:
        open_recording(path)
    assert "\n" not in str(caught.value)
    return str(caught.value)


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "latin-1", "utf-16", "utf-16-le"])
@pytest.mark.parametrize("end", ["\n", "\r\n", "\r"])
@pytest.mark.parametrize("separator", [",", ";", "\t", "|", " "])
def test_encodings_line_ends_and_separators(path, encoding, end, separator):
    text = table([[*row, "1"] for row in ROWS], f"{HEAD},gr\u00f6\u00dfe", separator, end)
    path.write_bytes(text.encode(encoding))
    assert waists(path) == WAIST
    assert open_recording(path).note == "columns not used: 'gr\u00f6\u00dfe'"


@pytest.mark.parametrize(
    "change",
    [
        lambda t: f"# by a tracker, version 1.5\n\n{t}",
        lambda t: f"sep=,\n{t}",
        lambda t: t.replace("0.2,1.5", "# a remark\n0.2,1.5"),
        lambda t: t.replace("\n", ",\n"),  # a separator at the end of each row
        lambda t: t.replace("\n", ",\n").replace("head_z,", "head_z"),
        lambda t: t.replace("\n", ",,,\n"),
        lambda t: t.replace("1.5", '"1.5"').replace("waist_x", '"waist_x"'),
        lambda t: t.replace(",", ", "),
        lambda t: t.replace("0.3,", f"{HEAD}\n0.3,"),
        lambda t: f"{t}\n\n",
        lambda t: t.replace("\n", ",7\n").replace("head_z,7", "head_z,frame"),
    ],
)
def test_what_programs_add_changes_nothing(path, change):
    path.write_text(change(table()))
    assert waists(path) == WAIST


@pytest.mark.parametrize("separator", [";", "\t", "|"])
def test_decimal_commas(path, separator):
    path.write_text(table(separator=separator).replace(".", ","))
    assert waists(path) == WAIST
    path.write_text(table(separator=separator).replace("1.5", "1,5", 1))
    assert "row 2: column 2 ('waist_x') holds '1,5', which has a comma" in error(path)


def test_decimal_commas_in_quotes(path):
    quoted = [[f'"{cell.replace(".", ",")}"' for cell in row] for row in ROWS]
    path.write_text(table(quoted))
    assert waists(path) == WAIST


@pytest.mark.parametrize("at", range(7))
@pytest.mark.parametrize("trailing", [False, True])
def test_a_cell_too_few_or_too_many_is_refused_wherever_it_is(path, at, trailing):
    tail = [""] if trailing else []
    for shifted, count in (
        ([*ROWS[3][:at], *ROWS[3][at + 1 :], *tail], 6 + trailing),
        ([*ROWS[3][:at], "9", *ROWS[3][at:], *tail], 8 + trailing),
    ):
        rows = [[*row, *tail] for row in ROWS]
        rows[3] = shifted
        path.write_text(table(rows))
        assert f"row 5: has {count} cells; expected " in error(path)


def test_decimal_commas_that_separate_cells_are_refused(path):
    path.write_text(table().replace(".", ","))
    assert "expected 7" in error(path)


@pytest.mark.parametrize(
    ("name", "scale"),
    [
        ("timestamp", 1), ("time", 1e3), ("t", 1e6), ("timestamp", 1e9), ("timestamp_ms", 1e3),
        ("Timestamp (us)", 1e6), ("time [s]", 1), ("device_time_ns", 1e9), ("seconds", 1),
    ],
)  # fmt: skip
def test_unix_time_in_any_unit(path, name, scale):
    rows = [[f"{(1732540000.125 + k / 10) * scale:.6f}", *row[1:]] for k, row in enumerate(ROWS)]
    path.write_text(table(rows, HEAD.replace("time_s", name)))
    assert waists(path) == WAIST


@pytest.mark.parametrize(
    "stamp", ["2024-11-25T13:06:4{}.1+01:00", "2024-11-25 13:06:4{}.1Z", "13:06:4{}.5"]
)
def test_dates_and_times_of_day(path, stamp):
    rows = [[stamp.format(k), *row[1:]] for k, row in enumerate(ROWS)]
    path.write_text(table(rows, HEAD.replace("time_s", "timestamp")))
    recording = open_recording(path)
    assert [scene.stamp_ns for scene in recording.scenes] == [k * 10**9 for k in range(6)]


@pytest.mark.parametrize(("unit", "scale"), [("ms", 1e3), ("us", 1e6), ("ns", 1e9)])
def test_the_remedy_for_times_in_another_unit_works(path, unit, scale):
    rows = [[f"{k / 10 * scale:.0f}", *row[1:]] for k, row in enumerate(ROWS)]
    path.write_text(table(rows))
    remedy = error(path).split("name it '")[1].rstrip("'")
    assert remedy == f"time_{unit}"
    path.write_text(table(rows, HEAD.replace("time_s", remedy)))
    assert waists(path) == WAIST


def test_a_second_time_and_other_columns_are_named(path):
    rows = [["7", *row, "0.5"] for row in ROWS]
    path.write_text(table(rows, f"frame,{HEAD},timestamp"))
    assert waists(path) == WAIST
    assert "columns not used: 'frame', 'timestamp'" in open_recording(path).note


PEOPLE = [[*row, "2" if k % 2 else "1"] for k, row in enumerate(ROWS)]


@pytest.mark.parametrize(
    "name",
    ["person", "body_id", "Body ID", "track_id", "trackingId", "person_id", "subject", "player_id",
     "skeleton-id", "id"],
)  # fmt: skip
def test_a_column_of_people_makes_several(path, name):
    path.write_text(table(PEOPLE, f"{HEAD},{name}"))
    recording = open_recording(path)
    assert [[p.id for p in scene.people] for scene in recording.scenes] == [[1], [2]] * 3
    assert not recording.note


@pytest.mark.parametrize(
    ("one", "other"), [("Anna", "Ben"), ("72057594037944738", "72057594037944739"), ("0.5", "1.5")]
)
def test_people_of_other_names_get_numbers_which_are_noted(path, one, other):
    rows = [[*row[:-1], other if k % 2 else one] for k, row in enumerate(PEOPLE)]
    path.write_text(table(rows, f"{HEAD},tracking_id"))
    recording = open_recording(path, person=5)
    assert [[p.id for p in scene.people] for scene in recording.scenes] == [[5], [6]] * 3
    assert recording.note == f"'{one}' is person 5; '{other}' is person 6"


def test_a_column_that_numbers_the_rows_is_not_one_of_people(path):
    rows = [[f"{k / 10:.1f}", *ROWS[0][1:], str(k)] for k in range(30)]
    path.write_text(table(rows, f"{HEAD},id"))
    assert "column 'id' names 30 people in 30 rows; rename" in error(path)
    path.write_text(table(rows, f"{HEAD},row"))
    assert len(open_recording(path).scenes) == 30


@pytest.mark.parametrize(
    "name", ["confidence", "visibility", "score", "likelihood", "conf", "Tracked", "tracking_state"]
)
@pytest.mark.parametrize("unsure", ["0", "0.1", "", "nan", "false"])
def test_joints_of_no_confidence_are_not_observed(path, name, unsure):
    rows = [[*row, "1", unsure if k == 2 else "0.9"] for k, row in enumerate(ROWS)]
    path.write_text(table(rows, f"{HEAD},head_{name},waist_{name}"))
    recording = open_recording(path)
    seen = [scene.people[0].observed.tolist() for scene in recording.scenes]
    assert seen == [[k != 2, True] for k in range(6)]
    assert recording.note == "1 joints with a confidence below 0.3 are not observed"


@pytest.mark.parametrize("missing", ["", "nan", "NaN", "NA", "null", "-1.#IND", "1.#QNAN"])
def test_missing_numbers_are_not_observed(path, missing):
    rows = [row.copy() for row in ROWS]
    rows[2][2] = missing
    path.write_text(table(rows))
    seen = [scene.people[0].observed.tolist() for scene in open_recording(path).scenes]
    assert seen == [[k != 2, True] for k in range(6)]


@pytest.mark.parametrize("rate_hz", [100, 120, 240, 500, 1000])
@pytest.mark.parametrize("start", [0, 5000, 1_700_000_000])
def test_milliseconds_without_a_unit_are_not_taken_for_seconds(path, rate_hz, start):
    rows = [[f"{start + k * 1000 / rate_hz:.1f}", *row[1:]] for k, row in enumerate(ROWS)]
    path.write_text(table(rows, HEAD.replace("time_s", "timestamp")))
    assert "if the time is in ms, name it 'time_ms', if it is in s, 'time_s'" in error(path)
    path.write_text(table(rows, HEAD.replace("time_s", "time_ms")))
    assert open_recording(path).rate_hz == pytest.approx(rate_hz, rel=0.05)


@pytest.mark.parametrize(
    ("name", "times"),
    [
        ("time_s", [str(k) for k in range(6)]),
        ("time", [f"12:00:0{k}" for k in range(6)]),
        ("time", [f"2026-03-04 12:00:0{k}" for k in range(6)]),
        ("timestamp", [str(1_700_000_000_000 + 1000 * k) for k in range(6)]),
    ],
)
def test_slow_tables_whose_unit_is_known_are_read(path, name, times):
    rows = [[time, *row[1:]] for time, row in zip(times, ROWS, strict=True)]
    path.write_text(table(rows, HEAD.replace("time_s", name)))
    assert open_recording(path).rate_hz == 1.0
