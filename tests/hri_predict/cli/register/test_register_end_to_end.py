"""The wizard in a terminal and the script, with a tracker that sends over UDP."""

import json
import os
import select
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from hri_predict.base.files import data_path
from hri_predict.run import config as configuration
from hri_sim.wires.ports import free_udp_port
from tests.hri_predict.cli.register.touching_sender import TRUTH
from tests.processes import hri_predict

pytestmark = [pytest.mark.realtime, pytest.mark.long]

HERE = Path(__file__).parent
POINTS = ["0.5,-0.6,0.8", "2.2,-0.5,0.9", "1.9,1.2,1.3", "0.6,1.1,0.6"]
MARKS = ["0.4,-0.8", "2.6,-0.8", "2.6,1.4"]


class Cell:
    """A configuration whose pose and axes are wrong, and a tracker that sends to it."""

    def __init__(self, folder: Path, how: str) -> None:
        self.port = free_udp_port()
        text = data_path("live_udp.yaml").read_text()
        text = text.replace("port: 47800", f"port: {self.port}")
        self.path = folder / "cell.yaml"
        self.path.write_text(text.replace("joint_map: canonical ", "joint_map: coco17 "))
        self._tracker = subprocess.Popen(
            [sys.executable, str(HERE / "touching_sender.py"), str(self.port), how],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )
        self.touch(POINTS[0])

    def touch(self, point: str, walk: bool = False) -> None:
        """Put the wrist (or the feet) at a point; returns when it is there."""
        assert self._tracker.stdin
        assert self._tracker.stdout
        words = point.split(",") + (["0", "walk"] if walk else [])
        self._tracker.stdin.write(" ".join(words) + "\n")
        self._tracker.stdin.flush()
        self._tracker.stdout.readline()

    def close(self) -> None:
        self._tracker.kill()
        self._tracker.communicate()


@pytest.fixture
def cell(tmp_path: Path, request: pytest.FixtureRequest) -> Iterator[Cell]:
    made = Cell(tmp_path, getattr(request, "param", "camera"))
    yield made
    made.close()


class Terminal:
    """``hri-predict`` in a pseudo-terminal, as a person sees it."""

    def __init__(self, *arguments: str) -> None:
        self._master, slave = os.openpty()
        self._process = subprocess.Popen(
            [sys.executable, "-m", "hri_predict", *arguments],
            stdin=slave,
            stdout=slave,
            stderr=slave,
            close_fds=True,
        )
        os.close(slave)
        self.text = ""
        self._read = 0

    def expect(self, words: str, seconds: float = 30.0) -> None:
        """Wait until the words are shown after those that were expected before."""
        end = time.monotonic() + seconds
        while words not in self.text[self._read :]:
            assert time.monotonic() < end, f"no {words!r} in: {self.text}"
            if select.select([self._master], [], [], 0.1)[0]:
                self.text += os.read(self._master, 65536).decode()
        self._read = self.text.index(words, self._read) + len(words)

    def answer(self, line: str) -> None:
        os.write(self._master, (line + "\n").encode())

    def end(self) -> int:
        """The exit status."""
        try:
            return self._process.wait(20)
        finally:
            self._process.kill()
            os.close(self._master)


def command(*arguments: str) -> subprocess.CompletedProcess[str]:
    return hri_predict(*arguments, stdin=subprocess.DEVNULL, timeout=60)


def off(found: np.ndarray) -> tuple[float, float]:
    """Degrees and metres between a pose and the truth, metres in the middle of the cell."""
    truth = TRUTH.matrix()
    turn = found[:3, :3] @ truth[:3, :3].T
    middle = np.linalg.inv(truth) @ [1.5, 0.3, 1.0, 1.0]
    degrees = np.degrees(np.arccos(np.clip((np.trace(turn) - 1) / 2, -1, 1)))
    return float(degrees), float(np.linalg.norm(((found - truth) @ middle)[:3]))


