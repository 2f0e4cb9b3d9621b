"""Which recordings are meant, in what order, and what is said of those that are damaged."""

import os

import pytest

from hri_predict.base.errors import ConfigError, RecordingError
from hri_predict.explaining.episodes import episodes
from hri_predict.explaining.recordings import Recordings
from hri_predict.explaining.situation import situation
from hri_predict.explaining.times import AskedTime, asked
from tests.hri_predict.explaining.made_up import NOON, SECOND, told, written


def test_a_folder_is_read_in_the_order_of_time(tmp_path):
    written(tmp_path / "b.mcap", told("CC"))
    written(tmp_path / "a.mcap", told("SS"), utc_ns=NOON + 60 * SECOND)
    found = Recordings([tmp_path])
    assert [file.path.name for file in found.files] == ["b.mcap", "a.mcap"]
    levels = [message.data["level"] for message in found.read(["/advice"])]
    assert levels == ["CLEAR", "CLEAR", "SLOW", "SLOW"]
    late = found.read(["/advice"], start_ns=NOON + 30 * SECOND)
    assert [message.data["level"] for message in late] == ["SLOW", "SLOW"]


@pytest.mark.long
def test_a_cut_file_gives_what_came_before_and_a_note(tmp_path, near):
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(near.read_bytes()[: near.stat().st_size // 2])
    found = Recordings([cut])
    assert 10 < sum(1 for _ in found.read(["/advice"])) < 141
    assert len(found.notes) == 1
    assert "has no end" in found.notes[0]


def test_a_whole_file_has_no_note(near):
    found = Recordings([near])
    assert sum(1 for _ in found.read(["/advice"])) == 142  # 5.6 s at 25 Hz, starting and stopping
    assert found.notes == []


def test_damage_anywhere_is_told_or_costs_nothing(tmp_path, near):
    """Only the index may be damaged unnoticed: nothing is read from it."""
    whole, notes = [told.data for told in Recordings([near]).read()], 0
    for at in (0.2, 0.35, 0.5, 0.65, 0.8, 0.95):
        data = bytearray(near.read_bytes())
        place = int(len(data) * at)
        data[place : place + 64] = bytes(64)
        (tmp_path / "damaged.mcap").write_bytes(data)
        found = Recordings([tmp_path / "damaged.mcap"])
        read = [told.data for told in found.read()]
        assert found.notes or read == whole
        assert read == whole[: len(read)]
        notes += bool(found.notes)
    assert notes >= 3


def test_what_is_no_recording_in_a_folder_is_left_out_and_told(tmp_path):
    written(tmp_path / "a.mcap", told("CC"))
    (tmp_path / "b.mcap").write_bytes(b"no recording")
    found = Recordings([tmp_path])
    assert len(found.files) == 1
    assert "b.mcap" in found.notes[0]


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("none.mcap", "no such file"),
        ("empty", "has no .mcap"),
        ("text.mcap", "not recorded by .* replay .* --record text_run.mcap"),
        ("pipe.mcap", "is a device or a pipe, not a file"),
    ],
)
def test_what_cannot_be_read_is_one_line(tmp_path, name, words):
    (tmp_path / "empty").mkdir()
    os.mkfifo(tmp_path / "pipe.mcap")
    (tmp_path / "text.mcap").write_text("hello")
    with pytest.raises(RecordingError, match=words):
        Recordings([tmp_path / name])


def test_a_file_that_retention_deletes_meanwhile_is_told_and_costs_no_other(tmp_path):
    written(tmp_path / "a.mcap", told("CC"))
    written(tmp_path / "b.mcap", told("SS"), utc_ns=NOON + 60 * SECOND)
    found = Recordings([tmp_path])
    (tmp_path / "a.mcap").unlink()
    levels = [message.data["level"] for message in found.read(["/advice"])]
    assert levels == ["SLOW", "SLOW"]
    assert "a.mcap: cannot be read: No such file" in found.notes[0]


def test_damage_in_the_last_file_costs_no_time_of_day(tmp_path):
    """The end of all files is asked for, to know which day is meant."""
    written(tmp_path / "a.mcap", [*told("CC"), (0.5, "/status", b"no object")])
    found = Recordings([tmp_path])
    assert asked("12:00:00", found).start_ns == NOON
    assert "is damaged" in found.notes[0]


def test_files_of_two_cells_are_refused(tmp_path):
    written(tmp_path / "a.mcap", told("CC"), cell="press")
    written(tmp_path / "b.mcap", told("CC"), cell="weld")
    with pytest.raises(RecordingError, match="several cells"):
        Recordings([tmp_path])


def test_files_of_the_same_time_are_told_and_their_episodes_stay_apart(tmp_path):
    """The wall clock was set back by a minute while the robot stood."""
    written(tmp_path / "a.mcap", [(at + 60, *rest) for at, *rest in told("CX" + 50 * "X")])
    written(tmp_path / "b.mcap", [(at + 62, *rest) for at, *rest in told(50 * "X" + "C")])
    found = Recordings([tmp_path])
    both = list(episodes(found.read(["/advice"])))
    assert [e.stopped_ns for e in both] == [5 * SECOND, 5 * SECOND]
    assert len(found.twice) == 1
    assert "a.mcap and b.mcap cover the same time" in found.notes[0]
    with pytest.raises(ConfigError, match=r"recorded twice.*name one file, .*a\.mcap or .*b\.mcap"):
        situation(found, AskedTime(NOON + 64 * SECOND, SECOND), None)
    one = situation(Recordings([tmp_path / "a.mcap"]), AskedTime(NOON + 64 * SECOND, SECOND), None)
    assert one.episode is not None


def test_files_that_meet_are_not_of_the_same_time(tmp_path):
    written(tmp_path / "a.mcap", told(50 * "X"))
    written(tmp_path / "b.mcap", told("XC"), utc_ns=NOON + round(4.5 * SECOND))
    found = Recordings([tmp_path])
    (episode,) = episodes(found.read(["/advice"]))
    assert episode.end_ns is not None
    assert found.twice == []
