"""Messages as registers and back: presses once, states whole, and anything else counted."""

import math
from dataclasses import replace

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from hri_drivers.links.plant.codec import RegisterCodec
from hri_drivers.links.plant.image import Block
from hri_predict.base.settings import Pose
from hri_predict.protocol.messages import (
    Acknowledge,
    Advice,
    Level,
    RobotMode,
    RobotState,
    SetChoice,
    Zone,
    ZoneCapsule,
)
from hri_predict.protocol.reasons import Reason
from hri_predict.protocol.registers import (
    NEAREST,
    NODE,
    ROBOT,
    SETS,
    STATE,
    nearest_address,
    packed,
    robot_address,
    state_address,
    unpacked,
)
from tests.messages import make_state, make_status

ADVICE = Advice(
    robot=1,
    level=Level.SLOW,
    reason=Reason.PERSON_NEAR,
    latch_id=77,
    separation_m=1.2345,
    speed_limit_m_s=0.2509,
    age_s=0.0801,
)
STATUS = make_status(age_s=0.05)
BODY = ZoneCapsule(0, (0.0, 2.0, 0.0), (0.0, 2.0, 1.7), 0.2)
ZONE = Zone(person=5, step=0, horizon_s=0.0, capsules=(BODY,), age_s=0.05)


@pytest.fixture
def codec() -> RegisterCodec:
    made = RegisterCodec(plc_timeout_s=1.0)
    made.stand([1], [Pose()])
    return made


def near(codec: RegisterCodec, advice: Advice = ADVICE) -> dict[str, int]:
    block = codec.encode(advice)[1]
    assert block.address == nearest_address(1)
    return unpacked(NEAREST, block.words)


def test_a_person_without_an_id_of_the_source_is_named_modulo_65536(codec):
    codec.now_ns = 5_000_000_000
    codec.encode(replace(STATUS, people=1))
    codec.encode(replace(ZONE, person=-6))
    assert near(codec)["NEAREST_PERSON"] == 65530


def test_an_advice_is_the_registers_of_its_robot(codec):
    codec.now_ns = 5_000_000_000
    block = codec.encode(ADVICE)[0]
    assert block.address == robot_address(1)
    found = unpacked(ROBOT, block.words)
    assert found == {
        "LEVEL": 3,
        "SPEED_LIMIT": 250,  # never more than the advice
        "REASON": int(Reason.PERSON_NEAR),
        "AGE": 81,  # never less
        "ADVICE_COUNTER": 1,
        "LATCH_ID": 77,
        "OPERATING_MODE": 0,
        "TOOL": 65535,
        "SEPARATION": 1234,
        "PREDICTED_SEPARATION": 65535,
        "TIME_TO_BREACH": 65535,
        "BODY_PART": 65535,
        "POSTED": 5000,
    }


@pytest.mark.parametrize(
    "advice",
    [
        replace(ADVICE, level=Level.STOP),
        replace(ADVICE, level=Level.UNKNOWN),
        replace(ADVICE, speed_limit_m_s=None),
        replace(ADVICE, speed_limit_m_s=math.nan),
        replace(ADVICE, speed_limit_m_s=-1.0),
        replace(ADVICE, age_s=None),
    ],
)
def test_what_permits_nothing_has_no_speed(codec, advice):
    assert unpacked(ROBOT, codec.encode(advice)[0].words)["SPEED_LIMIT"] == 0


def test_an_empty_room_is_said_only_while_the_node_sees_it(codec):
    codec.encode(STATUS)
    assert near(codec)["NEAREST"] == 65534
    for blind in (replace(ADVICE, level=Level.UNKNOWN), replace(ADVICE, age_s=None)):
        assert near(codec, blind)["NEAREST"] == 65535


def test_a_room_is_not_empty_before_a_status_and_no_longer_after_a_person_came(codec):
    assert near(codec)["NEAREST"] == 65535
    codec.encode(STATUS)
    assert near(codec)["NEAREST"] == 65534
    _, block = codec.encode(replace(STATUS, people=1))
    assert unpacked(NEAREST, block.words)["NEAREST"] == 65535


def test_the_nearest_person_needs_the_zone_of_every_person(codec):
    codec.encode(replace(STATUS, people=1))
    assert near(codec)["NEAREST"] == 65535
    assert codec.carries(ZONE)
    assert not codec.carries(replace(ZONE, step=5))
    (block,) = codec.encode(ZONE)
    found = unpacked(NEAREST, block.words)
    assert (found["NEAREST"], found["NEAREST_ANGLE"], found["NEAREST_PERSON"]) == (1800, 900, 5)
    codec.encode(replace(STATUS, people=2))
    assert near(codec)["NEAREST"] == 65535


def test_a_pair_is_one_press_however_often_it_is_written(codec):
    press = Block.of(1001, [77, 0x0102, 0x0304])
    assert codec.decode(press) == [Acknowledge(77, 0x01020304)]
    assert codec.decode(press) == []
    assert codec.decode(Block.of(1000, [5, 77, 0x0102, 0x0304])) == []
    assert codec.decode(Block.of(1000, [6, 77, 0x0102, 0x0305])) == [Acknowledge(77, 0x01020305)]
    assert codec.decode(Block.of(1001, [0, 0, 9])) == []
    assert codec.decode(Block.of(1001, [77, 0, 0])) == []
    taken = unpacked(NODE, codec.encode(STATUS)[0].words)["ACK_TAKEN"]
    assert taken == 0x01020305


