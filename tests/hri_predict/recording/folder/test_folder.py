"""A folder that is recorded into: files by cell and UTC, the oldest own ones give way."""

import errno
import os
from datetime import UTC, datetime
from pathlib import Path

import pytest

from hri_predict.base.errors import ConfigError, RecordingError
from hri_predict.base.settings import validated
from hri_predict.contracts.joint_map import load_joint_map
from hri_predict.contracts.scene import Scene
from hri_predict.recording import Recorder, RecordingInfo, open_recording, read_messages
from hri_predict.recording.folder.folder import Folder, own_files
from hri_predict.recording.folder.settings import RecordSettings
from hri_predict.recording.mcap import file as mcap_file
from hri_predict.recording.mcap.clocks import Reading

INFO = RecordingInfo(joint_map=load_joint_map("canonical"), rate_hz=25.0, declares_noise=True)
MONDAY_NS = int(datetime(2026, 3, 9, 14, 3, 7, tzinfo=UTC).timestamp()) * 10**9
STEP_NS = 40_000_000


class Wall:
    """The machine's clocks, set by the test."""

    name = "system"

    def __init__(self) -> None:
        self.offset_ns, self.suspended_ns = MONDAY_NS, 0

    def read(self, node_ns: int) -> Reading:
        return Reading(
            node_ns=node_ns, utc_ns=node_ns + self.offset_ns, boot_ns=node_ns + self.suspended_ns
        )


def _settings(**keys: object) -> RecordSettings:
    small = {"max_mb": 1, "max_minutes": 1, "budget_gb": 0.01, "min_free_gb": 0}
    return RecordSettings.model_validate({"folder": "unused", **small, **keys})


def _place(folder: Path, free: list[float] | None = None, **keys: object) -> Folder:
    room = free or [1e12]
    return Folder(folder, "press-4", _settings(**keys), free=lambda _: int(room[0]))


def _scenes(recorder: Recorder, first: int, count: int) -> None:
    for k in range(first, first + count):
        recorder.on_scene(Scene(STEP_NS * k, k, True, ()), STEP_NS * k)


def _names(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.glob("*.mcap"))


def _of_another_run(folder: Path, name: str, megabytes: float) -> Path:
    """A recording of ours, of a given size."""
    path = folder / name
    with Recorder(path, INFO, threaded=False) as recorder:
        _scenes(recorder, 0, 2)
    with path.open("ab") as file:
        file.write(bytes(round(megabytes * 1e6)))
    return path


def test_files_are_named_by_cell_and_utc_and_none_is_lost_between_them(tmp_path):
    with Recorder(_place(tmp_path), INFO, threaded=False, clocks=Wall()) as recorder:
        _scenes(recorder, 0, 25 * 150)  # two and a half minutes
    names = ["press-4-20260309T140307Z.mcap", "press-4-20260309T140407Z.mcap"]
    assert _names(tmp_path)[:2] == names
    assert recorder.files == len(_names(tmp_path)) == 3
    sequences = [s.sequence for n in _names(tmp_path) for s in open_recording(tmp_path / n).scenes]
    assert sequences == list(range(25 * 150))
    first = open_recording(tmp_path / names[0])
    assert first.utc_ns[0] == MONDAY_NS
    assert first.utc_ns[25] == MONDAY_NS + 10**9


def test_a_file_that_is_full_is_followed_by_the_next_one(tmp_path):
    place = _place(tmp_path, max_minutes=60)
    with Recorder(place, INFO, threaded=False, clocks=Wall()) as recorder:
        for k in range(3000):
            recorder.sent("bus", os.urandom(1000), STEP_NS * k)  # 3 MB that do not compress
    sizes = [path.stat().st_size for path in tmp_path.glob("*.mcap")]
    assert len(sizes) >= 3
    assert max(sizes) < 1.2e6  # a chunk more at most


def test_the_budget_holds_and_the_oldest_own_files_go_first(tmp_path):
    old = [_of_another_run(tmp_path, f"press-4-2026030{d}T060000Z.mcap", 3) for d in (1, 2, 3, 4)]
    with Recorder(_place(tmp_path), INFO, threaded=False, clocks=Wall()) as recorder:
        _scenes(recorder, 0, 10)
    assert [path.exists() for path in old] == [False, False, True, True]
    assert sum(path.stat().st_size for path in tmp_path.glob("*.mcap")) < 10e6


