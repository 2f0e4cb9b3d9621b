"""cantools, the C code and ``hri-predict listen`` on the same random messages.

Not a test itself: ``python agree.py --messages 100000`` prints on how many messages of each kind of
link all agree, and fails at the first on which they do not. What the node sends, the C code
decodes; what the controller sends, it encodes. There is no cantools for serial lines: there the
same messages must be read as over FD.
"""

import argparse
import io
import json
import subprocess
import tempfile
from collections import Counter
from collections.abc import Iterator
from contextlib import redirect_stdout
from pathlib import Path
from typing import Any

import cantools
import numpy as np
from cobs import cobs

from hri_predict.cli.listen import Printer
from hri_predict.protocol import e2e
from hri_predict.protocol.can import CanFrame, CanReceiver, CanSender, padded
from hri_predict.protocol.definition import (
    BY_TYPE,
    DEFINITIONS,
)
from hri_predict.protocol.fields import (
    PART_BYTES,
    Definition,
    Field,
    frame_number,
)
from hri_predict.protocol.generate.dbc import FILES
from hri_predict.protocol.messages import Acknowledge, RobotState
from hri_predict.protocol.reception import OURS
from hri_predict.protocol.robot_state import BASE_ROBOTS
from hri_predict.protocol.serial import SerialReceiver, SerialSender

DRIVERS = Path(__file__).resolve().parents[3] / "drivers"
C, DBC = DRIVERS / "c", DRIVERS / "dbc"
LINKS = ("classic", "fd", "serial")
BASE_ID = 0x680
CHUNK = 1000  # messages at a time
NO_TOOL = 255
NAMES = {d.name.lower(): {f.member: f.signal for f in d.fields} for d in DEFINITIONS}
"""Signals by the names of listen, for each message."""
BASE = {
    "x_m": "X",
    "y_m": "Y",
    "yaw_rad": "YAW",
    "vx_m_s": "VX",
    "vy_m_s": "VY",
    "yaw_rate_rad_s": "YAW_RATE",
}
REQUESTS = ("automatic", "teach", "recovery", "muted")


def raw_value(field: Field, rng: np.random.Generator) -> int:
    """A raw value of the field, often one of its ends or "not available"."""
    if field.enum:
        return int(rng.choice(list(field.enum)))
    low, high = field.raw_range
    values = [low, high, *rng.integers(low, high + 1, 3).tolist()]
    if field.optional and field.not_available is not None:
        values.append(field.not_available)
    return int(values[rng.integers(len(values))])