def test_a_release_is_of_the_newest_press_and_comes_once(codec):
    assert codec.decode(Block.of(1001, [0, 0, 9])) == []
    assert codec.decode(Block.of(1001, [77, 0, 9])) == [Acknowledge(77, 9)]
    assert codec.decode(Block.of(1001, [78, 0, 9])) == [Acknowledge(78, 9)]  # of two robots
    assert codec.decode(Block.of(1001, [0, 0, 8])) == []
    assert codec.decode(Block.of(1001, [0, 0, 9])) == [Acknowledge(0, 9)]
    assert codec.decode(Block.of(1001, [0, 0, 0])) == []
    assert codec.decode(Block.of(1001, [0, 0, 9])) == []


def test_a_choice_of_a_set_counts_while_its_counter_advances(codec):
    assert codec.decode(Block.of(1010, [2, 0])) == []  # was it written before the node's start?
    assert codec.decode(Block.of(1010, [2, 1])) == [SetChoice(2)]
    assert codec.decode(Block.of(1010, [2, 1])) == []
    assert codec.decode(Block.of(1010, [3, 1])) == []  # a gateway that repeats what is old
    assert codec.decode(Block.of(1010, [3, 2])) == [SetChoice(3)]
    assert codec.counters.malformed == 0
    assert codec.decode(Block.of(1010, [3])) == []
    assert codec.counters.malformed == 1


def test_a_gateway_that_repeats_an_old_choice_chooses_nothing_after_a_restart(codec):
    for counter in (6, 7):
        codec.decode(Block.of(1010, [2, counter]))
    codec.reset()
    assert [codec.decode(Block.of(1010, [2, 7])) for _ in range(3)] == [[], [], []]
    assert codec.decode(Block.of(1010, [2, 8])) == [SetChoice(2)]


def test_the_set_in_force_is_shown_where_there_are_sets(codec):
    assert [block.address for block in codec.encode(STATUS)].count(20) == 0
    blocks = codec.encode(replace(STATUS, set_number=2, set_hash=0xDEADBEEF))
    (found,) = (block for block in blocks if block.address == 20)
    assert unpacked(SETS, found.words) == {"SET_IN_FORCE": 2, "SET_HASH": 0xDEADBEEF}


def test_a_heartbeat_that_stands_still_ends(codec):
    assert codec.alive is None
    codec.decode(Block.of(1000, [5]))
    assert codec.alive
    codec.now_ns = 900_000_000
    codec.decode(Block.of(1000, [5]))  # written again, and not changed
    assert codec.alive
    codec.now_ns = 1_000_000_000
    assert codec.alive is False
    assert unpacked(NODE, codec.encode(STATUS)[0].words)["PLC_ALIVE"] == 0
    codec.decode(Block.of(1000, [6]))
    assert unpacked(NODE, codec.encode(STATUS)[0].words)["PLC_ALIVE"] == 1


def state_words(**values: int) -> list[int]:
    given = {"STATE_COUNTER": 7, "ROBOT_MODE": 1, "JOINTS": 6, "POSITION_1": -500_000}
    return packed(STATE, given | {"VELOCITY_2": 250_000, "STATE_TOOL": 65535} | values)


def test_a_state_is_read_in_radians(codec):
    (state,) = codec.decode(Block.of(state_address(1), state_words()))
    assert state == make_state((-0.5, 0, 0, 0, 0, 0), (0, 0.25, 0, 0, 0, 0), counter=7, robot=1)


def test_what_a_plc_does_not_know_is_not_a_position(codec):
    (state,) = codec.decode(Block.of(state_address(1), state_words(POSITION_3=-(2**31))))
    assert isinstance(state, RobotState)
    assert math.isnan(state.positions[2])
    (state,) = codec.decode(Block.of(state_address(1), state_words(ROBOT_MODE=99, REQUEST=99)))
    assert isinstance(state, RobotState)
    assert (state.mode, int(state.request)) == (RobotMode.UNKNOWN, 0)


@pytest.mark.parametrize(
    "block",
    [
        Block.of(state_address(1), state_words(JOINTS=0)),
        Block.of(state_address(1), state_words(JOINTS=10)),
        Block.of(state_address(0), state_words()),  # a robot that this link does not advise
        Block.of(state_address(1), state_words()[:-1]),
        Block.of(1002, [1]),
        Block.of(0, [1]),
    ],
)
def test_what_is_not_in_the_map_is_counted(codec, block):
    assert codec.decode(block) == []
    assert codec.counters.malformed == 1


@given(address=st.integers(0, 65535), data=st.binary(max_size=260))
def test_any_write_is_decoded_or_counted(address, data):
    codec = RegisterCodec(plc_timeout_s=1.0)
    codec.stand([0], [Pose()])
    for at in (address, 1000, 1001, state_address(0)):
        for message in codec.decode(Block(at, data)):
            assert isinstance(message, Acknowledge | RobotState | SetChoice)


@given(
    st.builds(
        Advice,
        robot=st.integers(0, 7),
        level=st.sampled_from(Level),
        reason=st.sampled_from(Reason),
        latch_id=st.integers(0, 65535),
        separation_m=st.none() | st.floats(),
        speed_limit_m_s=st.none() | st.floats(),
        age_s=st.none() | st.floats(min_value=0),
        time_to_breach_s=st.none() | st.floats(),
    )
)
@example(Advice(robot=0, level=Level.CLEAR, reason=Reason.NONE, time_to_breach_s=-1.8e308))
def test_any_advice_is_words_that_permit_no_more(advice):
    codec = RegisterCodec(plc_timeout_s=1.0)
    found = unpacked(ROBOT, codec.encode(advice)[0].words)
    if not advice.level.may_move or advice.age_s is None:
        assert found["SPEED_LIMIT"] == 0
    elif found["SPEED_LIMIT"]:
        assert advice.speed_limit_m_s is not None
        assert found["SPEED_LIMIT"] <= advice.speed_limit_m_s * 1e3 + 1e-3
