"""What is done is kept, and goes on only with what it was begun with."""

import json
import os

import pytest

from hri_predict.base.errors import ConfigError
from hri_sim.simulation.store import Store

ROWS = {"outcomes": [{"index": 0, "contacts": 0}]}


def test_finished_blocks_are_there_again_even_if_the_last_line_was_cut(tmp_path):
    store = Store(tmp_path, {"seed": 0}, resume=False)
    store.add("0/0/0", ROWS)
    store.add("0/1/0", ROWS)
    path = tmp_path / "episodes.jsonl"
    path.write_bytes(path.read_bytes()[:-20])
    again = Store(tmp_path, {"seed": 0}, resume=True)
    assert again.done == {"0/0/0": ROWS}
    again.add("0/1/0", ROWS)
    assert Store(tmp_path, {"seed": 0}, resume=True).done == {"0/0/0": ROWS, "0/1/0": ROWS}


def test_another_simulation_is_not_gone_on_with(tmp_path):
    Store(tmp_path, {"seed": 0}, resume=False).add("0/0/0", ROWS)
    with pytest.raises(ConfigError, match="another configuration"):
        Store(tmp_path, {"seed": 1}, resume=True)


def test_nothing_is_overwritten_without_resume(tmp_path):
    Store(tmp_path, {"seed": 0}, resume=False)
    with pytest.raises(ConfigError, match="--resume"):
        Store(tmp_path, {"seed": 0}, resume=False)


def test_a_file_of_something_else_is_refused(tmp_path):
    (tmp_path / "episodes.jsonl").write_text("hello\n")
    with pytest.raises(ConfigError, match="from another version"):
        Store(tmp_path, {"seed": 0}, resume=True)


def test_a_folder_that_cannot_be_written_is_named(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(ConfigError, match="cannot be written"):
        Store(tmp_path / "file" / "out", {"seed": 0}, resume=False)


def test_without_a_folder_blocks_are_kept_in_memory():
    store = Store(None, {"seed": 0}, resume=False)
    store.add("0/0/0", ROWS)
    assert store.done == {"0/0/0": ROWS}


@pytest.mark.parametrize(
    "line",
    [b'{"x": 1}', b'{"block": [1], "rows": {}}', b"[" * 100_000, b"\xff\xfe", b'{"block": 3}'],
)
def test_a_damaged_line_is_done_again(tmp_path, line):
    Store(tmp_path, {"seed": 0}, resume=False).add("0/0/0", ROWS)
    with (tmp_path / "episodes.jsonl").open("ab") as file:
        file.write(line + b"\n")
    assert Store(tmp_path, {"seed": 0}, resume=True).done == {"0/0/0": ROWS}


@pytest.mark.parametrize(
    "damage",
    [
        lambda line: line.replace('"contacts": 0', '"contacts": 1'),
        lambda line: line.replace('"contacts": 0', '"contacts": NaN'),
        lambda line: json.dumps({**json.loads(line), "rows": {}}),
        lambda line: json.dumps({**json.loads(line), "block": "0/1/0"}),
        lambda line: line[:-9],
        lambda line: json.dumps({"block": "0/0/0", "rows": {"outcomes": [{}]}}),
    ],
)
def test_a_block_that_is_not_what_was_written_is_done_again(tmp_path, damage):
    rows = {"outcomes": [{"contacts": 0}]}
    Store(tmp_path, {"seed": 0}, resume=False).add("0/0/0", rows)
    path = tmp_path / "episodes.jsonl"
    header, line = path.read_text().splitlines()
    path.write_text(f"{header}\n{damage(line)}\n")
    assert Store(tmp_path, {"seed": 0}, resume=True).done == {}
    path.write_text(f"{header}\n{line}\n")
    assert Store(tmp_path, {"seed": 0}, resume=True).done == {"0/0/0": rows}


def test_a_block_that_cannot_be_written_says_how_to_go_on(tmp_path):
    store = Store(tmp_path, {"seed": 0}, resume=False)
    path = tmp_path / "episodes.jsonl"
    path.unlink()
    path.mkdir()
    with pytest.raises(ConfigError, match=r"cannot be written: .*; free some space, then"):
        store.add("0/0/0", ROWS)


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="this system has no named pipes")
def test_a_pipe_is_not_waited_for(tmp_path):
    os.mkfifo(tmp_path / "episodes.jsonl")
    with pytest.raises(ConfigError, match="is a pipe, not a file"):
        Store(tmp_path, {"seed": 0}, resume=True)
