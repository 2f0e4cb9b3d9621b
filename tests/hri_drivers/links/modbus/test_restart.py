"""A supervised restart by a PLC in another process, at the node in a third."""

import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable

import pytest
import yaml

pytest.importorskip("pymodbus", reason="pymodbus is not installed: the link cannot be used")
from hri_predict.base.files import data_path
from hri_predict.node.presses import LONGEST_S, QUIET_S
from tests.hri_drivers.links.modbus.test_link import Plc

pytestmark = [pytest.mark.realtime, pytest.mark.long, pytest.mark.timeout(300)]
WAIT_S = 240.0
PATIENT_S = 2.0  # silence on a machine that is busy with other things must not stop the robot


def until(condition: Callable[[], bool], seconds: float) -> bool:
    """Whether something happens within a time."""
    deadline = time.monotonic() + seconds
    while not (found := condition()) and time.monotonic() < deadline:
        time.sleep(0.02)
    return found


class Cell:
    """The PLC's view of robot 0."""

    def __init__(self, plc: Plc) -> None:
        self.plc, self.ack_id = plc, 0

    @property
    def moves(self) -> bool:
        """Whether the robot may move."""
        return self.plc.robot()["LEVEL"] in (1, 2, 3)

    @property
    def latch_id(self) -> int:
        """The latch that is shown."""
        return self.plc.robot()["LATCH_ID"]

    def press(self) -> None:
        """The button goes down."""
        self.ack_id += 1
        self.plc.ask(write=[1001, [self.latch_id, 0, self.ack_id]])

    def release(self) -> None:
        """The button goes up."""
        self.plc.ask(write=[1001, [0, 0, self.ack_id]])


def test_the_robot_starts_when_the_button_is_released_and_not_while_it_is_held(tmp_path):
    data = yaml.safe_load(data_path("plant_modbus.yaml").read_text())
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = free.getsockname()[1]
    data["source"]["people"] = []
    del data["people"]
    data["risk"] = {
        "mode": "iso",
        "restart": "supervised",
        "limits": {"extend_beyond_horizon": True},
    }
    data["links"][0] |= {"port": port, "silence_timeout_s": PATIENT_S, "max_age_s": 5.0}
    config = tmp_path / "cell.yaml"
    config.write_text(yaml.safe_dump(data))
    said = tmp_path / "said"
    node = subprocess.Popen(
        [sys.executable, "-m", "hri_predict", "run", str(config)],
        stdout=subprocess.DEVNULL,
        stderr=said.open("w"),
    )
    plc = Plc(port)

    def end() -> None:
        node.kill()
        plc.kill()

    ends = threading.Timer(WAIT_S, end)
    ends.start()
    try:
        cell = Cell(plc)
        assert until(lambda: "words" in plc.ask(read=[0, 1]), 60.0), said.read_text()
        assert until(lambda: cell.latch_id > 0, 30.0)
        time.sleep(QUIET_S + 1.0)  # the node has seen the button released
        cell.press()
        assert not until(lambda: cell.moves, LONGEST_S + 1.0)  # stuck
        cell.release()
        assert not until(lambda: cell.moves, 1.0)
        for _ in range(5):  # a busy machine may deliver a release too late: press again
            time.sleep(QUIET_S + 1.0)
            cell.press()
            time.sleep(0.5)
            assert not cell.moves
            cell.release()
            if until(lambda: cell.moves, 5.0):
                break
        assert cell.moves
    finally:
        ends.cancel()
        for process in (node, plc):
            process.kill()
