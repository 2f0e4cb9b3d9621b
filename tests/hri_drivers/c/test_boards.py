"""The examples for STM32 and Arduino, run on this machine: stubs stand for the HAL and the core.

Frames come from the node's own senders, and what the board sends goes to the node's receivers.
"""

import shutil
import subprocess
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest

from hri_predict.protocol.can import CanFrame, CanReceiver, CanSender
from hri_predict.protocol.definition import SCHEMA_HASH, SCHEMA_VERSION
from hri_predict.protocol.messages import (
    Acknowledge,
    Advice,
    Level,
    Message,
    RobotMode,
    RobotState,
    Schema,
)
from hri_predict.protocol.reasons import Reason
from hri_predict.protocol.reception import OURS
from hri_predict.protocol.serial import SerialReceiver, SerialSender
from tests.messages import make_advice

C = Path(__file__).resolve().parents[3] / "drivers" / "c"
STM32, ARDUINO = C / "examples" / "stm32", C / "examples" / "arduino"
STUBS = Path(__file__).with_name("boards")
STRICT = ["-Wall", "-Wextra", "-Werror", "-pedantic"]
SANITIZERS = ["-g", "-O1", "-fsanitize=address,undefined", "-fno-sanitize-recover=all"]
SLOW = make_advice(
    Level.SLOW, Reason.PERSON_APPROACHING, latch_id=9, speed_limit_m_s=0.75, age_s=0.02
)


@dataclass(frozen=True)
class Kind:
    """One example: its source, the link that it speaks, and what it is compiled with."""

    source: Path
    link: str
    options: tuple[str, ...] = ()

    @property
    def stm32(self) -> bool:
        return self.source.suffix == ".c"


KINDS = {
    "bxcan": Kind(STM32 / "hri_can.c", "classic", ("-DHAL_CAN_MODULE_ENABLED",)),
    "fdcan": Kind(STM32 / "hri_can.c", "FD", ("-DHAL_FDCAN_MODULE_ENABLED",)),
    "fdcan-h7": Kind(
        STM32 / "hri_can.c", "FD", ("-DHAL_FDCAN_MODULE_ENABLED", "-DHRI_TEST_SHIFTED_DLC")
    ),
    "uart": Kind(STM32 / "hri_uart.c", "serial", ("-DHAL_UART_MODULE_ENABLED",)),
    "twai": Kind(ARDUINO / "hri_twai" / "hri_twai.ino", "classic"),
    "serial1": Kind(ARDUINO / "hri_serial" / "hri_serial.ino", "serial"),
}


def run(*command: object) -> None:
    done = subprocess.run([*map(str, command)], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


def found(name: str) -> str:
    path = shutil.which(name)
    if path is None:
        pytest.skip(f"no {name} here")
    return path


def compiled(kind: Kind, folder: Path, prefix: str, *flags: str) -> list[Path]:
    """Objects of an example with its stubs, strictly; C as C, sketches as C++."""
    out = folder / f"{kind.source.stem}.o"
    stubs = STUBS / ("stm32" if kind.stm32 else "arduino")
    includes = [f"-I{C}", f"-I{STM32}", "-isystem", str(stubs)]
    language = (
        [found(prefix + "gcc"), "-std=c99", "-Wconversion"]
        if kind.stm32
        else [found(prefix + "g++"), "-std=c++11", "-x", "c++", "-include", "Arduino.h"]
    )
    run(*language, *STRICT, *includes, *kind.options, *flags, "-c", "-o", out, kind.source)
    return [out]


@pytest.fixture(scope="module")
def programs(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], Path]:
    """Builds an example for this machine, once."""
    folder = tmp_path_factory.mktemp("boards")
    library: list[Path] = []
    built: dict[str, Path] = {}

    def build(name: str) -> Path:
        if name in built:
            return built[name]
        kind, cc = KINDS[name], found("gcc")
        if not library:
            for source in sorted(C.glob("*.c")):
                library.append(folder / f"{source.stem}.o")
                run(cc, "-std=c99", *SANITIZERS, "-c", "-o", library[-1], source)
        objects = compiled(kind, folder, "", *SANITIZERS)
        board = STUBS / ("stm32/board.c" if kind.stm32 else "arduino/board.cpp")
        includes = [f"-I{C}", f"-I{STM32}", f"-I{board.parent}"]
        built[name] = folder / name
        compiler = [cc, "-std=c99"] if kind.stm32 else [found("g++"), "-std=c++11"]
        more = [*includes, *kind.options, *SANITIZERS, "-o", built[name]]
        run(*compiler, *more, board, *objects, *library)
        return built[name]

    return build


