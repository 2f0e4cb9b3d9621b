"""The evidence's log: whatever is changed, removed or inserted is found."""

import json
import os
import resource
import signal
from datetime import UTC, datetime

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hri_predict.base.errors import RecordingError
from hri_predict.operation.evidence import chain


def written(folder, count=4):
    last = chain.START
    for number in range(count):
        name = f"{number}.mcap"
        (folder / name).write_bytes(b"seconds %d" % number)
        entry = {"kind": "stop", "n": number, "file": name}
        entry["sha256"] = chain.file_hash(folder / name)
        last = chain.append(folder, entry, last)
    return last


def wrongs(folder):
    return [(line.number, line.wrong) for line in chain.read(folder) if line.wrong]


def lines(folder):
    return (folder / chain.LOG).read_text().splitlines()


def rewrite(folder, entries):
    (folder / chain.LOG).write_text("".join(f"{entry}\n" for entry in entries))


def test_a_whole_chain_has_nothing_wrong(tmp_path):
    last = written(tmp_path)
    assert wrongs(tmp_path) == []
    assert chain.newest(tmp_path) == last
    assert chain.newest(tmp_path / "nowhere") == chain.START


def test_a_changed_line_is_found(tmp_path):
    written(tmp_path)
    said = lines(tmp_path)
    said[1] = said[1].replace('"n": 1', '"n": 7')
    rewrite(tmp_path, said)
    assert wrongs(tmp_path) == [(2, "was changed")]


def test_a_line_that_was_changed_and_hashed_anew_breaks_the_next(tmp_path):
    written(tmp_path)
    said = lines(tmp_path)
    entry = json.loads(said[1]) | {"n": 7}
    entry["hash"] = chain.hash_of(entry)
    rewrite(tmp_path, [said[0], json.dumps(entry), *said[2:]])
    assert wrongs(tmp_path) == [(3, "does not follow the previous line")]


@pytest.mark.parametrize("gone", [0, 1, 2])
def test_a_removed_line_is_found(tmp_path, gone):
    written(tmp_path)
    said = lines(tmp_path)
    del said[gone]
    rewrite(tmp_path, said)
    assert wrongs(tmp_path) == [(gone + 1, "does not follow the previous line")]


def test_a_changed_and_a_missing_file_are_found(tmp_path):
    written(tmp_path)
    (tmp_path / "1.mcap").write_bytes(b"other seconds")
    (tmp_path / "2.mcap").unlink()
    (two, changed), (three, missing) = wrongs(tmp_path)
    assert (two, changed) == (2, "its file 1.mcap was changed")
    assert three == 3
    assert "2.mcap cannot be read" in missing


def test_a_file_that_gave_way_may_be_missing(tmp_path):
    last = written(tmp_path)
    (tmp_path / "0.mcap").unlink()
    chain.append(tmp_path, {"kind": "room", "removed": ["0.mcap"]}, last)
    assert wrongs(tmp_path) == []


def test_a_removed_file_excuses_no_later_one_of_its_name(tmp_path):
    """After the clock was set back, a name may come again."""
    last = written(tmp_path, 1)
    last = chain.append(tmp_path, {"kind": "room", "removed": ["0.mcap"]}, last)
    (tmp_path / "0.mcap").write_bytes(b"another event")
    digest = chain.file_hash(tmp_path / "0.mcap")
    chain.append(tmp_path, {"kind": "stop", "file": "0.mcap", "sha256": digest}, last)
    assert wrongs(tmp_path) == []
    (tmp_path / "0.mcap").write_bytes(b"changed")
    assert wrongs(tmp_path) == [(3, "its file 0.mcap was changed")]
    (tmp_path / "0.mcap").unlink()
    assert [number for number, _ in wrongs(tmp_path)] == [3]


def test_no_file_of_another_folder_is_read(tmp_path):
    chain.append(tmp_path, {"file": "../secret", "sha256": ""}, chain.START)
    assert wrongs(tmp_path) == [(1, "does not name a file of this folder, '../secret'")]


def test_a_torn_log_is_set_aside_and_nothing_is_lost(tmp_path):
    written(tmp_path)
    torn = (tmp_path / chain.LOG).read_bytes()[:-20]
    (tmp_path / chain.LOG).write_bytes(torn)
    with pytest.raises(RecordingError, match="line 4: is not an entry"):
        chain.newest(tmp_path)
    name = chain.set_aside(tmp_path, datetime(2026, 1, 2, 3, 4, 5, tzinfo=UTC))
    assert (tmp_path / name).read_bytes() == torn
    assert chain.newest(tmp_path) == chain.START


def test_a_last_line_that_lost_only_its_end_is_continued(tmp_path):
    last = written(tmp_path)
    log = tmp_path / chain.LOG
    log.write_bytes(log.read_bytes().removesuffix(b"\n"))
    assert chain.newest(tmp_path) == last
    last = chain.append(tmp_path, {"kind": "stop"}, last)
    assert wrongs(tmp_path) == []
    assert (chain.newest(tmp_path), len(lines(tmp_path))) == (last, 5)


@given(data=st.binary(max_size=300))
def test_no_bytes_break_the_reader(tmp_path_factory, data):
    folder = tmp_path_factory.mktemp("any")
    (folder / chain.LOG).write_bytes(data)
    assert all(line.wrong for line in chain.read(folder))