def test_files_of_others_are_never_removed(tmp_path):
    strangers = {
        "notes.txt": b"x",
        "press-4-20200101T000000Z.mcap": b"a file that somebody else named so" * 10,
        "press-40-20200101T000000Z.mcap": b"",
        "Press-4-20200101T000000Z.mcap": b"",
        "press-4-20200101T000000Z.mcap.bak": b"",
        "keep press-4-20200101T000000Z.mcap": b"",
        "press-4-20209901T000000Z.mcap": b"",
    }
    for name, data in strangers.items():
        (tmp_path / name).write_bytes(data)
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    target = _of_another_run(elsewhere, "precious.mcap", 1)
    (tmp_path / "press-4-20200102T000000Z.mcap").symlink_to(target)
    (tmp_path / "press-4-20200103T000000Z.mcap").mkdir()
    renamed = _of_another_run(tmp_path, "accident.mcap", 20)
    own = _of_another_run(tmp_path, "press-4-20200104T000000Z.mcap", 20)
    place = _place(tmp_path, keep_days=1)
    with Recorder(place, INFO, threaded=False, clocks=Wall()) as recorder:
        _scenes(recorder, 0, 25 * 70)
    assert not own.exists()
    assert renamed.exists()
    assert target.exists()
    assert {name: (tmp_path / name).read_bytes() for name in strangers} == strangers
    assert len(list(tmp_path.glob("press-4-2020010[23]*"))) == 2


def test_a_wrong_wall_clock_costs_nothing_at_first_and_then_two_old_files_each_time(tmp_path):
    days = [_of_another_run(tmp_path, f"press-4-2026030{d}T060000Z.mcap", 0.1) for d in range(1, 9)]
    wall = Wall()
    wall.offset_ns += 20 * 365 * 86400 * 10**9  # the battery of the clock is empty
    with Recorder(_place(tmp_path, keep_days=30), INFO, threaded=False, clocks=wall) as recorder:
        _scenes(recorder, 0, 10)
        assert all(path.exists() for path in days)
        _scenes(recorder, 25 * 61, 10)  # a second file of the wrong time
    assert [path.exists() for path in days] == 2 * [False] + 6 * [True]


def test_a_file_that_is_too_old_goes(tmp_path):
    old = _of_another_run(tmp_path, "press-4-20260101T060000Z.mcap", 0.1)
    newer = _of_another_run(tmp_path, "press-4-20260308T060000Z.mcap", 0.1)
    with Recorder(_place(tmp_path, keep_days=30), INFO, threaded=False, clocks=Wall()) as recorder:
        _scenes(recorder, 0, 10)
    assert (old.exists(), newer.exists()) == (False, True)


def test_where_others_need_the_disk_it_makes_room_or_waits(tmp_path, caplog):
    own = _of_another_run(tmp_path, "press-4-20260101T000000Z.mcap", 1)
    free = [2e9]
    place = _place(tmp_path, free, min_free_gb=1)
    with Recorder(place, INFO, threaded=False, clocks=Wall()) as recorder:
        _scenes(recorder, 0, 100)
        assert own.exists()
        free[0] = 0.5e9  # removing its own does not help
        _scenes(recorder, 100, 100)
        assert not own.exists()
        assert recorder.error == "less than 1 GB free (min_free_gb)"
        lost = recorder.dropped
        assert 0 < lost <= 100
        free[0] = 2e9
        _scenes(recorder, 200, 100)
    assert recorder.error is None
    assert recorder.dropped < lost + 60  # it tries every two seconds
    assert "continues; lost" in caplog.text


