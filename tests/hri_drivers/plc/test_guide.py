"""The programs that the guide prints: they are read, and they run."""

import re
from pathlib import Path

from hri_predict.protocol.can import DEFAULT_BASE_ID, CanReceiver, CanSender
from hri_predict.protocol.definition import DEFINITIONS
from hri_predict.protocol.messages import Acknowledge, Advice, Level, RobotState
from hri_predict.protocol.reasons import Reason
from hri_predict.protocol.reception import OURS
from hri_predict.protocol.serial import SerialReceiver, SerialSender
from tests.hri_drivers.plc.conftest import SOURCES
from tests.hri_drivers.plc.structured_text import Unit, load
from tests.hri_drivers.plc.test_hri_send import CanFrame

GUIDE = Path(__file__).resolve().parents[3] / "docs" / "guides" / "plc.md"


def printed(name: str) -> Unit:
    texts = [path.read_text(encoding="ascii") for path in SOURCES]
    blocks = re.findall(r"```iecst\n(.*?)```", GUIDE.read_text(encoding="utf-8"), re.DOTALL)
    return load(*texts, *blocks)[name]


def test_the_guide_lists_the_ids_of_the_definition() -> None:
    text = GUIDE.read_text(encoding="utf-8")
    for definition in DEFINITIONS:
        if definition.classic:
            first = f"0x{DEFAULT_BASE_ID + definition.number:X}"
            assert re.search(rf"^\| {definition.name}\b[^|]*\| {first}\b", text, re.M), (
                definition.name
            )
        for extra in definition.extra:
            assert f"0x{DEFAULT_BASE_ID + extra.number:X} + 2r" in text


def test_the_program_for_can_sends_state_and_acknowledge() -> None:
    cell, node = printed("CELL_CAN"), CanSender(False)
    latched = Advice(robot=0, level=Level.STOP, reason=Reason.LATCHED, latch_id=700)
    for frame in (*node.encode(OURS), *node.encode(latched)):
        data = [*frame.data]
        cell(NewFrame=True, Id=frame.arbitration_id, Length=8, Data=data, NowMs=990, FirstPress=50)
    cell(NewFrame=False, NowMs=1000, StateDue=True, Pressed=True)
    receiver, heard = CanReceiver(False), []
    for name in ("StateFrames", "PressFrames"):
        v = cell.variables[name].variables
        for i in range(v["FrameCount"]):
            payload = bytes(v["Frames"][8 * i : 8 * i + 8])
            heard += receiver.feed(CanFrame(v["Ids"][i], payload, False))
    assert [type(m) for m in heard] == [RobotState, Acknowledge]
    assert heard[1] == Acknowledge(700, 51)
    assert cell.variables["PermittedSpeed"] == 0


def test_the_program_for_can_acknowledges_nothing_where_nothing_is_shown() -> None:
    cell = printed("CELL_CAN")
    cell(NowMs=1000, StateDue=True, Pressed=True)
    assert cell.variables["PressFrames"].variables["FrameCount"] == 0


def test_the_program_for_tcp_begins_each_connection_and_hears_the_schema() -> None:
    cell = printed("CELL_TCP")
    came = SerialSender().encode(OURS)
    padded = [*came, *bytes(256 - len(came))]
    cell(Came=padded, CameCount=len(came), Connected=True, NowMs=1000, StateDue=False)
    cell(CameCount=0, Connected=False, StateDue=True)
    v = cell.variables["StateLine"].variables
    sent = bytes(v["Line"][: v["LineBytes"]])
    assert sent[0] == 0
    assert [type(m) for m in SerialReceiver().feed(b"noise" + sent)] == [RobotState]
    assert cell.variables["Advice"].variables["SchemaMatches"] == 1
    cell(StateDue=True)
    assert v["Line"][0] != 0
