"""Every worked example of PROTOCOL.md, decoded by all that can: Python, the C code, cantools."""

import re
import subprocess
from pathlib import Path
from typing import Any

import cantools
import pytest

from hri_predict.protocol import e2e
from hri_predict.protocol.can import DEFAULT_BASE_ID, CanFrame, CanReceiver, padded
from hri_predict.protocol.codec import encode_payloads
from hri_predict.protocol.definition import BY_TYPE, DEFINITIONS, needed_parts
from hri_predict.protocol.generate.dbc import FILES
from hri_predict.protocol.generate.examples import EXAMPLES
from hri_predict.protocol.messages import Acknowledge, Advice, Message, RobotState, Status
from hri_predict.protocol.serial import SerialReceiver

ROOT = Path(__file__).resolve().parents[3]
C = ROOT / "drivers" / "c"
LINKS = ("classic", "FD", "serial")
NODE = [m for m in EXAMPLES if BY_TYPE[type(m)].sender == "node"]
CONTROLLER = [m for m in EXAMPLES if BY_TYPE[type(m)].sender == "controller"]


class Example:
    """What the document prints of one message: units by kind of link, fields by signal."""

    def __init__(self, message: Message):
        text = (ROOT / "drivers" / "PROTOCOL.md").read_text(encoding="utf-8")
        name = type(message).__name__
        block = text.partition(f"<!-- table: {name} example -->")[2].partition("<!-- end -->")[0]
        units = re.findall(r"^\| (\w+)(?:, id `0x(\w+)`)? \| `([0-9A-F ]+)` \|$", block, re.M)
        self.units: dict[str, list[tuple[int, bytes]]] = {link: [] for link in LINKS}
        for link, number, data in units:
            self.units[link].append((int(number or "0", 16), bytes.fromhex(data)))
        self.classic = BY_TYPE[type(message)].classic
        rows = re.findall(r"^\| (\w+) \| \d[^|]*\| `16#([0-9A-F]+)` \| (.+) \|$", block, re.M)
        self.raw = {signal: int(raw, 16) for signal, raw, _ in rows}
        self.meaning = {signal: text for signal, _, text in rows}

    def links(self) -> list[str]:
        return [link for link in LINKS if self.units[link]]

    def frames(self, link: str) -> list[CanFrame]:
        return [CanFrame(number, data, link == "FD") for number, data in self.units[link]]


def ids(message: Message) -> str:
    return type(message).__name__


def test_there_is_an_example_of_every_message_in_every_encoding() -> None:
    assert {type(m) for m in EXAMPLES} == {d.type for d in DEFINITIONS}
    for message in EXAMPLES:
        example = Example(message)
        assert example.links() == list(LINKS if example.classic else LINKS[1:])
        definition = BY_TYPE[type(message)]
        needed = needed_parts(definition, encode_payloads(message)[0])
        assert len(example.units["classic"]) == (len(needed) if definition.classic else 0)
        assert set(example.raw) >= {f.signal for f in definition.fields}


@pytest.mark.parametrize("message", EXAMPLES, ids=ids)
def test_python_decodes_it(message: Message) -> None:
    example = Example(message)
    for link in example.links():
        receiver: Any = SerialReceiver() if link == "serial" else CanReceiver(link == "FD")
        if link == "serial":
            got = receiver.feed(example.units[link][0][1])
        else:
            got = [m for frame in example.frames(link) for m in receiver.feed(frame)]
        assert got == [message], link


@pytest.mark.parametrize("message", EXAMPLES, ids=ids)
def test_cantools_decodes_it(message: Message) -> None:
    example = Example(message)
    for fd, link in ((False, "classic"), (True, "FD")):
        database: Any = cantools.database.load_file(ROOT / "drivers" / "dbc" / FILES[fd])
        raw: dict[str, int] = {}
        named: dict[str, Any] = {}
        for frame in example.frames(link):
            what = database.get_message_by_frame_id(frame.arbitration_id)
            raw |= what.decode(frame.data, decode_choices=False, scaling=False)
            named |= what.decode(frame.data)
        assert raw.keys() >= example.raw.keys() or not fd
        for signal in example.raw.keys() & raw.keys():
            bits = max(8, 4 * len(f"{example.raw[signal]:X}"))
            assert raw[signal] & ((1 << bits) - 1) == example.raw[signal], signal
            meaning = example.meaning[signal].split()[0]
            if isinstance(named[signal], int | float):
                assert float(meaning) == pytest.approx(named[signal], rel=1e-5), signal
            else:
                assert meaning == str(named[signal]), signal


@pytest.mark.parametrize("message", NODE, ids=ids)
def test_the_c_code_decodes_it(build: Any, message: Message) -> None:
    program = build(C / "examples" / "decode.c")
    example = Example(message)
    for link in example.links():
        lines = [
            data.hex() if link == "serial" else f"{number:x} {data.hex()}"
            for number, data in example.units[link]
        ]
        done = subprocess.run(
            [program, link.lower(), "0", "7"],
            input="\n".join(lines) + "\n",
            capture_output=True,
            text=True,
            check=True,
        )
        *_, heard, counts = done.stdout.splitlines()
        kind, *pairs = heard.split()
        values = {k: int(v) for k, v in (pair.split("=") for pair in pairs)}
        assert kind == type(message).__name__
        assert values.pop("ROBOT", 1) == 1
        assert set(values) == set(example.raw)
        for signal, value in values.items():
            assert value & 0xFFFFFFFF in (example.raw[signal], example.raw[signal] | 0xFFFF0000)
        assert "crc_errors=0 counter_errors=0 malformed=0" in counts


