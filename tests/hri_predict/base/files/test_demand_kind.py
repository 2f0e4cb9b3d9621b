"""A file is meant where a folder or a device is, or a folder where a file is: told before use."""

import os
from pathlib import Path

import pytest

from hri_predict.base.files import demand_kind


@pytest.fixture
def things(tmp_path):
    (tmp_path / "file").write_text("x")
    (tmp_path / "folder").mkdir()
    os.mkfifo(tmp_path / "pipe")
    return tmp_path


@pytest.mark.parametrize("name", ["file", "missing", "folder/missing", "no/such/folders"])
def test_a_file_or_what_can_become_one(things, name):
    demand_kind(things / name)


@pytest.mark.parametrize("name", ["folder", "missing", "no/such/folders"])
def test_a_folder_or_what_can_become_one(things, name):
    demand_kind(things / name, folder=True)


@pytest.mark.parametrize(
    ("name", "folder", "said"),
    [
        ("folder", False, "is a folder, not a file"),
        ("pipe", False, "is a pipe, not a file"),
        ("/dev/zero", False, "is a device, not a file"),
        ("file", True, "is a file, not a folder"),
        ("/dev/zero", True, "is a device, not a folder"),
        ("file/below/it", False, "file is a file, not a folder"),
    ],
)
def test_anything_else_is_named(things, name, folder, said):
    with pytest.raises(OSError, match=said):
        demand_kind(things / Path(name), folder=folder)
