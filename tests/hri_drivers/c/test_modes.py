"""Operating modes with a controller in C: it asks, the engine decides, and it obeys.

Each tick, the driver's RobotState goes through the node's receiver into the engine, and the advice
comes back, over every kind of link.
"""

import subprocess
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hri_predict.protocol.can import DEFAULT_BASE_ID, CanFrame, CanReceiver, CanSender
from hri_predict.protocol.messages import OperatingMode, RobotMode, RobotState
from hri_predict.protocol.reception import OURS
from hri_predict.protocol.serial import SerialReceiver, SerialSender
from hri_predict.robots.model import RobotSettings, load_robot
from hri_predict.robots.trajectory import load_trajectory
from tests.hri_predict.risk.engine_cell import ROBOT, SETTINGS, Cell

LINKS = ("classic", "fd", "serial")
AUTOMATIC, TEACH, RECOVERY, MUTED = OperatingMode
QUICK = SETTINGS.model_copy(update={"speed_rise_m_s2": 100.0, "mode": "iso"})
ALLOWED = {"teach": {}, "recovery": {}, "muting": {"max_s": 1}}
NEAR_M = 1.1  # from the base: half a metre in front of the arm
SETTLE = 8


class Cabinet:
    """The driver of the C library, and the engine behind one link."""

    def __init__(self, program: Path, link: str, modes: dict[str, Any]):
        data = {**ROBOT.model_dump(), "modes": modes}
        data["motion"] = {"kind": "state", "plan": "pick_and_place"}
        self.link, self.cell = link, Cell(QUICK, robot=RobotSettings.model_validate(data))
        self.sender: Any = SerialSender() if link == "serial" else CanSender(link == "fd")
        self.receiver: Any = SerialReceiver() if link == "serial" else CanReceiver(link == "fd")
        self.driver = subprocess.Popen(
            [program], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, bufsize=1
        )
        model = load_robot(ROBOT, None)
        self.path = load_trajectory("pick_and_place", model, None)
        self.phase_s, self.ms, self.echo = 1.8, 0, 0
        self.ask("init", LINKS.index(link), 0, DEFAULT_BASE_ID, 0, 150, 400, 0, 500, 0)
        self.hear(self.sender.encode(OURS))

    def say(self, *words: object) -> None:
        assert self.driver.stdin is not None
        self.driver.stdin.write(" ".join(map(str, words)) + "\n")

    def ask(self, *words: object) -> str:
        self.say(*words)
        assert self.driver.stdout is not None
        return self.driver.stdout.readline().strip()

    def hear(self, units: Any) -> None:
        for unit in [units] if isinstance(units, bytes) else units:
            number = unit.arbitration_id if isinstance(unit, CanFrame) else 0
            data = unit.data if isinstance(unit, CanFrame) else unit
            self.say("rx", number, data.hex())

    def tick(
        self, request: OperatingMode, mode: RobotMode, enabling: bool, rate: float = 0.0
    ) -> tuple[int, OperatingMode]:
        """One cycle: permitted speed in mm/s and the mode in force, by the C code."""
        self.ms += 40
        self.say("at", self.ms)
        self.phase_s += 0.04 * rate
        q, dq = self.path.at(self.phase_s)
        micro = [round(1e6 * v) for v in (*q, *(rate * dq))]
        said = self.ask("state", int(mode), len(q), *micro, int(request), int(enabling), 255, 0, 0)
        for message in self._messages(said):
            assert isinstance(message, RobotState)
            self.echo = message.counter
            self.cell.tracker.update(message, self.cell.now_ns)
        advice = self.cell.step(NEAR_M, report=False)
        self.hear(self.sender.encode(replace(advice, echo=self.echo, age_s=0.05)))
        speed = int(self.ask("ask").split()[0])
        return speed, OperatingMode(int(self.ask("mode").partition(":")[2]))

    def _messages(self, said: str) -> Iterator[Any]:
        for word in said.split():
            number, _, data = word.partition(":")
            unit: Any = bytes.fromhex(data)
            if self.link != "serial":
                unit = CanFrame(int(number, 16), unit, self.link == "fd")
            yield from self.receiver.feed(unit)

    def settle(self, request: OperatingMode, **changes: Any) -> tuple[int, OperatingMode]:
        manual = request is TEACH
        told = {"mode": RobotMode.MANUAL if manual else RobotMode.AUTOMATIC, "enabling": manual}
        for _ in range(SETTLE):
            answer = self.tick(request, **(told | changes))
        return answer


