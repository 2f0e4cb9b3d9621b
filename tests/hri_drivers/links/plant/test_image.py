"""The register image: what nobody renews is unknown by itself, at the moment that it is read."""

import subprocess
import sys

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hri_drivers.links.plant.image import Block, Image
from hri_predict.protocol.registers import (
    NEAREST,
    NODE,
    READ_WORDS,
    ROBOT,
    STATE,
    WRITTEN,
    nearest_address,
    packed,
    robot_address,
    unpacked,
    words_of,
)

MS = 1_000_000
PERMITS = {"LEVEL": 1, "SPEED_LIMIT": 800, "REASON": 0, "AGE": 50, "ADVICE_COUNTER": 7}


@pytest.fixture
def image() -> Image:
    made = Image(silence_s=0.06, max_age_s=0.4)
    made.put(Block.of(robot_address(1), packed(ROBOT, PERMITS)), 0)
    made.put(Block.of(nearest_address(1), packed(NEAREST, {"NEAREST": 900, "NEAREST_AGE": 5})), 0)
    made.put(Block.of(0, packed(NODE, {"MAP_VERSION": 1, "HEARTBEAT": 9, "PEOPLE": 2})), 0)
    return made


def robot(image: Image, ms: float, index: int = 1) -> dict[str, int]:
    words = image.words(round(ms * MS))
    at = robot_address(index)
    return unpacked(ROBOT + NEAREST, words[at : at + words_of(ROBOT + NEAREST)])


def test_a_fresh_block_is_read_with_its_ages_of_now(image):
    found = robot(image, 59)
    assert (found["LEVEL"], found["SPEED_LIMIT"], found["AGE"]) == (1, 800, 109)
    assert (found["NEAREST"], found["NEAREST_AGE"]) == (900, 64)


def test_a_block_that_is_not_renewed_is_unknown(image):
    found = robot(image, 60)
    assert (found["LEVEL"], found["SPEED_LIMIT"], found["REASON"], found["AGE"]) == (
        0,
        0,
        65535,
        65535,
    )
    assert (found["NEAREST"], found["NEAREST_ANGLE"]) == (65535, -32768)
    assert found["ADVICE_COUNTER"] == 7  # stands still
    words = image.words(60 * MS)
    node = unpacked(NODE, words[: words_of(NODE)])
    assert (node["HEARTBEAT"], node["PEOPLE"], node["NODE_STATE"]) == (9, 65535, 0)


def test_each_advice_that_a_plant_reads_as_stale_is_counted_once(image):
    robot(image, 59)
    assert image.timeouts == 0
    robot(image, 60)
    robot(image, 70)
    assert image.timeouts == 1
    image.put(Block.of(robot_address(1), packed(ROBOT, PERMITS)), 80 * MS)
    robot(image, 90)
    image.put(Block.of(robot_address(1), packed(ROBOT, PERMITS | {"AGE": 390})), 90 * MS)
    robot(image, 101)
    assert image.timeouts == 2
    image.put(Block.of(robot_address(1), packed(ROBOT, PERMITS | {"LEVEL": 4})), 110 * MS)
    robot(image, 200)  # the node itself had stopped the robot
    assert image.timeouts == 2


def test_an_old_capture_is_unknown_though_it_is_renewed(image):
    old = PERMITS | {"AGE": 390}
    image.put(Block.of(robot_address(1), packed(ROBOT, old)), 0)
    assert robot(image, 9)["LEVEL"] == 1
    assert robot(image, 10)["LEVEL"] == 0
    without = PERMITS | {"AGE": 65535}
    image.put(Block.of(robot_address(1), packed(ROBOT, without)), 0)
    assert robot(image, 0)["LEVEL"] == 0


def test_without_any_block_everything_is_unknown(image):
    image.forget()
    for words in (image.words(0), Image(0.06, 0.4).words(0)):
        assert len(words) == READ_WORDS
        assert words[0] == 0  # MAP_VERSION, too: a PLC stops
        levels = [words[robot_address(r)] for r in range(8)]
        limits = [words[robot_address(r) + 1] for r in range(8)]
        assert levels == limits == [0] * 8


BLOCKS = st.builds(Block, st.integers(0, 65535), st.binary(max_size=40))


@given(st.lists(BLOCKS, max_size=5), st.integers(-(2**62), 2**62))
def test_any_blocks_at_any_time_make_whole_words(blocks, now_ns):
    image = Image(0.06, 0.4)
    for block in blocks:
        image.put(block, 0)
    words = image.words(now_ns)
    assert len(words) == READ_WORDS
    assert all(0 <= word <= 0xFFFF for word in words)


@pytest.mark.parametrize("registers", [NODE, ROBOT, NEAREST, WRITTEN, STATE])
@given(data=st.data())
def test_what_is_packed_is_unpacked_high_word_first(registers, data):
    values = {}
    for register in registers:
        bits = 16 * register.words
        low, high = (-(1 << bits - 1), (1 << bits - 1) - 1) if register.signed else (0, 2**bits - 1)
        values[register.name] = data.draw(st.integers(low, high))
    words = packed(registers, values)
    assert len(words) == words_of(registers)
    assert unpacked(registers, words) == values


def test_two_words_have_the_high_one_first():
    words = packed(NODE, {"PROTOCOL_HASH": 0x12345678})
    assert words[6:8] == [0x1234, 0x5678]
    assert packed(NODE, {"PEOPLE": 70_000})[4] == 65535


def test_without_the_extra_the_error_names_it():
    code = (
        "import sys; sys.modules['pymodbus'] = None\n"
        "from hri_predict.contracts import registry\n"
        "registry.load('links', 'rtde')\n"
        "try: registry.load('links', 'modbus')\n"
        "except Exception as error: print(error)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60)
    assert "needs a package that is not installed: pymodbus" in done.stdout
    assert "pip install 'hri-predict[modbus]'" in done.stdout
    assert done.stdout.count("\n") == 1


def test_without_a_modbus_link_nothing_of_it_is_imported():
    code = (
        "import sys\n"
        "import hri_predict.cli.commands, hri_predict.run.assemble, hri_drivers.links.rtde.link\n"
        "print('pymodbus' in sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60)
    assert done.stdout == "False\n"
