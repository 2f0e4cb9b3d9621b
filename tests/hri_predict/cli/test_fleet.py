"""``hri-predict fleet`` and three nodes in processes: late, cut off, healed, killed, stopped."""

import contextlib
import io
import json
import os
import queue
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from rich.console import Console

from hri_drivers.wires.transport import PipeEnd, pipe
from hri_predict.base.errors import ConfigError
from hri_predict.cli.fleet import FRAME_LINES, _table, _Watch, fleet
from hri_predict.operation.monitoring.fleet import CellRow, Fleet, RobotRow
from hri_predict.protocol.keyed import Keyed, KeyedSender
from hri_predict.protocol.messages import Level
from hri_predict.protocol.reasons import Reason
from tests.hri_predict.operation.monitoring.said import OURS, RUNNING
from tests.messages import make_advice
from tests.processes import hri_predict
from tests.waiting import free_port

PATIENCE_S = 90.0  # of a test that fails; a loaded machine takes its time to start seven processes

CELL = """
rate_hz: 10
source:
  kind: procedural
  room_from_source: {{xyz: [0, 0, 0], quaternion_xyzw: [0, 0, 0, 1]}}
  people: [{{start: [4.5, 0], script: [{{do: wait, seconds: 600}}]}}]
robots:
  - name: arm
    model: ur5e
    room_from_robot: {{xyz: [0, 0, 0], quaternion_xyzw: [0, 0, 0, 1]}}
    max_speed_m_s: 0.25
    motion: {{kind: state}}
links:
  - name: drive
    kind: serial
    baudrate: 921600
    simulate: {{role: drive, robot: arm, trajectory: pick_and_place, max_age_s: 0.5}}
  - {{name: fleet, kind: zenoh, site: plant, cell: {name}, connect: ['tcp/127.0.0.1:{port}']}}
"""


class Proxy:
    """A cable between nodes and the router: it can lose everything, or be cut."""

    def __init__(self, target: int) -> None:
        self._target = target
        self._through = threading.Event()
        self._through.set()
        self._ends: list[socket.socket] = []
        self._listener = socket.create_server(("127.0.0.1", 0))
        self.port = self._listener.getsockname()[1]
        threading.Thread(target=self._accept, daemon=True).start()

    def lose_all(self) -> None:
        """Connections stay, and nothing passes: as a network that fails without a word."""
        self._through.clear()

    def heal(self) -> None:
        """What was lost is lost; connections made from now on pass."""
        self.hang_up()
        self._through.set()

    def hang_up(self) -> None:
        for end in self._ends:
            with contextlib.suppress(OSError):
                end.shutdown(socket.SHUT_RDWR)
        self._ends.clear()

    def _accept(self) -> None:
        while True:
            near, _ = self._listener.accept()
            try:
                far = socket.create_connection(("127.0.0.1", self._target))
            except OSError:
                near.close()
                continue
            self._ends += [near, far]
            for pair in ((near, far), (far, near)):
                threading.Thread(target=self._pass, args=pair, daemon=True).start()

    def _pass(self, source: socket.socket, sink: socket.socket) -> None:
        with contextlib.suppress(OSError):
            while data := source.recv(65536):
                if self._through.is_set():
                    sink.sendall(data)
        for end in (source, sink):
            with contextlib.suppress(OSError):
                end.shutdown(socket.SHUT_RDWR)


class Watcher:
    """The lines that ``hri-predict fleet`` prints."""

    def __init__(self, process: "subprocess.Popen[str]") -> None:
        self._lines: queue.Queue[str] = queue.Queue()
        self._process = process
        threading.Thread(target=self._read, daemon=True).start()
        self.seen: list[dict[str, Any]] = []

    def _read(self) -> None:
        assert self._process.stdout is not None
        for line in self._process.stdout:
            self._lines.put(line)

    def until(self, condition: Callable[[dict[str, Any]], Any]) -> None:
        """Read line by line until ``condition`` holds of the cells by name."""
        while True:
            line = json.loads(self._lines.get(timeout=PATIENCE_S))
            cells = {c["cell"]: c for c in line["cells"]}
            self.seen.append(cells)
            if condition(cells):
                return
            assert len(self.seen) < PATIENCE_S, self.seen[-1]


def speaks(cell: dict[str, Any] | None) -> bool:
    return cell is not None and cell["state"] in ("running", "degraded") and bool(cell["robots"])


def is_silent(cell: dict[str, Any]) -> bool:
    assert [r["level"] for r in cell["robots"]] == ["silent"] or cell["state"] != "silent"
    return bool(cell["state"] == "silent" and cell["people"] is None)


def command(*arguments: str) -> "subprocess.Popen[str]":
    return subprocess.Popen(
        [sys.executable, "-m", "hri_predict", *arguments],
        stdout=subprocess.PIPE if arguments[0] == "fleet" else subprocess.DEVNULL,
        env=os.environ | {"OMP_NUM_THREADS": "1"},
        text=True,
    )


@pytest.fixture
def processes() -> Iterator[dict[str, "subprocess.Popen[str]"]]:
    running: dict[str, subprocess.Popen[str]] = {}
    yield running
    for process in running.values():
        process.terminate()
    for process in running.values():
        process.wait(30)


