"""``evidence``: lists, counts and verifies."""

import json

import pytest

from hri_predict.operation.evidence import chain
from hri_predict.protocol.messages import Level
from tests.hri_predict.operation.evidence.test_keeper import Run


@pytest.fixture
def folder(tmp_path):
    Run(tmp_path).go(1.0).go(0.1, near=(0,)).go(2.0).go(0.2, Level.STOP).go(1.0).close()
    return tmp_path / "kept"


@pytest.fixture
def asked(cli):
    """Run the command; returns the exit status and what it printed."""

    def run(*args):
        status, out, err = cli("evidence", *args)
        return status, out + err

    return run


def test_it_lists_events_and_counts_near_misses(folder, asked):
    status, said = asked(folder)
    assert status == 0
    assert "near miss" in said
    assert "left hand" in said
    assert "l_hand" not in said
    assert "4 lines, 0 wrong" in said
    found = json.loads(asked(folder, "--json")[1])
    assert [event["kind"] for event in found["events"]] == ["near_miss", "stop"]
    assert found["near_misses"][0]["count"] == 1


def test_a_changed_file_is_named_and_fails(folder, asked):
    next(folder.glob("*stop.mcap")).write_bytes(b"nothing")
    status, said = asked(folder)
    assert status == 1
    assert "-stop.mcap was changed" in said


def test_lines_that_were_cut_off_are_seen_by_the_noted_hash(folder, asked):
    newest = json.loads(asked(folder, "--json")[1])["newest_hash"]
    assert asked(folder, "--newest", newest[:12])[0] == 0
    log = folder / chain.LOG
    log.write_text("".join(log.read_text().splitlines(keepends=True)[:-1]))
    assert asked(folder)[0] == 0  # whole, only shorter
    status, said = asked(folder, "--newest", newest[:12])
    assert status == 1
    assert "cut off at the end" in said


@pytest.mark.parametrize("short", ["", "a", "1234567"])
def test_a_hash_that_any_line_may_have_proves_nothing(folder, asked, short):
    status, said = asked(folder, "--newest", short)
    assert status == 2
    assert "too short to identify a line" in said


def test_another_folder_is_one_line(tmp_path, asked):
    status, said = asked(tmp_path)
    assert status == 2
    assert said.count("\n") == 1
    assert ": no evidence.jsonl" in said


def test_a_node_that_was_killed_and_its_file_are_noted(folder, asked):
    log = folder / chain.LOG
    log.write_text("".join(log.read_text().splitlines(keepends=True)[:-1]))
    (folder / "20260102T030405.000Z-arm-stop.mcap").write_bytes(b"half")
    status, said = asked(folder)
    assert status == 0
    assert "has no end: it still runs, or was killed" in said
    assert "arm-stop.mcap is in no line" in said


def test_every_event_has_a_row_of_its_own(tmp_path, asked):
    Run(tmp_path).go(1.0).go(0.2, Level.STOP).go(0.1).go(0.1, near=(0,)).go(2.0).close()
    found = json.loads(asked(tmp_path / "kept", "--json")[1])
    assert [event["kind"] for event in found["events"]] == ["stop", "near_miss"]
    assert found["events"][1]["body_part"] == "l_hand"
    assert len({event["file"] for event in found["events"]}) == 1
    assert found["near_misses"][0]["count"] == 1


def test_a_broken_log_that_was_set_aside_stays_wrong(folder, asked):
    log = folder / chain.LOG
    log.write_text(log.read_text().replace("PERSON_NEAR", "NONE"))
    assert asked(folder)[0] == 1
    Run(folder.parent).close()
    status, said = asked(folder)
    assert status == 1
    assert "is an earlier, damaged log" in said


def test_a_narrow_table_breaks_no_word(monkeypatch, folder, asked):
    monkeypatch.setenv("COLUMNS", "80")
    log = folder / chain.LOG
    log.write_text(log.read_text().replace("PERSON_NEAR", "PERSON_APPROACHING"))
    assert "approaching" in asked(folder)[1]