def test_the_c_code_reads_values_that_nobody_knows_as_unknown(build: Any) -> None:
    program = build(C / "examples" / "decode.c")
    advice, status = bytes((77, 2)) + bytes(16), bytes((0x3F, 2)) + bytes(4)
    lines = ""
    for number, kind, payload in ((8, Advice, advice), (BY_TYPE[Status].number, Status, status)):
        data = e2e.protect_profile5(0, padded(BY_TYPE[kind], payload), e2e.data_id_16(number))
        lines += f"{DEFAULT_BASE_ID + number:x} {data.hex()}\n"
    done = subprocess.run([program, "fd", "1", "1"], input=lines, capture_output=True, text=True)
    advised, told, _ = done.stdout.splitlines()
    assert advised.startswith("Advice ROBOT=1 LEVEL=0 OPERATING_MODE=0 REASON=2 ")
    assert told.startswith("Status NODE_STATE=0 PEOPLE=3 ")


@pytest.mark.parametrize("link", ["classic", "fd"])
def test_the_c_code_reads_logs_of_candump(build: Any, link: str) -> None:
    program = build(C / "examples" / "decode.c")
    example = Example(next(m for m in NODE if isinstance(m, Advice)))
    units = example.units[link if link == "classic" else "FD"]
    plain = "".join(f"{number:x} {data.hex()}\n" for number, data in units)
    mark = "#" if link == "classic" else "##1"
    log = "".join(f"(1764.25) can0 {n:03X}{mark}{d.hex().upper()}\n" for n, d in units)
    python_can = log.replace("\n", " R\n")
    for text in (log, python_can):
        done, want = (
            subprocess.run([program, link, "0", "7"], input=lines, capture_output=True, text=True)
            for lines in (text, plain)
        )
        assert done.stderr == ""
        assert done.stdout == want.stdout
    assert "Advice ROBOT=1" in done.stdout


@pytest.mark.parametrize(
    ("link", "line"),
    [
        ("classic", "can0  680   [2]  00 11"),
        ("classic", "680 00 11"),
        ("classic", "(1764.25) can0 nonsense"),
        ("classic", "680 001"),
        ("serial", "no bytes"),
    ],
)
def test_the_c_code_names_lines_that_it_cannot_read(build: Any, link: str, line: str) -> None:
    program = build(C / "examples" / "decode.c")
    lines = f"\n{line}\n" if link == "serial" else f"680 00\n{line}\n"
    done = subprocess.run([program, link, "0", "0"], input=lines, capture_output=True, text=True)
    (said,) = done.stderr.splitlines()
    assert said.startswith("decode: line 2 cannot be read; give ")
    assert done.stdout.splitlines()[:2] == ["-", "-"]


@pytest.mark.parametrize("message", CONTROLLER, ids=ids)
def test_the_c_code_encodes_it(build: Any, message: Message) -> None:
    if isinstance(message, RobotState):
        micro = [round(1e6 * v) for v in (*message.positions, *message.velocities)]
        joints = len(message.positions)
        asked = (int(message.request), int(message.enabling), message.tool)
        base = message.base
        assert base is not None
        moved = (base.x_m, base.y_m, base.yaw_rad, base.vx_m_s, base.vy_m_s, base.yaw_rate_rad_s)
        more = (*asked, int(message.tool_confirmed), 1, *(round(1e6 * v) for v in moved))
        line = " ".join(map(str, ("state", int(message.mode), joints, *micro, *more)))
    else:
        assert isinstance(message, Acknowledge)
        line = f"ack {message.latch_id} {message.ack_id}"
    first = message.counter - 1 if isinstance(message, RobotState) else 0
    program = build(Path(__file__).with_name("driver.c"))
    for code, link in enumerate(LINKS):
        begin = f"init {code} 1 {DEFAULT_BASE_ID} 0 150 400 0 500 {first}"
        done = subprocess.run(
            [program], input=f"{begin}\n{line}\n", capture_output=True, text=True, check=True
        )
        ready, sent = done.stdout.splitlines()
        assert ready == "1"
        want = [f"{number:x}:{data.hex()}" for number, data in Example(message).units[link]]
        assert sent.split() == want, link


def test_the_serial_example_takes_the_line_s_rate(build: Any) -> None:
    program = build(C / "examples" / "serial.c")
    for port, said in (
        ("/dev/null,9600", "serial: give a rate of 115200, 230400, 460800 or 921600 bit/s"),
        ("/dev/gone,921600", "serial: /dev/gone cannot be opened: No such file or directory;"),
    ):
        done = subprocess.run([program, port], capture_output=True, text=True, timeout=10)
        assert (done.returncode, done.stderr.startswith(said)) == (2, True), done.stderr
