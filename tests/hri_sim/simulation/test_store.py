"""What is done is kept, and goes on only with what it was begun with."""

import pytest

from hri_predict.errors import ConfigError
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
    with pytest.raises(ConfigError, match="not of this version"):
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
