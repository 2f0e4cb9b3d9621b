"""The cache: what was made is found again, what is damaged is made anew, nothing depends on it."""

import logging
import os
import time
from pathlib import Path

import pytest

from hri_predict.base.machine.cache import KEPT, KEPT_S, cache_folder, cached, forget


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.setenv("HRI_PREDICT_CACHE", str(tmp_path / "kept"))
    return tmp_path / "kept"


class Made:
    def __init__(self):
        self.times = 0

    def __call__(self):
        self.times += 1
        return b"content"

    @staticmethod
    def fails(path):
        raise FileNotFoundError


def test_what_was_made_is_found_again(folder):
    make = Made()
    assert [cached("a", make) for _ in range(3)] == [b"content"] * 3
    assert make.times == 1
    forget("a")
    assert cached("a", make) == b"content"
    assert make.times == 2


def test_what_was_not_used_lately_is_removed_when_more_is_kept(folder, caplog):
    caplog.set_level(logging.DEBUG)
    names = [f"net-{n:032x}.onnx" for n in range(KEPT + 1)]
    other, own = f"other-{0:032x}.onnx", "notes.txt"
    for age_s, name in enumerate([other, own, *reversed(names[:-1])], 1):
        cached(name, Made())
        long_s = KEPT_S if name in (other, own) else 0.0
        os.utime(folder / name, times=(time.time() - age_s - long_s,) * 2)
    make = Made()
    cached(names[0], make)  # the oldest, now used
    cached(names[-1], make)
    assert make.times == 1
    assert {path.name for path in folder.iterdir()} == {own, names[0], *names[2:]}
    assert caplog.text.count("removed unused files: 1\n") == 2


def test_files_that_others_remove_meanwhile_do_not_matter(folder, monkeypatch):
    for n in range(KEPT):
        cached(f"net-{n:032x}.onnx", Made())
    for n, gone in enumerate(("lstat", "unlink", "iterdir"), KEPT):
        with monkeypatch.context() as patch:
            patch.setattr(Path, gone, Made.fails)
            assert cached(f"net-{n:032x}.onnx", Made()) == b"content"


@pytest.mark.parametrize(
    "damage", [lambda b: b[:-1], lambda b: b"", lambda b: b[:33] + b"X" + b[34:]]
)
def test_what_is_damaged_is_made_anew_and_told(folder, caplog, damage):
    make = Made()
    cached("a", make)
    (folder / "a").write_bytes(damage((folder / "a").read_bytes()))
    assert cached("a", make) == b"content"
    assert "damaged" in caplog.text
    assert cached("a", make) == b"content"
    assert make.times == 2


def test_a_file_under_another_name_is_made_anew(folder):
    make = Made()
    cached("a", lambda: b"another's")
    (folder / "a").rename(folder / "b")
    assert cached("b", make) == b"content"
    assert make.times == 1


@pytest.mark.skipif(not hasattr(os, "geteuid"), reason="files have no such owner here")
def test_a_file_of_another_user_is_made_anew(folder, monkeypatch, caplog):
    make = Made()
    cached("a", make)
    if os.geteuid() == 0:
        os.chown(folder / "a", 12345, -1)
    else:
        monkeypatch.setattr(os, "geteuid", lambda: 12345)
    assert cached("a", make) == b"content"
    assert make.times == 2
    assert "belongs to another user" in caplog.text


def test_a_file_of_root_is_read(folder, monkeypatch):
    make = Made()
    cached("a", make)
    if os.geteuid() != 0:
        pytest.skip("needs a file of root")
    monkeypatch.setattr(os, "geteuid", lambda: 12345)
    cached("a", make)
    assert make.times == 1


@pytest.mark.parametrize(
    "put",
    [
        os.mkfifo,
        lambda path: path.mkdir(),
        lambda path: os.truncate(os.open(path, os.O_CREAT | os.O_RDWR), 2**35),
    ],
    ids=["a pipe", "a folder", "a file of 32 GiB"],
)
def test_what_is_no_file_of_ours_is_never_read(folder, put):
    folder.mkdir()
    put(folder / "a")
    assert cached("a", Made()) == b"content"


@pytest.mark.parametrize("put", [os.mkfifo, lambda path: path.symlink_to("/etc/hostname")])
def test_nothing_is_written_through_a_pipe_or_link(folder, put):
    folder.mkdir()
    put(folder / "a.partial")
    before = Path("/etc/hostname").read_bytes()
    assert cached("a", Made()) == b"content"
    assert Path("/etc/hostname").read_bytes() == before


@pytest.mark.parametrize("named", ["", "/proc/no/such/folder", "/dev/null/x"])
def test_without_a_folder_that_can_be_written_nothing_is_kept_and_it_says_so(
    monkeypatch, caplog, named
):
    monkeypatch.setenv("HRI_PREDICT_CACHE", named)
    make = Made()
    assert cached("a", make) == cached("a", make) == b"content"
    assert make.times == 2
    forget("a")
    warned = [record.getMessage() for record in caplog.records]
    assert all("set HRI_PREDICT_CACHE to another folder" in line for line in warned)
    assert len(warned) == (2 if named else 0)  # no folder: as asked


def test_the_folder_is_the_own_one_or_the_service_s_or_the_user_s(monkeypatch, tmp_path):
    for name in ("HRI_PREDICT_CACHE", "CACHE_DIRECTORY", "XDG_CACHE_HOME"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv("HOME", "/home/somebody")
    assert str(cache_folder()) == "/home/somebody/.cache/hri-predict"
    monkeypatch.setenv("XDG_CACHE_HOME", "/xdg")
    assert str(cache_folder()) == "/xdg/hri-predict"
    monkeypatch.setenv("CACHE_DIRECTORY", "/var/cache/cell:/var/cache/other")
    assert str(cache_folder()) == "/var/cache/cell"
    monkeypatch.setenv("HRI_PREDICT_CACHE", "/own")
    assert str(cache_folder()) == "/own"
    monkeypatch.setenv("HRI_PREDICT_CACHE", "~/own")
    assert str(cache_folder()) == "/home/somebody/own"
