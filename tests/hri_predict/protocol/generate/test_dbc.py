"""The shipped DBC files, read by cantools in a process of its own, agree with the codec."""

import json
import re
from enum import IntEnum
from pathlib import Path
from typing import Any

import cantools
import numpy as np
import pytest
from cantools.database import Database

from hri_predict.base.errors import ConfigError
from hri_predict.protocol.can import CanSender
from hri_predict.protocol.definition import BY_TYPE, DEFINITIONS, frame_table, needed_parts
from hri_predict.protocol.generate.dbc import FILES, dbc_text, frame_name
from hri_predict.protocol.messages import Level
from hri_predict.protocol.reasons import Reason
from tests.messages import make_status
from tests.processes import python
from tests.random_messages import random_message, signals

DBC = Path(__file__).resolve().parents[4] / "drivers" / "dbc"

# Knows nothing of the project: decodes "id hex" lines with cantools alone, answers in JSON lines.
DECODER = """
import json, sys, cantools
database = cantools.database.load_file(sys.argv[1])
for line in sys.stdin:
    frame_id, data = line.split()
    message = database.get_message_by_frame_id(int(frame_id))
    named = message.decode(bytes.fromhex(data), decode_choices=True)
    plain = message.decode(bytes.fromhex(data), decode_choices=False)
    row = {k: str(v) if not isinstance(v, (int, float)) else plain[k] for k, v in named.items()}
    print(json.dumps([message.name, row]))
"""


def load_shipped(fd: bool) -> Database:
    database = cantools.database.load_file(DBC / FILES[fd])
    assert isinstance(database, Database)
    return database


def decode_elsewhere(fd: bool, frames: list) -> list[tuple[str, dict]]:
    text = "".join(f"{f.arbitration_id} {f.data.hex()}\n" for f in frames)
    done = python("-c", DECODER, DBC / FILES[fd], input=text, check=True, timeout=120)
    return [tuple(json.loads(line)) for line in done.stdout.splitlines()]


RESOLUTION = {f.signal: f.resolution for d in DEFINITIONS for f in (*d.fields, *d.item)}


def assert_same(signal: str, got: object, want: object) -> None:
    field = signal if signal in RESOLUTION else re.sub(r"_\d+$", "", signal)
    if want is None:
        assert got == "NOT_AVAILABLE", signal
    elif isinstance(want, IntEnum):
        assert got == want.name, signal
    elif isinstance(want, float):
        assert got == pytest.approx(want, abs=1.01 * RESOLUTION[field]), signal
    else:
        assert got == want, signal


@pytest.mark.parametrize("fd", [False, True])
def test_cantools_in_another_process_reads_what_was_sent(fd: bool) -> None:
    rng = np.random.default_rng(20 + fd)
    sender = CanSender(fd)
    kinds = [d.type for d in DEFINITIONS if fd or d.classic]
    sent = [random_message(rng, kind) for kind in kinds for _ in range(60)]
    frames = [(message, sender.encode(message)) for message in sent]
    decoded = iter(decode_elsewhere(fd, [f for _, group in frames for f in group]))
    for message, group in frames:
        definition = BY_TYPE[type(message)]
        rows = [next(decoded) for _ in group]
        robot = getattr(message, "robot", 0)
        head = group[0].data[2:]
        parts = [0] * len(group) if fd else sorted(needed_parts(definition, head))
        names = [frame_name(definition, robot, part, fd) for part in parts]
        assert [name for name, _ in rows] == names
        got: dict[str, object] = {}
        for place, (_, row) in enumerate(rows):
            got |= {f.signal: row[f.signal] for f in definition.fields if f.signal in row}
            first = place * definition.items_per_frame
            for i in range(definition.items_per_frame):
                got |= {f"{f.signal}_{first + i}": row[f"{f.signal}_{i}"] for f in definition.item}
        for signal, want in signals(message).items():
            assert_same(signal, got[signal], want)
        items = len(getattr(message, definition.items)) if definition.item else 0
        assert items == got.get("TOTAL", 0)


@pytest.mark.parametrize(("base_id", "extended"), [(0x100, False), (0x18FF0000, True)])
def test_a_file_for_another_base_id_decodes_what_is_sent_there(
    base_id: int, extended: bool
) -> None:
    database: Any = cantools.database.load_string(dbc_text(False, base_id, extended))
    message = make_status(people=3, cycle=5, predictor=4, age_s=0.25)
    (frame,) = CanSender(False, base_id, extended).encode(message)
    found = database.get_message_by_frame_id(frame.arbitration_id)
    assert found.is_extended_frame is extended
    assert (found.name, found.decode(frame.data)["AGE"]) == ("STATUS", 0.25)
    assert found.comment == load_shipped(False).get_message_by_name("STATUS").comment


def test_a_base_id_from_which_not_all_ids_fit_is_refused() -> None:
    with pytest.raises(ConfigError, match="0x7a0"):
        dbc_text(False, 0x7A1)


@pytest.mark.parametrize("fd", [False, True])
def test_dbc_manners(fd: bool) -> None:
    database = load_shipped(fd)
    assert len(database.messages) == len(frame_table(classic=not fd))
    for message in database.messages:
        assert message.comment
        assert message.is_fd is fd
        names = [signal.name for signal in message.signals]
        assert {"COUNTER", "CHECKSUM"} <= set(names)
        assert all(name == name.upper() for name in names)
        assert all(signal.comment for signal in message.signals)
    advice = database.get_message_by_name("ADVICE_R0" if fd else "ADVICE_R0_P0")
    assert advice.cycle_time == 40
    for signal, enum in (("LEVEL", Level), ("REASON", Reason)):
        named = advice.get_signal_by_name(signal).choices
        assert named is not None
        assert {int(k): str(v) for k, v in named.items()} == {e.value: e.name for e in enum}
