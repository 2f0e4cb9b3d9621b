"""The command line in real time, in processes of its own, as a user runs it.

Nothing here asserts that anything is fast; the limits are those after which waiting is in vain.
"""

import contextlib
import json
import os
import re
import select
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path
from typing import Any

import pytest
import yaml

from hri_predict.base.clock import MonotonicClock
from hri_predict.base.files import data_path
from hri_predict.run import config as configuration
from hri_sim.baseline_demo import BASELINE
from hri_sim.controllers.cell import MockCell
from hri_sim.fault_table.node_death import write_config
from hri_sim.wires.pty import open_pty
from tests.processes import hri_predict

pytestmark = pytest.mark.realtime
WAIT_S = 60.0
HRI_PREDICT = [sys.executable, "-m", "hri_predict"]
FAR = [{"start": [4.0, 3.0], "script": [{"do": "wait", "seconds": 60.0}]}]


@contextlib.contextmanager
def started(*arguments, **options):
    process = subprocess.Popen(
        [*HRI_PREDICT, *map(str, arguments)],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True,
        **options,
    )  # fmt: skip
    try:
        yield process
    finally:
        if process.poll() is None:
            process.kill()
        process.communicate()


def wait_for(condition, *processes):
    end = time.monotonic() + WAIT_S
    while not condition():
        for process in processes:
            assert process.poll() is None, process.communicate()[1]
        assert time.monotonic() < end, "waited in vain"
        time.sleep(0.01)


@pytest.fixture
def cell():
    """The demo's mock controllers, with nobody to advise them yet."""
    demo = configuration.load(data_path("demo.yaml"))
    cell: Any = MockCell(
        links=demo.links, robots=demo.node.robots, base_dir=demo.base_dir, clock=MonotonicClock()
    )
    cell.links = demo.links
    cell.ports = cell.start()
    yield cell
    cell.stop()


def moves(cell):
    now_ns = MonotonicClock().now_ns()
    return all(cell.permit(link.name, now_ns) > 0 for link in cell.links)


def demo():
    """The demo's configuration with a predictor that starts at once."""
    return yaml.safe_load(data_path("demo.yaml").read_text(encoding="utf-8")) | {
        "predictor": BASELINE
    }


def test_run_for_a_while(tmp_path):
    """The demo: two controllers in processes of their own, real lines between."""
    data = demo() | {"alerts": {"file": "alerts.jsonl"}}
    (tmp_path / "cell.yaml").write_text(yaml.safe_dump(data))
    done = hri_predict(
        *("run", tmp_path / "cell.yaml", "--duration", "4", "--json"),
        *("--record", tmp_path / "a.mcap"),
        timeout=WAIT_S,
    )
    assert done.returncode == 0, done.stderr
    summary = json.loads(done.stdout)
    assert 50 <= summary["ticks"] <= 100
    assert summary["frames_in"] > 0
    assert [link["name"] for link in summary["links"]] == ["drive", "monitor"]
    for link in summary["links"]:
        assert link["messages"] > 2 * 50
        assert link["bytes"] > 1000
        assert link["received"] > 50
        assert link["crc_errors"] == link["malformed"] == 0
    assert summary["contacts"] == summary["contacts_standing"] == 0
    for controller in summary["controllers"]:
        assert controller["ended"] == "ok"
        assert controller["messages"] > 50
        assert controller["crc_errors"] == controller["malformed"] == 0
    alerts = [json.loads(line) for line in (tmp_path / "alerts.jsonl").read_text().splitlines()]
    assert (alerts[0]["was"], alerts[0]["level"]) == ("none", "unknown")
    assert alerts[-1]["reason"] == "the node is stopping"
    # "still": only the reason changed; "before": changes held back while the level alternates
    told = [line for line in done.stderr.splitlines() if re.search(r" -> |\] still ", line)]
    held = [re.search(r"; (\d+) more changes? before$", line) for line in told]
    assert sum(1 + int(found[1]) if found else 1 for found in held) == len(alerts)
    assert (tmp_path / "a.mcap").stat().st_size > 10_000


@pytest.mark.parametrize(
    "number", [signal.SIGTERM, pytest.param(signal.SIGINT, marks=pytest.mark.long)]
)
def test_a_signal_ends_the_node_and_the_controllers_are_told(cell, tmp_path, number):
    config = write_config(tmp_path / "node.yaml", cell.links, cell.ports, FAR)
    with started("run", config, "--json") as node:
        wait_for(lambda: moves(cell), node)
        node.send_signal(number)
        out, err = node.communicate(timeout=3.0)
    assert node.returncode == 0, err
    assert json.loads(out)["node_state"] == "stopping"
    assert "Traceback" not in err
    for report in cell.stop():
        assert report.events[-1][2] == 0.0
        # told, not left to find out: an advice of "unknown", and no silence before the stop
        assert report.events[-1][1] == "unknown"
        assert report.crc_errors == 0


