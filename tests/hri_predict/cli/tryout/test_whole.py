"""``hri-predict try`` as a user runs it: all its processes, with the demo's person."""

import os
import re
import signal
import subprocess
import sys
import time
import urllib.request
from pathlib import Path

import pytest

pytest.importorskip("viser", reason="the extra viewer is not installed")
pytestmark = [pytest.mark.realtime, pytest.mark.long]
WAIT_S = 120.0
TRY = [sys.executable, "-m", "hri_predict", "try", "--no-browser"]


def started(tmp_path, *words):
    """Start it without a network: so no camera of this machine is used."""
    return subprocess.Popen(
        [*TRY, *words], cwd=tmp_path, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
        start_new_session=True, env=os.environ | {"HRI_PREDICT_DATA": "/nowhere"},
    )  # fmt: skip


def address(process) -> str:
    line = next(line for line in process.stderr if line.startswith("viewer: http://"))
    return line.split()[1]


def descendants(pid: int) -> set[int]:
    found = set()
    for task in Path(f"/proc/{pid}/task").glob("*"):
        for child in (task / "children").read_text().split():
            found |= {int(child)} | descendants(int(child))
    return found


def running(pids: set[int]) -> set[int]:
    return {pid for pid in pids if Path(f"/proc/{pid}").exists()}


def test_without_a_camera_it_runs_with_the_demos_person_and_ends_by_itself(tmp_path):
    process = started(tmp_path, "--seconds", "8", "--robot", "2,1,1.57")
    out, err = process.communicate(timeout=WAIT_S)
    assert process.returncode == 0, err
    notices = [line for line in err.splitlines() if line.startswith("no camera: ")]
    assert len(notices) == 1
    assert notices[0].endswith("; showing the demo's person instead")
    assert len([line for line in err.splitlines() if line.startswith("viewer: http://")]) == 1
    assert "Traceback" not in err
    assert int(re.findall(r"frames in *│ *(\d+)", out)[0]) > 0
    assert list(tmp_path.iterdir()) == []


def test_ctrl_c_ends_all_of_its_processes(tmp_path):
    process = started(tmp_path, "--person")
    try:
        url = address(process)
        opener = urllib.request.build_opener(urllib.request.ProxyHandler({}))
        with opener.open(url, timeout=WAIT_S) as page:
            assert b"<!doctype html>" in page.read(1000).lower()
        family = descendants(process.pid)
        end_s = time.monotonic() + WAIT_S
        while len(family) < 3:  # the view, whose page comes first, and two controllers
            assert time.monotonic() < end_s, family
            time.sleep(0.1)
            family = descendants(process.pid)
        os.kill(process.pid, signal.SIGINT)
        _, err = process.communicate(timeout=WAIT_S)
    finally:
        process.kill()
        process.wait()
    assert process.returncode == 0, err
    assert "Traceback" not in err
    end_s = time.monotonic() + WAIT_S
    while running(family):
        assert time.monotonic() < end_s, running(family)
        time.sleep(0.1)