def packed(fields: tuple[Field, ...], row: dict[str, int]) -> bytes:
    """The payload, packed here once more so as not to share the codec's."""
    bits = shift = 0
    for f in fields:
        bits |= (row[f.signal] & ((1 << f.bits) - 1)) << shift
        shift += f.bits
    return bits.to_bytes(shift // 8, "little")


def random_payload(definition: Definition, rng: np.random.Generator) -> bytes:
    """A payload of random raw values, items included."""
    row = {f.signal: raw_value(f, rng) for f in definition.fields}
    if not definition.item:
        return packed(definition.fields, row)
    row["COUNT"] = int(rng.integers(0, definition.items_per_frame + 1))
    row["FIRST"] = int(rng.integers(0, 256 - row["COUNT"]))
    row["TOTAL"] = int(rng.integers(row["FIRST"] + row["COUNT"], 256))
    items = [{f.signal: raw_value(f, rng) for f in definition.item} for _ in range(row["COUNT"])]
    return packed(definition.fields, row) + b"".join(packed(definition.item, i) for i in items)


def units(
    definition: Definition, link: str, number: int, counter: int, payload: bytes
) -> list[Any]:
    """Frames (id and bytes), or the packet with its zero."""
    if link == "serial":
        return [cobs.encode(e2e.protect_profile4(counter, payload, e2e.data_id_32(number))) + b"\0"]
    if link == "fd":
        whole = padded(definition, payload)
        data = e2e.protect_profile5(counter & 0xFF, whole, e2e.data_id_16(number))
        return [CanFrame(BASE_ID + number, data, True)]
    parts = [payload[i : i + PART_BYTES] for i in range(0, len(payload), PART_BYTES)]
    return [
        CanFrame(
            BASE_ID + number + i,
            e2e.protect_profile2(counter & 0xFF, part, e2e.data_id_list(number + i)),
        )
        for i, part in enumerate(parts)
    ]


def listener(link: str) -> Any:
    """What decodes for ``hri-predict listen``."""
    return SerialReceiver() if link == "serial" else CanReceiver(link == "fd")


def listened(receiver: Any, sent: list[Any], schema: list[Any]) -> dict[str, Any]:
    """The JSON line that listen prints of the message in ``sent``; it heard our schema before."""
    printer, out = Printer(False, as_json=True), io.StringIO()
    with redirect_stdout(out):
        for unit in (*schema, *sent):
            for message in receiver.feed(unit):
                printer.show(message, 0.0)
    lines = out.getvalue().splitlines()
    assert len(lines) == 2, f"{len(lines) - 1} messages heard of one: {sent}"
    shown: dict[str, Any] = json.loads(lines[1])
    return shown


def flat(shown: dict[str, Any]) -> dict[str, Any]:
    """Listen's fields by signal."""
    names = NAMES[shown["message"]]
    row = {names.get(k, k.upper()): v for k, v in shown.items()}
    for i, capsule in enumerate(row.pop("CAPSULES", ())):
        row |= {f"SEGMENT_{i}": capsule["segment"], f"RADIUS_{i}": capsule["radius"]}
        row |= {f"A_{axis}_{i}": v for axis, v in zip("XYZ", capsule["a"], strict=True)}
        row |= {f"B_{axis}_{i}": v for axis, v in zip("XYZ", capsule["b"], strict=True)}
    for i, joint in enumerate(row.pop("JOINTS", ())):
        row |= {f"{k}_{i}": v for k, v in zip(("JOINT", "X", "Y", "Z"), joint, strict=True)}
    for name, many in (("POSITION", "POSITIONS"), ("VELOCITY", "VELOCITIES")):
        row |= {f"{name}_{i + 1}": v for i, v in enumerate(row.pop(many, ()))}
    base = row.get("BASE")
    if base is not None:
        row |= {f"BASE_{BASE[k]}": v for k, v in base.items()}
    row["BASE"] = int(base is not None)
    if isinstance(row.get("SCHEMA_HASH"), str):
        row["SCHEMA_HASH"] = int(row["SCHEMA_HASH"], 16)
    return row


class Cantools:
    """The shipped DBC of one kind of CAN."""

    def __init__(self, fd: bool):
        self._database: Any = cantools.database.load_file(DBC / FILES[fd])

    def read(self, frames: list[CanFrame]) -> tuple[dict[str, int], dict[str, Any]]:
        """Raw and named values of all frames of a message, without what protects them."""
        raw: dict[str, int] = {}
        named: dict[str, Any] = {}
        for frame in frames:
            message = self._database.get_message_by_frame_id(frame.arbitration_id)
            raw |= message.decode(frame.data, decode_choices=False, scaling=False)
            named |= message.decode(frame.data, decode_choices=True)
        for signal in ("CHECKSUM", "COUNTER", "COUNTER_HIGH"):
            raw.pop(signal, None)
            named.pop(signal, None)
        beyond = [k for k in raw if k[-2:-1] == "_" and k[-1].isdigit() and "COUNT" in raw]
        for k in (k for k in beyond if int(k[-1]) >= raw["COUNT"]):
            del raw[k], named[k]
        return raw, named


def check_listened(named: dict[str, Any], shown: dict[str, Any]) -> None:
    """Fail unless listen shows what cantools reads."""
    row = flat(shown)
    for signal, value in named.items():
        if signal in ("FIRST", "TOTAL", "COUNT", "JOINTS"):
            continue  # listen shows the items themselves
        got = row.get(signal)
        if isinstance(value, int | float):
            assert got is not None, (signal, named, shown)
            assert abs(got - value) <= 1e-9 * max(1.0, abs(value)), (signal, value, got)
        elif str(value) == "NOT_AVAILABLE":
            assert got is None, (signal, got)
        else:
            assert got == str(value).lower(), (signal, value, got)


def c_rows(line: str) -> tuple[str, dict[str, int]]:
    """Kind and raw values in a line of decode."""
    kind, *pairs = line.split()
    return kind, {k: int(v) for k, v in (pair.split("=") for pair in pairs)}


def line_of(unit: Any) -> str:
    """A unit as decode takes it."""
    if isinstance(unit, CanFrame):
        return f"{unit.arbitration_id:x} {unit.data.hex()}\n"
    return unit.hex() + "\n"


def run(program: str, text: str, *arguments: str) -> list[str]:
    """Lines that a program answers."""
    done = subprocess.run(
        [program, *arguments], input=text, capture_output=True, text=True, timeout=600
    )
    assert done.returncode == 0, done.stderr
    return done.stdout.splitlines()


def node_to_controller(decode: str, messages: int, rng: np.random.Generator) -> Counter[str]:
    """What the node sends: decoded by all."""
    agreed: Counter[str] = Counter()
    readers = {"classic": Cantools(False), "fd": Cantools(True)}
    receivers = {link: listener(link) for link in LINKS}
    senders: dict[str, Any] = {
        "classic": CanSender(),
        "fd": CanSender(fd=True),
        "serial": SerialSender(),
    }
    kinds = [d for d in DEFINITIONS if d.sender == "node"]
    counters: Counter[int] = Counter()
    while (left := messages - agreed["fd"]) > 0:
        chunk: list[tuple[Definition, int, dict[str, list[Any]]]] = []
        for _ in range(min(CHUNK, left)):
            definition = kinds[rng.integers(len(kinds))]
            robot = int(rng.integers(8)) if definition.per_robot else 0
            number = frame_number(definition, robot)
            payload = random_payload(definition, rng)
            links = [link for link in LINKS if definition.classic or link != "classic"]
            count = counters[number] & 0xFFFF
            sent = {link: units(definition, link, number, count, payload) for link in links}
            counters[number] += 1
            chunk.append((definition, robot, sent))
        answers: dict[str, Iterator[str]] = {}
        for link in LINKS:
            text = "".join(line_of(u) for _, _, sent in chunk for u in sent.get(link, ()))
            answers[link] = iter(run(decode, text, link, "0", "7"))
        for definition, robot, sent in chunk:
            over_fd: dict[str, int] = {}
            for link, sent_units in sent.items():
                line = [next(answers[link]) for _ in sent_units][-1]
                kind, raw = c_rows(line)
                assert kind == definition.name, (link, line)
                if definition.per_robot:
                    assert raw.pop("ROBOT") == robot
                schema = senders[link].encode(OURS)
                schema = schema if isinstance(schema, list) else [schema]
                shown = listened(receivers[link], sent_units, schema)
                if link != "serial":
                    theirs, named = readers[link].read(sent_units)
                    assert raw == theirs, (link, raw, theirs)
                    check_listened(named, shown)
                    over_fd, heard = raw, shown
                assert (raw, shown) == (over_fd, heard), link
                agreed[link] += 1
    return agreed


def random_state(rng: np.random.Generator, robot: int) -> tuple[list[int], dict[str, int]]:
    """Arguments of the driver's ``state``, and what must be heard of it by signal."""
    joints, mode, request = (int(rng.integers(n)) for n in (10, 5, 4))
    q = rng.integers(-8_191_750, 8_191_751, joints).tolist()
    qd = rng.integers(-32_767_000, 32_767_001, joints).tolist()
    enabling, confirmed = (int(rng.integers(2)) for _ in range(2))
    tool = int(rng.integers(256))  # 255: not said
    moves = int(rng.random() < 0.3 and robot < BASE_ROBOTS)
    place, speeds = rng.integers(-32_767_000, 32_767_001, (2, 3)).tolist()
    place[2] = int(rng.integers(-3_141_592, 3_141_593))
    words = [mode, joints, *q, *qd, request, enabling, tool, confirmed, moves, *place, *speeds]
    row = {f"POSITION_{i + 1}": v for i, v in enumerate(q)}
    row |= {f"VELOCITY_{i + 1}": v for i, v in enumerate(qd)}
    row |= {"REQUEST": request, "ENABLING": enabling, "TOOL_CONFIRMED": confirmed, "BASE": moves}
    row |= {} if tool == NO_TOOL else {"TOOL": tool}
    if moves:
        names = ("X", "Y", "YAW", "VX", "VY", "YAW_RATE")
        row |= {f"BASE_{k}": v for k, v in zip(names, (*place, *speeds), strict=True)}
    return words, row


def controller_to_node(driver: str, messages: int, rng: np.random.Generator) -> Counter[str]:
    """What the controller sends: encoded by the C code, decoded by the others."""
    agreed: Counter[str] = Counter()
    for code, link in enumerate(LINKS):
        reader = Cantools(link == "fd") if link != "serial" else None
        receiver = listener(link)
        sender: Any = SerialSender() if link == "serial" else CanSender(link == "fd")
        schema = sender.encode(OURS)
        schema = schema if isinstance(schema, list) else [schema]
        robot = int(rng.integers(8))
        lines = [f"init {code} {robot} {BASE_ID} 0 150 400 0 500 65000"]
        wanted: list[tuple[type, dict[str, int]]] = []
        for _ in range(messages):
            if rng.random() < 0.2:
                latch, ack = int(rng.integers(1, 65536)), int(rng.integers(1 << 32))
                lines.append(f"ack {latch} {ack}")
                wanted.append((Acknowledge, {"LATCH_ID": latch, "ACK_ID": ack}))
                continue
            words, row = random_state(rng, robot)
            lines.append(" ".join(map(str, ("state", *words))))
            wanted.append((RobotState, row))
        ready, *answers = run(driver, "\n".join(lines) + "\n")
        assert ready == "1"
        for (kind, row), answer in zip(wanted, answers, strict=True):
            pairs = [word.split(":") for word in answer.split()]
            sent: list[Any] = [bytes.fromhex(data) for _, data in pairs]
            if link != "serial":
                ids = [int(number, 16) for number, _ in pairs]
                fd = link == "fd"
                sent = [CanFrame(i, data, fd) for i, data in zip(ids, sent, strict=True)]
            shown = listened(receiver, sent, schema)
            assert shown["message"] == kind.__name__.lower()
            if reader is not None:
                check_listened(reader.read(sent)[1], shown)
            check_told(kind, row, flat(shown))
            agreed[link] += 1
    return agreed


def check_told(kind: type, row: dict[str, int], got: dict[str, Any]) -> None:
    """Fail unless what is heard is what the controller gave, to half a step."""
    fields = {f.signal: f for f in BY_TYPE[kind].fields}
    for signal, value in row.items():
        scale = fields[signal].scale
        want, slack = (value * 1e-6, 0.5 / scale + 1e-9) if scale else (value, 0)
        heard = REQUESTS.index(got[signal]) if signal == "REQUEST" else got[signal]
        assert abs(heard - want) <= slack, (signal, want, heard)


def built(source: Path, folder: str) -> str:
    """Path of the program built from ``source``."""
    program = f"{folder}/{source.stem}"
    files = [source, *sorted(C.glob("*.c"))]
    subprocess.run(["cc", "-std=c99", "-O2", f"-I{C}", "-o", program, *files], check=True)
    return program


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--decode", help="drivers/c/examples/decode.c, built; default: build it")
    parser.add_argument("--driver", help="driver.c, built; default: build it")
    parser.add_argument("--messages", type=int, default=100_000)
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    rng = np.random.default_rng(options.seed)
    with tempfile.TemporaryDirectory() as folder:
        decode = options.decode or built(C / "examples" / "decode.c", folder)
        driver = options.driver or built(Path(__file__).with_name("driver.c"), folder)
        from_node = node_to_controller(decode, options.messages, rng)
        to_node = controller_to_node(driver, options.messages // 10, rng)
    print(json.dumps({"node to controller": from_node, "controller to node": to_node}))


if __name__ == "__main__":
    main()