@pytest.mark.realtime
@pytest.mark.long
def test_three_nodes_late_cut_off_healed_killed_and_stopped(
    tmp_path: Path, processes: dict[str, "subprocess.Popen[str]"]
) -> None:
    router = free_port()
    proxy = Proxy(router)

    def start(name: str, port: int) -> None:
        file = tmp_path / f"{name}.yaml"
        file.write_text(CELL.format(name=name, port=port), encoding="utf-8")
        processes[name] = command("run", str(file), "--json")

    processes["fleet"] = command("fleet", "--listen", f"tcp/127.0.0.1:{router}", "--json")
    watcher = Watcher(processes["fleet"])
    start("one", router)
    start("two", router)
    watcher.until(lambda cells: speaks(cells.get("one")) and speaks(cells.get("two")))
    assert "three" not in watcher.seen[-1]

    start("three", proxy.port)  # joins late
    watcher.until(lambda cells: all(speaks(cells.get(name)) for name in ("one", "two", "three")))

    proxy.lose_all()
    watcher.until(lambda cells: is_silent(cells["three"]) and speaks(cells["one"]))
    proxy.heal()
    watcher.until(lambda cells: speaks(cells["three"]))

    os.kill(processes["one"].pid, signal.SIGKILL)
    watcher.until(lambda cells: is_silent(cells["one"]) and speaks(cells["three"]))
    processes["two"].terminate()
    watcher.until(lambda cells: is_silent(cells["two"]) and "stopped" in cells["two"]["why"])
    assert processes["two"].wait(30) == 0
    proxy.hang_up()


def test_what_does_not_fit_on_the_screen_is_no_worse_than_what_does() -> None:
    view, sender = Fleet(silent_s=1e3), KeyedSender()
    for i in range(9):
        level = Level.STOP if i == 7 else Level.CLEAR
        for message in (OURS, RUNNING, make_advice(level, Reason.PERSON_NEAR, age_s=0.0)):
            unit = sender.encode(message)
            view.take(Keyed(f"hri/plant/cell{i}/{unit.key}", unit.data), time.monotonic_ns())
            sender = KeyedSender()
    console = Console(width=120, record=True, file=io.StringIO())
    console.print(_Watch(NOBODY, view)._page(console, FRAME_LINES + 3))
    shown = console.export_text().splitlines()
    cells = [line.split()[0] for line in shown if "plant/" in line]
    assert cells == ["plant/cell7", "plant/cell0", "plant/cell1"]
    assert "and 6 more cells, none of them worse" in shown


NOBODY: PipeEnd[Keyed] = pipe()[0]
LONG = [
    CellRow(
        site="plant",
        cell=f"welding_station_{k}",
        state="degraded",
        why="input too old, or it comes too slowly",
        people=1,
        age_s=0.213,
        heard_s=0.1,
        robots=tuple(
            RobotRow(
                robot=i, level="unknown", reason="unknown", speed_limit_m_s=None, separation_m=None
            )
            for i in range(3)
        ),
        lost=12345,
        refused=0,
    )
    for k in range(9)
]


@pytest.mark.parametrize("width", [80, 120])
def test_long_texts_wrap_and_are_never_cut_off(width: int) -> None:
    console = Console(width=width, record=True, file=io.StringIO())
    console.print(_table(LONG[:1], console))
    shown = console.export_text()
    assert all(len(line) <= width for line in shown.splitlines())
    assert "…" not in shown
    words = shown.split()
    for word in ("2:UNKNOWN", "213", "ms", "0.1", "12345", *LONG[0].why.split()):
        assert word in words


def test_a_page_of_wrapped_rows_is_no_taller_than_the_screen(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    watch = _Watch(NOBODY, Fleet())
    monkeypatch.setattr(watch, "rows", LONG.copy)
    console = Console(width=80, record=True, file=io.StringIO())
    console.print(watch._page(console, 24))
    shown = console.export_text()
    cells = shown.count("degraded")
    assert 1 < cells < len(LONG)
    assert f"and {len(LONG) - cells} more cells, none of them worse" in shown
    assert len(shown.splitlines()) <= 24


@pytest.mark.parametrize(("waited_s", "state"), [(0.0, "running"), (0.6, "silent")])
def test_what_waited_to_be_read_is_as_old_as_it_is(waited_s: float, state: str) -> None:
    """A neighbour that floods the network keeps the messages of the others waiting."""
    watch, sender = _Watch(NOBODY, Fleet()), KeyedSender()
    heard_ns = time.monotonic_ns() - round(waited_s * 1e9)
    for message in (OURS, RUNNING):
        unit = sender.encode(message)
        watch._take(Keyed(f"hri/plant/press/{unit.key}", unit.data, heard_ns))
    assert watch.rows()[0].state == state


def test_nobody_to_connect_to_is_an_error_that_names_the_endpoint() -> None:
    end = f"tcp/127.0.0.1:{free_port()}"
    done = hri_predict("fleet", "--connect", end, "--seconds", "0.2", timeout=60)
    assert done.returncode == 2
    assert f"zenoh {end}: no answer; start the router or peer there" in done.stderr
    assert "no message from any cell yet" in done.stdout


@pytest.mark.parametrize("flag", ["seconds", "silent"])
@pytest.mark.parametrize("value", [0.0, -1.0, float("nan"), float("inf"), 1e300])
def test_times_that_no_clock_counts_are_refused(flag: str, value: float) -> None:
    asked: dict[str, Any] = {flag: value}
    with pytest.raises(ConfigError, match=f"--{flag} .*: give a number above 0, up to"):
        fleet(**asked)
