"""What a killed process leaves behind is removed by the next, and nothing else is."""

import signal
import subprocess
import sys

import pytest

from hri_sim.controllers.cell import PREFIX, PrivateFolder

OWNER = """
import sys
from hri_sim.controllers.cell import PrivateFolder
folder = PrivateFolder()
(folder.path / "port0").symlink_to("/dev/null")
print(folder.path, flush=True)
sys.stdin.read()
"""


@pytest.fixture(autouse=True)
def temporary(tmp_path, monkeypatch):
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))


def test_a_killed_owner_s_folder_is_removed_at_the_next_start_and_a_living_one_s_stays(tmp_path):
    with subprocess.Popen(
        [sys.executable, "-c", OWNER], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as owner:
        assert owner.stdout is not None
        left = owner.stdout.readline().strip()
        mine = PrivateFolder()
        assert {str(path) for path in tmp_path.iterdir()} == {left, str(mine.path)}
        owner.send_signal(signal.SIGKILL)
    other = PrivateFolder()
    assert set(tmp_path.iterdir()) == {mine.path, other.path}
    mine.remove()
    mine.remove()
    other.remove()
    assert list(tmp_path.iterdir()) == []


def test_what_has_no_lock_or_is_no_folder_of_ours_stays(tmp_path):
    (tmp_path / f"{PREFIX}young").mkdir()
    (tmp_path / "elsewhere").mkdir()
    (tmp_path / f"{PREFIX}link").symlink_to(tmp_path / "elsewhere")
    (tmp_path / f"{PREFIX}file").touch()
    before = set(tmp_path.iterdir())
    folder = PrivateFolder()
    folder.remove()
    assert set(tmp_path.iterdir()) == before