def test_a_signal_while_the_cell_starts_ends_it_cleanly(tmp_path):
    (tmp_path / "cell.yaml").write_text(yaml.safe_dump(demo()))
    with started("run", tmp_path / "cell.yaml", "--json") as node:
        children = Path(f"/proc/{node.pid}/task/{node.pid}/children")
        wait_for(lambda: children.read_text().strip(), node)  # the mock controllers come up
        node.send_signal(signal.SIGTERM)
        out, err = node.communicate(timeout=WAIT_S)
    assert node.returncode == 0, err
    assert json.loads(out)["node_state"] == "stopping"


class Relay(threading.Thread):
    """Two pseudo-terminals back to back: a line with a serial port at each of its ends."""

    def __init__(self):
        super().__init__(daemon=True)
        (self._a, self.port_a), (self._b, self.port_b) = open_pty(), open_pty()
        # kept open: a pseudo-terminal that nobody has open is an error to its master
        self._kept = [os.open(port, os.O_RDWR | os.O_NOCTTY) for port in (self.port_a, self.port_b)]
        self._over = threading.Event()
        self.start()

    def run(self):
        while not self._over.is_set():
            for ready in select.select([self._a, self._b], [], [], 0.05)[0]:
                data = os.read(ready, 4096)
                other = self._b if ready == self._a else self._a
                if select.select([], [other], [], 0)[1]:  # a line waits for nobody
                    os.write(other, data)

    def close(self):
        self._over.set()
        self.join()
        for descriptor in (self._a, self._b, *self._kept):
            os.close(descriptor)


@pytest.fixture
def line():
    relay = Relay()
    yield relay
    relay.close()


def serial_config(path, port):
    data = demo()
    data["links"] = [{"name": "drive", "kind": "serial", "port": port}]
    data["robots"][0]["motion"] = {"kind": "trajectory", "file": "pick_and_place"}
    data["source"]["people"] = FAR
    data["alerts"] = {"terminal": False}
    path.write_text(yaml.safe_dump(data))
    return path


def heard(listener):
    """Lines that the listener printed, in a list that grows."""
    lines: list[dict[str, Any]] = []

    def read():
        lines.extend(json.loads(text) for text in listener.stdout)

    threading.Thread(target=read, daemon=True).start()
    return lines


def test_listen_hears_the_node_from_its_start_to_its_end(line, tmp_path):
    config = serial_config(tmp_path / "node.yaml", line.port_a)
    with started("listen", f"serial:{line.port_b}", "--json", bufsize=1) as listener:
        lines = heard(listener)
        wait_for(lambda: any(x["message"] == "silent" for x in lines), listener)
        with started("run", config) as node:
            # not for "clear": a node that is not given the processor in time never says so
            told = {"advice", "status", "schema", "zone", "pose"}
            wait_for(lambda: told <= {x["message"] for x in lines}, node, listener)
            node.send_signal(signal.SIGTERM)
            assert node.wait(WAIT_S) == 0
        stopping = ("status", "stopping")
        wait_for(lambda: stopping in [(x["message"], x.get("node_state")) for x in lines], listener)
        listener.send_signal(signal.SIGINT)  # as Ctrl-C does
        assert listener.wait(WAIT_S) in (0, 130)
        wait_for(lambda: lines[-1]["message"] == "counters")
    kinds = [x["message"] for x in lines]
    assert {*told, "silent", "counters"} <= set(kinds)
    assert all(x["matches"] for x in lines if x["message"] == "schema")
    advice = [x for x in lines if x["message"] == "advice"]
    assert advice[0]["level"] == "unknown"  # its Schema may come after it
    assert (advice[-1]["level"], advice[-1]["reason"]) == ("unknown", "stopping")
    assert all(x["age_s"] < 0.5 for x in advice if x["level"] == "clear")
    zone = next(x for x in lines if x["message"] == "zone")
    assert {"segment", "a", "b", "radius"} == set(zone["capsules"][0])
    assert lines[-1]["crc_errors"] == lines[-1]["malformed"] == 0
    assert lines[-1]["received"] == sum(kind in told for kind in kinds)


@pytest.mark.long
def test_listen_for_alerts_alone(line, tmp_path):
    config = serial_config(tmp_path / "node.yaml", line.port_a)
    with started("run", config) as node:
        listening = hri_predict(
            "listen", f"serial:{line.port_b}", "--alerts", "--seconds", "12", timeout=WAIT_S
        )
        assert node.poll() is None
    assert listening.returncode == 0
    advice = [x for x in listening.stdout.splitlines() if "  advice " in x]
    assert advice
    assert len(advice) < 20  # changes alone, not 25 a second
    assert not any("  zone " in x or "  pose " in x for x in listening.stdout.splitlines())


def test_a_reader_that_goes_away_is_no_failure(tmp_path):
    """``hri-predict predictors | head -1``: the pipe breaks, nothing is said about it."""
    head = subprocess.run(
        f"{sys.executable} -m hri_predict --help | true",
        shell=True, capture_output=True, text=True, timeout=WAIT_S,
    )  # fmt: skip
    assert "Traceback" not in head.stderr