@given(at=st.integers(0, 5000), bit=st.integers(0, 7))
def test_a_flipped_bit_is_found_or_changes_no_entry(tmp_path_factory, at, bit):
    folder = tmp_path_factory.mktemp("flip")
    written(folder)
    before = [json.loads(text) for text in lines(folder)]
    raw = bytearray((folder / chain.LOG).read_bytes())
    at %= len(raw)
    raw[at] ^= 1 << bit
    (folder / chain.LOG).write_bytes(bytes(raw))
    read = [*chain.read(folder)]
    if not any(line.wrong for line in read):  # such as a tab for a space, or the last line's end
        assert [line.data for line in read] == before


@pytest.mark.parametrize("name", ["a\0b.mcap", "\udc80.mcap", "/etc/passwd", "x/y.mcap", 7, [], ""])
def test_hostile_names_are_no_files(tmp_path, name):
    chain.append(tmp_path, {"file": name, "sha256": ""}, chain.START)
    ((number, said),) = wrongs(tmp_path)
    assert number == 1
    assert "does not name a file of this folder" in said


def test_a_pipe_in_the_place_of_a_file_is_not_read(tmp_path):
    written(tmp_path, 1)
    (tmp_path / "0.mcap").unlink()
    os.mkfifo(tmp_path / "0.mcap")
    assert wrongs(tmp_path) == [(1, "its file 0.mcap is not a file")]


def test_half_a_line_on_a_full_disk_is_taken_back(tmp_path):
    last = written(tmp_path)
    whole = (tmp_path / chain.LOG).stat().st_size
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    ignored = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_FSIZE, (whole + 40, before[1]))
    try:
        with pytest.raises(OSError):
            chain.append(tmp_path, {"kind": "stop"}, last)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
        signal.signal(signal.SIGXFSZ, ignored)
    assert (tmp_path / chain.LOG).stat().st_size == whole
    chain.append(tmp_path, {"kind": "stop"}, last)
    assert wrongs(tmp_path) == []


@pytest.fixture
def small(monkeypatch):
    """Logs that are full after two lines."""
    monkeypatch.setattr(chain, "FULL_BYTES", 500)


def test_a_full_log_is_numbered_and_the_chain_goes_on(tmp_path, small):
    last = written(tmp_path, 7)
    logs = sorted(path.name for path in tmp_path.glob("*.jsonl"))
    assert logs == ["evidence-000001.jsonl", "evidence-000002.jsonl", "evidence-000003.jsonl",
                    "evidence.jsonl"]  # fmt: skip
    found = list(chain.read(tmp_path))
    assert [line.data["n"] for line in found] == list(range(7))
    assert [line.data.get("continues") for line in found[::2]] == [None, *logs[:3]]
    assert wrongs(tmp_path) == []
    assert chain.newest(tmp_path) == last


def test_a_node_that_died_before_the_first_line_of_a_new_log_goes_on(tmp_path, small):
    last = written(tmp_path)
    (tmp_path / chain.LOG).rename(tmp_path / "evidence-000002.jsonl")
    assert chain.newest(tmp_path) == last
    chain.append(tmp_path, {"kind": "start"}, last)
    assert wrongs(tmp_path) == []
    assert list(chain.read(tmp_path))[-1].data["continues"] == "evidence-000002.jsonl"


@pytest.mark.parametrize("gone", [0, 1])
def test_a_log_that_was_removed_is_found(tmp_path, small, gone):
    written(tmp_path, 7)
    (tmp_path / f"evidence-{gone + 1:06d}.jsonl").unlink()
    ((number, wrong),) = wrongs(tmp_path)
    assert number == 1
    assert f"continues evidence-{gone + 1:06d}.jsonl, where" in wrong


def test_a_changed_line_of_an_older_log_is_found(tmp_path, small):
    written(tmp_path, 7)
    older = tmp_path / "evidence-000001.jsonl"
    older.write_text(older.read_text().replace("stop", "fall", 1))
    (line,) = [line for line in chain.read(tmp_path) if line.wrong]
    assert (line.log, line.number) == ("evidence-000001.jsonl", 1)


def test_an_empty_log_after_a_full_one_is_none(tmp_path, small):
    """The node died, or the disk was full, before the first line."""
    last = written(tmp_path)
    (tmp_path / chain.LOG).rename(tmp_path / "evidence-000002.jsonl")
    (tmp_path / chain.LOG).touch()
    assert chain.newest(tmp_path) == last
    chain.append(tmp_path, {"kind": "start"}, last)
    assert wrongs(tmp_path) == []


def test_no_number_is_written_over(tmp_path, small):
    written(tmp_path, 2)
    (tmp_path / chain.LOG).rename(tmp_path / "evidence-999999.jsonl")
    last = chain.newest(tmp_path)
    for number in range(6):
        last = chain.append(tmp_path, {"kind": "stop", "n": 2 + number, "pad": "x" * 200}, last)
    assert wrongs(tmp_path) == []
    assert [line.data["n"] for line in chain.read(tmp_path)] == list(range(8))


def test_what_is_no_file_is_no_log(tmp_path):
    os.mkfifo(tmp_path / "evidence-000005.jsonl")
    (tmp_path / "evidence-000006.jsonl").mkdir()
    (tmp_path / "evidence-000007.jsonl").symlink_to("/dev/zero")
    last = written(tmp_path)
    assert chain.newest(tmp_path) == last
    assert wrongs(tmp_path) == []
