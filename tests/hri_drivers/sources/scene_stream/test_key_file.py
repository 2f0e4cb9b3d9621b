import logging
import os
import pickle
import subprocess
import sys

import pytest

from hri_drivers.sources.scene_stream.key_file import read_key
from hri_predict.base.errors import SourceError
from tests.hri_drivers.sources.scene_streaming import SECRET


@pytest.fixture
def file(tmp_path):
    path = tmp_path / "cell.key"
    path.write_bytes(SECRET + b"\n")
    path.chmod(0o600)
    return path


def test_white_space_at_the_ends_is_no_part_of_a_key(file, tmp_path):
    tag = read_key("cell.key", tmp_path).tag(b"data")
    file.write_bytes(b"  " + SECRET + b"\r\n")
    assert read_key("cell.key", tmp_path).fits(b"data", tag)
    assert len(tag) == 16


def test_the_tag_is_that_of_rfc_4231(file):
    """Test case 3 of RFC 4231, its key of 20 bytes of aa filled up: zeros do not change an HMAC."""
    file.write_bytes(b"\xaa" * 20 + bytes(12))
    tag = read_key(str(file)).tag(b"\xdd" * 50)
    assert tag.hex() == "773ea91e36800e46854db8ebd09181a7"


@pytest.mark.parametrize(
    ("content", "why"),
    [(b"short", "holds 5 bytes"), (b"", "holds 0 bytes"), (b"x" * 2000, "holds 1025 bytes")],
)
def test_a_key_of_a_wrong_length_is_refused_in_one_line(file, content, why):
    file.write_bytes(content)
    with pytest.raises(SourceError, match=why) as caught:
        read_key(str(file))
    assert "\n" not in str(caught.value)
    assert "token_hex" in str(caught.value)


@pytest.mark.skipif(os.name != "posix", reason="this system has no umask")
def test_the_command_in_the_remedy_makes_a_key_that_is_taken_without_a_warning(tmp_path, caplog):
    (tmp_path / "a key").write_bytes(b"short")
    with pytest.raises(SourceError) as caught:
        read_key(str(tmp_path / "a key"))
    (tmp_path / "a key").unlink()  # the file of the mistake keeps its own mode
    command = str(caught.value).partition("make one with: ")[2].replace("python", sys.executable)
    subprocess.run(command, shell=True, check=True)
    with caplog.at_level(logging.WARNING):
        read_key(str(tmp_path / "a key"))
    assert not caplog.records


@pytest.mark.parametrize("name", ["missing.key", ".", "a\0b"])
def test_a_file_that_cannot_be_read_is_refused_in_one_line(tmp_path, name):
    with pytest.raises(SourceError, match="cannot be read") as caught:
        read_key(name, tmp_path)
    assert caught.value.__suppress_context__


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="this system has no named pipes")
def test_a_pipe_is_refused_and_not_waited_for(tmp_path):
    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(SourceError, match="is a pipe, not a file; check the path"):
        read_key("pipe", tmp_path)


def test_others_who_may_read_it_are_warned_of(file, caplog):
    with caplog.at_level(logging.WARNING):
        read_key(str(file))
        assert not caplog.records
        file.chmod(0o644)
        read_key(str(file))
    assert "chmod 600" in caplog.text
    assert SECRET.decode() not in caplog.text


def test_a_key_does_not_show_its_secret(file):
    key = read_key(str(file))
    assert SECRET.decode() not in f"{key} {key!r} {vars(key).keys()}"
    with pytest.raises(TypeError, match="cannot be copied"):
        pickle.dumps(key)