@pytest.fixture
def cabinet(build: Callable[..., Path]) -> Iterator[Callable[..., Cabinet]]:
    program = build(Path(__file__).with_name("driver.c"))
    made: list[Cabinet] = []

    def make(link: str, modes: dict[str, Any]) -> Cabinet:
        made.append(Cabinet(program, link, modes))
        return made[-1]

    yield make
    for each in made:
        each.driver.communicate("", timeout=10)


def arrive(cabinet: Cabinet) -> None:
    """It goes forwards along its plan, to where the person stops it."""
    while cabinet.phase_s < 1.9:
        cabinet.tick(AUTOMATIC, RobotMode.AUTOMATIC, False, rate=0.3)
    assert cabinet.settle(AUTOMATIC) == (0, AUTOMATIC)


@pytest.mark.parametrize("link", LINKS)
def test_each_mode_is_entered_used_and_left(cabinet: Callable[..., Cabinet], link: str) -> None:
    one = cabinet(link, ALLOWED)
    arrive(one)
    assert one.settle(TEACH) == (250, TEACH)
    assert one.tick(TEACH, RobotMode.MANUAL, False) == (0, AUTOMATIC)  # let go
    assert one.settle(AUTOMATIC) == (0, AUTOMATIC)
    assert one.settle(RECOVERY) == (100, RECOVERY)
    back = [one.tick(RECOVERY, RobotMode.AUTOMATIC, False, rate=-0.1) for _ in range(10)]
    assert set(back) == {(100, RECOVERY)}
    forwards = [one.tick(RECOVERY, RobotMode.AUTOMATIC, False, rate=0.1) for _ in range(3)]
    assert forwards[-1] == (0, AUTOMATIC)
    assert one.settle(AUTOMATIC) == (0, AUTOMATIC)
    assert one.settle(MUTED) == (1000, MUTED)
    muted = [one.tick(MUTED, RobotMode.AUTOMATIC, False) for _ in range(30)]
    assert muted[0] == (1000, MUTED)
    assert muted[-1] == (0, AUTOMATIC)  # its second is over, though the request is still there


@pytest.mark.parametrize("request_", [TEACH, RECOVERY, MUTED])
def test_by_default_each_is_refused(
    cabinet: Callable[..., Cabinet], request_: OperatingMode
) -> None:
    one = cabinet("serial", {})
    arrive(one)
    assert one.settle(request_) == (0, AUTOMATIC)
    assert " refused: modes." in one.cell.assessment.advices[0].detail


@pytest.mark.parametrize(
    ("request_", "changes"),
    [
        (TEACH, {"enabling": False}),
        (TEACH, {"mode": RobotMode.AUTOMATIC}),
        (RECOVERY, {"mode": RobotMode.MANUAL}),
        (MUTED, {"mode": RobotMode.MANUAL}),
    ],
)
def test_without_its_condition_each_is_refused(
    cabinet: Callable[..., Cabinet], request_: OperatingMode, changes: dict[str, Any]
) -> None:
    one = cabinet("classic", ALLOWED)
    arrive(one)
    assert one.settle(request_, **changes) == (0, AUTOMATIC)


def test_what_the_c_code_sends_is_all_that_the_node_hears(
    cabinet: Callable[..., Cabinet],
) -> None:
    one = cabinet("classic", ALLOWED)
    one.tick(TEACH, RobotMode.MANUAL, True)
    asked = one.cell.tracker.at(one.cell.now_ns).asked
    assert (asked.request, asked.enabling, asked.mode) == (TEACH, True, RobotMode.MANUAL)
    assert np.isfinite(one.cell.tracker.at(one.cell.now_ns).speed_m_s)