def test_the_wizard_finds_the_pose_and_writes_it(cell: Cell) -> None:
    before = cell.path.read_text()
    terminal = Terminal("register", str(cell.path), "--seconds", "1.5")
    for number, point in enumerate(POINTS, 1):
        terminal.expect(f"Point {number}: its x,y,z in the room")
        if number == 2:  # a slip is asked for again
            terminal.answer("2.2,-0.5")
            terminal.expect("give 3 numbers")
            terminal.expect("Point 2")
        terminal.answer(point)
        terminal.expect("touch it with r_wrist, keep still and press Enter:")
        cell.touch(point)
        terminal.answer("")
        terminal.expect("mm per axis")
    terminal.expect("empty when done")
    terminal.answer("")
    terminal.expect("Write it into")
    terminal.answer("y")
    terminal.expect("written; the old file is cell.yaml.before-register-1")
    assert terminal.end() == 0
    degrees, metres = off(configuration.load(cell.path).source.room_from_source.matrix())
    assert degrees < 2.0
    assert metres < 0.03
    assert (cell.path.parent / "cell.yaml.before-register-1").read_text() == before
    lines = zip(before.split("\n"), cell.path.read_text().split("\n"), strict=True)
    changed = [old for old, new in lines if old != new]
    assert [line.split(":")[0].strip() for line in changed] == ["room_from_source"]
    cell.touch("1.5,0.3,1.0")
    assert command("check", str(cell.path), "--touched", "1.5,0.3,1.0").returncode == 0
    assert "ok: bodies stand" in command("check", str(cell.path), "--listen", "2").stdout


def test_a_walked_l_gives_the_pose_too(cell: Cell) -> None:
    terminal = Terminal(
        "register", str(cell.path), "--walk", *(f"--point={mark}" for mark in MARKS), "--yes"
    )
    for mark in MARKS:
        terminal.expect("stand on it, keep still and press Enter:")
        cell.touch(mark, walk=True)
        terminal.answer("")
    terminal.expect("written")
    assert terminal.end() == 0
    degrees, metres = off(configuration.load(cell.path).source.room_from_source.matrix())
    assert degrees < 2.0
    assert metres < 0.06


def test_a_script_needs_no_answers_and_refuses_points_that_do_not_fit(cell: Cell) -> None:
    points = [f"--point={point}" for point in POINTS[:3]]
    done = command("register", str(cell.path), *points, "--every", "0.1", "--seconds", "1")
    assert done.returncode == 2  # the wrist stayed at the first point
    assert "the hand was seen in the same place each time" in done.stderr
    assert "before-register" not in "".join(os.listdir(cell.path.parent))


def test_with_nobody_sending_it_says_so_and_not_that_a_joint_is_missing(tmp_path: Path) -> None:
    cell = Cell(tmp_path, "camera")
    cell.close()
    points = [f"--point={point}" for point in POINTS[:3]]
    done = command("register", str(cell.path), *points, "--every", "0.1", "--seconds", "1")
    assert done.returncode == 2
    assert "no scene arrived: no sender" in done.stderr
    assert "r_hand" not in done.stderr
    done = command("register", str(cell.path), *points, "--every", "0.1", "--joint", "r_hand")
    assert "the joint map coco17 has no such joint" in done.stderr
    assert "r_wrist" in done.stderr


@pytest.mark.parametrize(
    ("cell", "remedy"),
    [("room", "axes: [x, y, z] in the joint map"), ("mirrored", "exchange left and right")],
    indirect=["cell"],
)
def test_listening_names_the_axes_that_would_be_right(cell: Cell, remedy: str) -> None:
    text = cell.path.read_text()
    if "mirrored" in remedy or "left" in remedy:
        pose = f"{{xyz: {TRUTH.xyz}, quaternion_xyzw: {TRUTH.quaternion_xyzw}}}"
        text = text.replace("{xyz: [0, 0, 0], quaternion_xyzw: [0, 0, 0, 1]}", pose, 1)
        cell.path.write_text(text)
    done = command("check", str(cell.path), "--listen", "2", "--json")
    assert done.returncode == 1
    found = json.loads(done.stdout)
    assert found["refused"]
    assert remedy in found["remedy"]
