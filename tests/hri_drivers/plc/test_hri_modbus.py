"""The Modbus block in structured text, run on the registers that the server answers."""

import re
from dataclasses import replace
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hri_drivers.links.plant.codec import RegisterCodec
from hri_drivers.links.plant.image import Image
from hri_predict.base.settings import Pose
from hri_predict.protocol.messages import Level, Zone, ZoneCapsule
from hri_predict.protocol.reasons import Reason
from hri_predict.protocol.registers import NEAREST, NODE, ROBOT, robot_address, words_of
from tests.hri_drivers.plc.conftest import PLC, SOURCES, everything
from tests.hri_drivers.plc.structured_text import load
from tests.messages import make_advice, make_status

MS = 1_000_000
UNITS = everything()
BODY = ZoneCapsule(0, (0.0, -2.0, 0.0), (0.0, -2.0, 1.7), 0.2)
ZONE = Zone(person=5, step=0, horizon_s=0.0, capsules=(BODY,), age_s=0.05)
STATUS = make_status(people=1, age_s=0.05)
CLEAR = make_advice(
    Level.CLEAR, Reason.PERSON_NEAR, robot=1, speed_limit_m_s=0.8, latch_id=9, age_s=0.05
)


class Cell:
    """Node, server and PLC on one made-up clock; the node posts, and the PLC polls, every 10 ms."""

    def __init__(self) -> None:
        self.now_ms = 2**32 - 40  # the PLC's tick wraps soon
        self.image = Image(silence_s=0.06, max_age_s=0.4)
        self.codec = RegisterCodec(plc_timeout_s=1.0)
        self.codec.stand([0, 1], [Pose(), Pose()])
        self.block = UNITS["HRI_MODBUS"].another()

    def post(self, *messages: Any) -> None:
        self.codec.now_ns = self.now_ms * MS
        for message in messages:
            for block in self.codec.encode(message):
                self.image.put(block, self.codec.now_ns)

    def poll(self, asked_ms: int | None = None, **changes: Any) -> None:
        """The PLC's cycle in which both requests are answered, at the time of asking."""
        asked_ms = self.now_ms if asked_ms is None else asked_ms
        words = self.image.words(asked_ms * MS)
        at = robot_address(1)
        inputs = {
            "NewNode": True,
            "Node": words[: words_of(NODE)],
            "NewRobot": True,
            "Robot": words[at : at + words_of(ROBOT + NEAREST)],
            "AskedMs": asked_ms % 2**32,
            "Failed": False,
            "NowMs": self.now_ms % 2**32,
        }
        self.block(**inputs | changes)

    def run(self, ms: int, *messages: Any, **changes: Any) -> int:
        for _ in range(ms // 10):
            self.now_ms += 10
            self.post(*messages)
            self.poll(**changes)
        return self.permitted

    @property
    def permitted(self) -> int:
        speed: int = self.block.variables["PermittedSpeed"]
        return speed


@pytest.fixture
def cell() -> Cell:
    return Cell()


def test_the_first_reply_permits_nothing_and_the_next_does(cell):
    assert cell.run(10, STATUS, CLEAR, ZONE) == 0
    assert cell.run(10, STATUS, CLEAR, ZONE) == 800
    block = cell.block
    assert (block.variables["Level"], block.variables["LatchId"]) == (1, 9)
    assert (block.variables["NearestMm"], block.variables["NearestAngle"]) == (1800, -900)
    assert block.variables["Reason"] == int(Reason.PERSON_NEAR)
    assert cell.run(500, STATUS, CLEAR) == 800  # the tick has wrapped


def test_it_stops_when_the_counters_stand_still(cell):
    cell.run(100, STATUS, CLEAR)
    assert cell.run(50) == 800
    assert cell.run(10) == 0
    assert cell.block.variables["Silent"]
    assert (cell.block.variables["Level"], cell.block.variables["NearestMm"]) == (0, 65535)
    assert cell.run(20, STATUS, CLEAR) == 800


@pytest.mark.parametrize("kept", [STATUS, CLEAR])
def test_both_counters_must_advance(cell, kept):
    cell.run(100, STATUS, CLEAR)
    assert cell.run(60, kept) == 0


@pytest.mark.parametrize("frozen", ["Robot", "Node"])
def test_old_replies_that_something_repeats_stop_it(cell, frozen):
    """One group of registers is answered from a memory, as fresh; the other advances."""
    cell.run(100, STATUS, CLEAR)
    kept = {frozen: list(cell.block.variables[frozen])}
    assert cell.run(50, STATUS, CLEAR, **kept) == 800
    assert cell.run(10, STATUS, CLEAR, **kept) == 0
    assert cell.block.variables["Silent"]
    assert not cell.block.variables["TooOld"]


def test_a_failed_request_stops_it_until_the_counters_advance(cell):
    cell.run(100, STATUS, CLEAR)
    assert cell.run(10, STATUS, CLEAR, Failed=True) == 0
    assert cell.run(10, STATUS, CLEAR) == 0
    assert cell.run(10, STATUS, CLEAR) == 800


def test_a_reply_that_took_long_is_old(cell):
    """AGE is 50 ms when asked; the limit is 204 ms."""
    cell.run(100, STATUS, CLEAR)
    for late_ms, permitted in ((150, 800), (155, 0)):
        words = cell.run(10, STATUS, CLEAR) and cell.image.words(cell.now_ms * MS)
        at = robot_address(1)
        robot = words[at : at + words_of(ROBOT + NEAREST)]
        robot[4] = (robot[4] + 1) % 65536  # another advice
        cell.poll(asked_ms=cell.now_ms - late_ms, Robot=robot)
        assert cell.permitted == permitted, late_ms


def test_an_old_capture_stops_it(cell):
    cell.run(100, STATUS, CLEAR)
    assert cell.run(30, STATUS, replace(CLEAR, age_s=0.203)) == 800
    assert cell.run(30, STATUS, replace(CLEAR, age_s=0.204)) == 0
    assert cell.block.variables["TooOld"]


def test_another_map_stops_it(cell):
    cell.run(100, STATUS, CLEAR)
    words = cell.image.words(cell.now_ms * MS)[: words_of(NODE)]
    cell.poll(Node=[2, *words[1:]])
    assert cell.permitted == 0


@pytest.mark.parametrize("level", [Level.STOP, Level.UNKNOWN, Level.FAULT])
def test_levels_that_stop(cell, level):
    cell.run(100, STATUS, CLEAR)
    assert cell.run(10, STATUS, replace(CLEAR, level=level, speed_limit_m_s=0.8)) == 0


WORDS = st.integers(0, 65535)


@given(
    st.lists(
        st.tuples(
            st.integers(0, 200),
            st.booleans(),
            st.booleans(),
            st.lists(WORDS, min_size=12, max_size=12),
            st.lists(WORDS, min_size=18, max_size=18),
        ),
        max_size=8,
    )
)
def test_any_registers_permit_no_more_than_they_say(cycles):
    block = UNITS["HRI_MODBUS"].another()
    now_ms, newest = 5, [0] * 18
    for ms, new_node, new_robot, node, robot in cycles:
        now_ms += ms
        block(
            NewNode=new_node,
            Node=[node[0] % 3, node[1] % 4, *node[2:]],
            NewRobot=new_robot,
            Robot=robot,
            AskedMs=now_ms,
            Failed=False,
            NowMs=now_ms,
        )
        newest = robot if new_robot else newest
        if block.variables["PermittedSpeed"]:
            assert block.variables["PermittedSpeed"] == newest[1]
            assert newest[0] in (1, 2, 3)


def test_the_program_of_the_guide_obeys(cell):
    guide = PLC.parents[1] / "docs" / "guides" / "modbus.md"
    blocks = re.findall(r"```iecst\n(.*?)```", guide.read_text(encoding="utf-8"), re.DOTALL)
    texts = [path.read_text(encoding="ascii") for path in SOURCES]
    program = load(*texts, *blocks)["CELL_MODBUS"]
    for _ in range(2):
        cell.run(10, STATUS, CLEAR)
        values = cell.block.variables
        given = {name: values[name] for name in ("Node", "Robot", "NowMs")}
        program(NodeDone=True, RobotDone=True, RobotSentMs=values["AskedMs"], Error=False, **given)
    assert program.variables["PermittedSpeed"] == 800
    assert program.variables["Lamp"]
    program(NodeDone=False, RobotDone=False, Error=True)
    assert program.variables["PermittedSpeed"] == 0