class Board:
    """A running example, a node's end of its wire, and the clock of both."""

    def __init__(self, program: Path, kind: Kind):
        self.kind, self.ms, self.verdict, self.lost = kind, 100, "", 0
        self.receiver: Any = SerialReceiver()
        self.sender: Any = SerialSender()
        if kind.link != "serial":
            self.receiver = CanReceiver(kind.link == "FD")
            self.sender = CanSender(kind.link == "FD")
        self.heard: list[Message] = []
        self._child = subprocess.Popen(
            [program], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, bufsize=1
        )

    def tell(self, line: str) -> None:
        assert self._child.stdin is not None
        self._child.stdin.write(line + "\n")

    def cycle(self, times: int = 1, step_ms: int = 1) -> int:
        """Let the board work; its last permitted speed (of a sketch: 1 if its relay is closed)."""
        assert self._child.stdout is not None
        for _ in range(times):
            self.ms += step_ms
            self.tell(f"at {self.ms}")
            self.tell("cycle")
            _, *units = self._child.stdout.readline().split()
            for unit in units:
                number, _, data = unit.partition(":")
                got = bytes.fromhex(data)
                frame = CanFrame(int(number, 16), got, self.kind.link == "FD")
                self.heard += self.receiver.feed(got if self.kind.link == "serial" else frame)
            speed, lost, *verdict = self._child.stdout.readline().split()
            self.lost, self.verdict = int(lost), " ".join(verdict)
        return int(speed)

    @property
    def counter(self) -> int:
        """Of the newest RobotState that the node heard."""
        return next(m.counter for m in reversed(self.heard) if isinstance(m, RobotState))

    def wire(self, message: Message) -> list[tuple[int, bytes]]:
        if isinstance(message, Advice):
            message = replace(message, echo=self.counter)
        units = self.sender.encode(message)
        if self.kind.link == "serial":
            return [(0, units)]
        return [(f.arbitration_id, f.data) for f in units]

    def say(self, *messages: Message, spoil: bool = False) -> int:
        """What the node says; the permitted speed afterwards."""
        for message in messages:
            for number, data in self.wire(message):
                last = data[-2] ^ 1 or 3  # no 0, which would end a frame of the serial line
                sent = data[:-2] + bytes([last]) + data[-1:] if spoil else data
                self.tell(f"rx {number:x} {sent.hex()}")
        return self.cycle()

    def begin(self) -> "Board":
        """Until the robot may move."""
        self.cycle(4)
        assert self.verdict == "no schema"
        assert self.say(OURS, SLOW) == self.moving
        return self

    @property
    def moving(self) -> int:
        return 750 if self.kind.stm32 else 1

    def close(self) -> None:
        assert self._child.stdin is not None
        self._child.stdin.close()
        assert self._child.wait(20) == 0
        assert self._child.stdout is not None
        self._child.stdout.close()


@pytest.fixture(params=KINDS)
def board(request: pytest.FixtureRequest, programs: Callable[[str], Path]) -> Iterator[Board]:
    running = Board(programs(request.param), KINDS[request.param])
    yield running
    running.close()


def test_it_sends_its_state_steadily_and_obeys_the_advice(board: Board) -> None:
    board.begin()
    for _ in range(10):
        assert board.cycle(20) == board.moving
        assert board.say(SLOW) == board.moving
    states = [m for m in board.heard if isinstance(m, RobotState)]
    counters = [m.counter for m in states]
    assert len(states) == 11  # at 50 Hz for 215 ms
    assert all((b - a) % 65536 == 1 for a, b in pairwise(counters))
    assert {(m.mode, len(m.positions), m.tool) for m in states} == {(RobotMode.AUTOMATIC, 6, None)}
    assert board.say(replace(SLOW, level=Level.STOP)) == 0
    assert board.verdict == "advice"
    assert board.lost == 0


def test_it_stops_on_silence(board: Board) -> None:
    board.begin()
    assert board.cycle(59) == board.moving
    assert board.cycle() == 0
    assert board.verdict == "silent"


def test_it_stops_on_a_wrong_crc_until_the_errors_are_over(board: Board) -> None:
    board.begin()
    assert board.say(SLOW, spoil=True) == 0
    assert board.verdict == "errors"
    board.cycle(10)
    assert board.say(SLOW) == 0
    for _ in range(30):
        board.cycle(20)
        board.say(SLOW)
    assert board.say(SLOW) == board.moving


