"""A checkpoint is written whole or not at all, and reading one runs no code."""

import io
import pickle
from pathlib import Path
from typing import Any

import pytest
import torch

from hri_predict.base.errors import ConfigError
from hri_predict.lab.training.checkpoint import load_checkpoint, save_checkpoint, sealed

STATE: dict[str, Any] = {
    "weights": {"a": torch.arange(3.0)},
    "step": 7,
    "text": "{}",
    "many": [torch.ones(2)],
}


def test_what_is_saved_is_read_back(tmp_path):
    path = tmp_path / "new" / "last.pt"
    save_checkpoint(path, STATE)
    read = load_checkpoint(path)
    assert torch.equal(read["weights"]["a"], STATE["weights"]["a"])
    assert torch.equal(read["many"][0], STATE["many"][0])
    assert (read["step"], read["text"]) == (7, "{}")
    assert [p.name for p in path.parent.iterdir()] == ["last.pt"]


def test_a_write_that_fails_leaves_the_old_one(tmp_path, monkeypatch):
    path = tmp_path / "last.pt"
    save_checkpoint(path, STATE)

    def full(state, file):
        file.write(b"half of it")
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(torch, "save", full)
    with pytest.raises(ConfigError, match="No space left on device; free some room"):
        save_checkpoint(path, {})
    assert load_checkpoint(path)["step"] == 7
    assert [p.name for p in tmp_path.iterdir()] == ["last.pt"]


def test_a_folder_that_is_a_file_is_a_mistake(tmp_path):
    (tmp_path / "file").write_text("", encoding="utf-8")
    with pytest.raises(ConfigError, match="cannot be written"):
        save_checkpoint(tmp_path / "file" / "last.pt", STATE)


def test_no_room_is_not_blamed_where_there_is_no_folder():
    with pytest.raises(ConfigError, match=r"/dev/null is not a folder; choose another 'out'$"):
        save_checkpoint(Path("/dev/null/last.pt"), STATE)


class Harmful:
    def __reduce__(self):
        return (exec, ("raise SystemExit('it ran')",))


@pytest.mark.filterwarnings("ignore:Detected pickle protocol")
@pytest.mark.parametrize("how", ["torch", "pickle", "garbage", "empty", "cut", "list"])
def test_nothing_but_plain_data_is_read(tmp_path, how):
    path = tmp_path / "last.pt"
    save_checkpoint(path, STATE)
    if how in ("torch", "list"):
        payload = io.BytesIO()
        torch.save({"step": Harmful()} if how == "torch" else [1, 2], payload)
        path.write_bytes(sealed(payload.getbuffer()))
    else:
        whole = path.read_bytes()
        path.write_bytes(
            {"pickle": pickle.dumps(Harmful()), "garbage": b"\x00" * 99, "empty": b"",
             "cut": whole[: len(whole) // 2]}[how]
        )  # fmt: skip
    with pytest.raises(ConfigError, match="start the run again") as error:
        load_checkpoint(path)
    assert "\n" not in str(error.value)


def test_a_missing_one_says_how_to_start(tmp_path):
    with pytest.raises(ConfigError, match="no such file; start the run without --resume"):
        load_checkpoint(tmp_path / "last.pt")


def test_one_flipped_bit_anywhere_is_noticed(tmp_path):
    path = tmp_path / "last.pt"
    save_checkpoint(path, STATE)
    whole = path.read_bytes()
    for bit in range(0, 8 * len(whole), 53):
        damaged = bytearray(whole)
        damaged[bit // 8] ^= 1 << bit % 8
        path.write_bytes(damaged)
        with pytest.raises(ConfigError, match=r"remove it and start the run again$") as error:
            load_checkpoint(path)
        assert "\n" not in str(error.value)


def test_one_without_a_checksum_is_of_an_older_version(tmp_path):
    torch.save(STATE, tmp_path / "last.pt")
    with pytest.raises(ConfigError, match=r"has no checksum, .* of an older version; remove it"):
        load_checkpoint(tmp_path / "last.pt")