def test_a_disk_that_breaks_ends_the_file_and_begins_another(tmp_path, monkeypatch):
    with Recorder(_place(tmp_path), INFO, threaded=False, clocks=Wall()) as recorder:
        _scenes(recorder, 0, 100)
        with monkeypatch.context() as broken:

            def fails(*_):
                raise OSError(errno.EIO, "Input/output error")

            broken.setattr(mcap_file.os, "write", fails)
            _scenes(recorder, 100, 200)
            assert recorder.error == "Input/output error"
        _scenes(recorder, 300, 200)
    assert recorder.error is None
    found = [open_recording(tmp_path / name) for name in _names(tmp_path) if "-2.mcap" not in name]
    assert "cut" in found[0].note
    assert found[-1].scenes[-1].sequence == 499
    kept = sum(len(each.scenes) for each in found)
    assert kept + recorder.dropped >= 500  # nothing is lost without being counted


def test_a_step_of_the_wall_clock_begins_a_file_and_overwrites_none(tmp_path):
    wall = Wall()
    with Recorder(_place(tmp_path), INFO, threaded=False, clocks=wall) as recorder:
        _scenes(recorder, 0, 100)
        wall.offset_ns -= 4 * 10**9  # four seconds back: the same second again
        _scenes(recorder, 100, 100)
        wall.offset_ns += 3600 * 10**9
        wall.suspended_ns = 3600 * 10**9  # it slept for an hour
        _scenes(recorder, 200, 100)
    names = _names(tmp_path)
    assert names == [
        "press-4-20260309T140307Z-2.mcap",
        "press-4-20260309T140307Z.mcap",
        "press-4-20260309T150311Z.mcap",
    ]
    said = [m.data for n in names for m in read_messages(tmp_path / n, ["/clock"])]
    assert sorted(d["utc_moved_s"] for d in said if d["utc_moved_s"]) == [-4.0, 3600.0]
    assert [d["suspended_s"] for d in said if d["suspended_s"]] == [3600.0]


def test_two_nodes_do_not_share_a_cell_and_two_cells_share_a_folder(tmp_path):
    place = _place(tmp_path)
    with pytest.raises(ConfigError, match="another node records 'press-4' there"):
        _place(tmp_path)
    other = Folder(tmp_path, "press-5", _settings())
    place.close()
    again = _place(tmp_path)
    for each in (again, other):
        each.close()


def test_a_file_that_somebody_removes_is_followed_by_another(tmp_path):
    with Recorder(_place(tmp_path), INFO, threaded=False, clocks=Wall()) as recorder:
        _scenes(recorder, 0, 100)
        next(tmp_path.glob("*.mcap")).unlink()
        _scenes(recorder, 100, 100)
    assert open_recording(tmp_path / _names(tmp_path)[0]).scenes[-1].sequence == 199


def test_own_files_come_oldest_first(tmp_path):
    for name in ("press-4-20260102T000000Z-10.mcap", "press-4-20260102T000000Z-2.mcap"):
        _of_another_run(tmp_path, name, 0)
    _of_another_run(tmp_path, "press-4-20260101T000000Z.mcap", 0)
    assert [kept.number for kept in own_files(tmp_path, "press-4")] == [1, 2, 10]


def test_a_folder_that_cannot_be_written_is_one_line(tmp_path):
    (tmp_path / "file").write_text("x")
    with pytest.raises(ConfigError, match=r"record\.folder .*name another folder"):
        Folder(tmp_path / "file" / "in", "press-4", _settings())


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write everywhere")
def test_a_folder_that_is_read_only_is_one_line(tmp_path):
    tmp_path.chmod(0o500)
    with pytest.raises((ConfigError, RecordingError), match="Permission denied"):
        Folder(tmp_path, "press-4", _settings())


@pytest.mark.parametrize(
    ("data", "said"),
    [
        ({"max_mb": 5}, "name either a 'file' or a 'folder'"),
        ({"file": "a.mcap", "folder": "b"}, "name either a 'file' or a 'folder'"),
        ({"file": "a.mcap", "max_mb": 5}, "max_mb has no effect on a single file"),
        ({"folder": "b", "budget_gb": 0.5}, "budget_gb 0.5 holds no two files"),
        ({"folder": "b", "name": "../up"}, "name"),
    ],
)
def test_what_makes_no_sense_is_refused(data, said):
    with pytest.raises(ConfigError, match=said):
        validated(RecordSettings, data, "cell.yaml: record")


def test_a_path_alone_is_a_file():
    assert validated(RecordSettings, "day.mcap", "cell.yaml: record").file == "day.mcap"