@pytest.mark.parametrize(
    "schema", [Schema(SCHEMA_VERSION + 1, SCHEMA_HASH), Schema(SCHEMA_VERSION, SCHEMA_HASH ^ 1)]
)
def test_it_stops_on_another_schema(board: Board, schema: Schema) -> None:
    board.begin()
    assert board.say(schema, SLOW) == 0
    assert board.verdict == "other schema"


def test_it_acknowledges_the_latch_of_the_newest_advice(board: Board) -> None:
    board.begin()
    board.tell("press 77")
    board.cycle(100)
    acks = [m for m in board.heard if isinstance(m, Acknowledge)]
    assert len(acks) == 3
    assert {ack.latch_id for ack in acks} == {9}
    assert len({ack.ack_id for ack in acks}) == 1
    assert acks[0].ack_id != 0
    assert len([m for m in board.heard if isinstance(m, RobotState)]) == 6
    board.tell("free")
    board.cycle()
    board.tell("press 78")
    board.cycle(100)
    ids = [m.ack_id for m in board.heard if isinstance(m, Acknowledge) and m.latch_id]
    assert len(ids) == 6
    assert ids[3] != ids[0]


def test_it_reports_that_the_button_was_released(board: Board) -> None:
    board.begin()
    board.tell("up")
    board.cycle(100)
    board.tell("press 77")
    board.cycle(100)
    board.tell("up")
    board.cycle(100)
    board.tell("up")
    board.cycle(100)
    acks = [m for m in board.heard if isinstance(m, Acknowledge)]
    assert [ack.latch_id for ack in acks] == [9, 9, 9, 0, 0, 0]
    assert len({ack.ack_id for ack in acks}) == 1


@pytest.mark.parametrize("name", [name for name, kind in KINDS.items() if not kind.stm32])
def test_a_contact_that_bounces_is_one_press(name: str, programs: Callable[[str], Path]) -> None:
    board = Board(programs(name), KINDS[name]).begin()
    for edges in (("press 77", "up", "press 77"), ("up", "press 78", "up")):
        for edge in edges:
            board.tell(edge)
            board.cycle(3)
        board.cycle(120)
    acks = [m for m in board.heard if isinstance(m, Acknowledge)]
    assert [ack.latch_id for ack in acks] == [9, 9, 9, 0, 0, 0]
    assert len({ack.ack_id for ack in acks}) == 1


@pytest.mark.parametrize("name", [name for name, kind in KINDS.items() if kind.stm32])
def test_a_blocked_line_costs_old_states_and_is_counted(
    name: str, programs: Callable[[str], Path]
) -> None:
    board = Board(programs(name), KINDS[name]).begin()
    board.tell("full")
    board.cycle(100)
    assert board.lost > 0
    lost, before = board.lost, board.counter
    board.tell("free")
    board.cycle(80)  # the node takes the third in a row after so long a gap
    assert (board.counter - before) % 65536 >= 6
    assert board.say(SLOW) in (0, 750)
    assert board.lost - lost <= 5  # what had waited
    board.close()


def test_a_uart_goes_on_after_a_line_error(programs: Callable[[str], Path]) -> None:
    board = Board(programs("uart"), KINDS["uart"]).begin()
    ((_, data),) = board.wire(SLOW)
    board.tell(f"rx 0 {data[:11].hex()}")
    board.tell("error")
    assert board.cycle() == board.moving
    assert board.lost == 1
    assert board.say(SLOW) == 0  # the message before is missing
    for _ in range(40):
        board.cycle(20)
        board.say(SLOW)
    assert board.say(SLOW) == 750
    board.close()


def test_a_twai_bus_that_was_off_comes_back(programs: Callable[[str], Path]) -> None:
    board = Board(programs("twai"), KINDS["twai"]).begin()
    before = len(board.heard)
    board.tell("state 2")
    board.cycle(100)
    assert len(board.heard) > before
    board.close()


@pytest.mark.parametrize("name", KINDS)
def test_a_compiler_for_cortex_m_takes_it(name: str, tmp_path: Path) -> None:
    flags = ["-mcpu=cortex-m4", "-mthumb", "-Os", "-ffunction-sections"]
    compiled(KINDS[name], tmp_path, "arm-none-eabi-", *flags)


def test_a_compiler_for_cortex_m_takes_the_library(tmp_path: Path) -> None:
    cc = found("arm-none-eabi-gcc")
    flags = ["-std=c99", *STRICT, "-Wconversion", "-mcpu=cortex-m0", "-mthumb", "-Os"]
    for source in sorted(C.glob("*.c")):
        run(cc, *flags, "-c", "-o", tmp_path / f"{source.stem}.o", source)
