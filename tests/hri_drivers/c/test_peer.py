"""The C example at the other end of the real node's serial line, each a process of its own.

Nothing here asserts that anything is fast; the limits are those after which waiting is in vain.
"""

import os
import select
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path
from typing import IO, Any

import pytest
import yaml

from hri_predict.base.files import data_path
from hri_predict.node.presses import QUIET_S
from hri_sim.baseline_demo import BASELINE
from hri_sim.wires.pty import open_pty

pytestmark = pytest.mark.realtime
EXAMPLE = Path(__file__).resolve().parents[3] / "drivers" / "c" / "examples" / "serial.c"
WAIT_S = 90.0
# Patient, as the machine that runs this may be busy with other things.
SILENCE_MS, MAX_AGE_MS, TOLERATED = 600, 3000, 10_000
PERSON = [
    {
        "start": [4.5, 3.0],
        "script": [
            {"do": "wait", "seconds": 4.0},
            {"do": "walk", "to": [1.0, 0.1], "speed_m_s": 1.2},
            {"do": "wait", "seconds": 1.0},
            {"do": "walk", "to": [4.5, 3.0], "speed_m_s": 1.2},
            {"do": "wait", "seconds": 4.0},
        ],
    }
]


class NullModem(threading.Thread):
    """Two pseudo-terminals back to back; they outlive whoever has their other sides open."""

    def __init__(self) -> None:
        super().__init__(daemon=True)
        (self._a, self.node_port), (self._b, self.controller_port) = open_pty(), open_pty()
        ports = (self.node_port, self.controller_port)
        self._kept = [os.open(port, os.O_RDWR | os.O_NOCTTY) for port in ports]
        self._over = threading.Event()

    def run(self) -> None:
        while not self._over.is_set():
            for ready in select.select([self._a, self._b], [], [], 0.05)[0]:
                data = os.read(ready, 4096)
                other = self._b if ready == self._a else self._a
                if select.select([], [other], [], 0)[1]:  # a line waits for nobody
                    os.write(other, data)

    def close(self) -> None:
        self._over.set()
        self.join()
        for descriptor in (self._a, self._b, *self._kept):
            os.close(descriptor)


def configured(path: Path, port: str) -> Path:
    """The demo's cell with our controller on its serial line, and a person who comes and goes."""
    data = yaml.safe_load(data_path("demo.yaml").read_text(encoding="utf-8"))
    link = {"name": "drive", "kind": "serial", "port": port, "baudrate": 115_200}
    data["links"] = [link | {"silence_timeout_s": SILENCE_MS / 1000}]
    data["predictor"] = BASELINE
    data["source"]["people"] = PERSON
    data["people"] = {}  # nobody leaves, and with this delay the demo's exit is too close
    data["risk"] = {"mode": "iso"}
    data["alerts"] = {"terminal": False}
    path.write_text(yaml.safe_dump(data))
    return path


@pytest.mark.long
@pytest.mark.parametrize("build", ["sanitized"], indirect=True)
def test_the_c_example_hears_the_node_and_stops_when_it_dies(build: Any, tmp_path: Path) -> None:
    program = build(EXAMPLE)
    line = NullModem()
    line.start()
    config = configured(tmp_path / "node.yaml", line.node_port)
    arguments = [program, line.controller_port, SILENCE_MS, MAX_AGE_MS, TOLERATED]
    controller = subprocess.Popen([*map(str, arguments)], stdout=subprocess.PIPE, text=True)
    log = (tmp_path / "node.log").open("w")
    node = subprocess.Popen(
        [sys.executable, "-m", "hri_predict", "run", str(config)], stdout=log, stderr=log
    )
    heard: list[list[str]] = []  # after the time: level, speed, reason, verdict

    def read() -> None:
        assert controller.stdout is not None
        heard.extend(text.split(maxsplit=4)[1:] for text in controller.stdout)

    threading.Thread(target=read, daemon=True).start()

    def wait_for(condition: Any) -> None:
        end = time.monotonic() + WAIT_S
        while not condition():
            assert node.poll() in (None, -signal.SIGKILL), Path(log.name).read_text()
            assert controller.poll() is None
            assert time.monotonic() < end, f"{heard} {Path(log.name).read_text()}"
            time.sleep(0.02)

    try:
        for level in ("clear", "slow"):
            wait_for(lambda level=level: any(h[0] == level for h in heard))
        # a stop that the node asked for, with its reason, not a watchdog's
        wait_for(lambda: any(h[0] == "stop" and h[3] == "advice\n" for h in heard))
        wait_for(lambda: heard[-1][0] == "clear")
        node.kill()
        wait_for(lambda: heard[-1][0] == "stop" and heard[-1][3] == "silent\n")
    finally:
        for process in (node, controller):
            process.kill()
            process.wait()
        line.close()
        log.close()
    assert heard[0][:2] == ["stop", "0"]
    assert all((h[1] == "0") == (h[0] == "stop") for h in heard)


@pytest.mark.long
@pytest.mark.parametrize("build", ["sanitized"], indirect=True)
def test_the_c_example_acknowledges_when_enter_is_pressed(build: Any, tmp_path: Path) -> None:
    line = NullModem()
    line.start()
    config = configured(tmp_path / "node.yaml", line.node_port)
    data = yaml.safe_load(config.read_text())
    data["source"]["people"] = []
    data["risk"] = {"mode": "iso", "latch": ["start"]}
    config.write_text(yaml.safe_dump(data))
    arguments = [build(EXAMPLE), line.controller_port, SILENCE_MS, MAX_AGE_MS, TOLERATED]
    pipe = subprocess.PIPE
    controller = subprocess.Popen(
        [*map(str, arguments)], stdin=pipe, stdout=pipe, stderr=pipe, text=True, bufsize=1
    )
    node = subprocess.Popen(
        [sys.executable, "-m", "hri_predict", "run", str(config)],
        stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
    )  # fmt: skip

    def kill_both() -> None:
        node.kill()
        controller.kill()

    ended = threading.Timer(WAIT_S, kill_both)
    ended.start()
    try:
        assert controller.stdin is not None
        assert controller.stdout is not None
        assert controller.stderr is not None
        assert controller.stderr.readline().startswith("to acknowledge: ")
        assert not any(" clear " in said for said in heard_for(controller.stdout, QUIET_S + 1.0))
        controller.stdin.write("\n\n")  # a key that is held down is one press
        controller.stdin.flush()
        assert any(" clear " in said for said in controller.stdout)  # ends, or the timer ends it
    finally:
        ended.cancel()
        for process in (node, controller):
            process.kill()
            process.wait()
        line.close()


def heard_for(lines: IO[str], seconds: float) -> list[str]:
    """The lines of this time; the example writes each at once."""
    heard, end = [], time.monotonic() + seconds
    while (left := end - time.monotonic()) > 0:
        if select.select([lines], [], [], left)[0]:
            heard.append(lines.readline())
    return heard
