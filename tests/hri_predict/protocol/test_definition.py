"""The one definition keeps the promises that codec, DBC and documents rest on."""

from dataclasses import fields, replace
from typing import get_args

import pytest

from hri_predict.protocol.can import DEFAULT_BASE_ID
from hri_predict.protocol.definition import (
    BY_TYPE,
    DEFINITIONS,
    SCHEMA_HASH,
    frame_table,
    needed_bytes,
    needed_parts,
    schema_hash,
)
from hri_predict.protocol.fields import (
    PART_BYTES,
    Definition,
    Field,
    frame_number,
)
from hri_predict.protocol.messages import (
    Advice,
    Message,
    Pose,
    RobotState,
    Schema,
    SetChoice,
    Status,
    Zone,
)


def test_every_message_is_defined_once() -> None:
    assert set(BY_TYPE) == set(get_args(Message)) - {SetChoice}
    assert len(DEFINITIONS) == len(BY_TYPE)


def test_every_field_is_an_attribute_of_its_message_but_for_what_the_codec_computes() -> None:
    """A field without its attribute would be sent as if it were not known."""
    joints = [f"{name}_{i}" for i in range(1, 10) for name in ("POSITION", "VELOCITY")]
    base = [f.signal for f in BY_TYPE[RobotState].fields if f.signal.startswith("BASE_")]
    items = {"FIRST", "TOTAL", "COUNT"}
    computed = {RobotState: {"JOINTS", "BASE", *joints, *base}, Zone: items, Pose: items}
    for definition in DEFINITIONS:
        own = {f.name for f in fields(definition.type)}
        rest = {f.signal for f in definition.fields if f.member not in own}
        assert rest == computed.get(definition.type, set())


def test_attributes_that_are_not_named_like_their_signals() -> None:
    """A wrong name would put a value into another field: each exception is listed here, too."""
    assert {(f.signal, f.attribute) for d in DEFINITIONS for f in d.fields if f.attribute} == {
        ("OPERATING_MODE", "mode"),
        ("STATE_COUNTER", "counter"),
        ("BASE", "base_moves"),
        ("SCHEMA_VERSION", "version"),
        ("SCHEMA_HASH", "hash"),
    }


def test_classic_payloads_are_whole_parts_and_no_field_crosses_them() -> None:
    for definition in DEFINITIONS:
        if not definition.classic:
            continue
        assert sum(f.bits for f in definition.fields) == 8 * PART_BYTES * definition.parts
        start = 0
        for field in definition.fields:
            last = start + field.bits - 1
            assert start // (8 * PART_BYTES) == last // (8 * PART_BYTES), field.signal
            start += field.bits


def test_wide_payloads_are_whole_bytes_and_fit_an_fd_frame() -> None:
    for definition in DEFINITIONS:
        assert sum(f.bits for f in definition.fields) % 8 == 0
        assert sum(f.bits for f in definition.item) % 8 == 0
        assert 3 + definition.max_bytes <= 64


def test_no_two_frames_share_a_number() -> None:
    for classic in (True, False):
        frames = [
            frame_number(d, robot, part)
            for d in DEFINITIONS
            if d.classic or not classic
            for part in range(d.parts if classic else 1)
            for robot in range(d.robots_with(part))
        ]
        assert len(frames) == len(set(frames))
        assert set(frames) == set(frame_table(classic))


def test_default_ids_keep_clear_of_canopen() -> None:
    taken = [
        *(range(0x000, 0x001), range(0x080, 0x101), range(0x101, 0x181)),  # NMT, SYNC, EMCY, TIME
        *(range(0x181, 0x580), range(0x581, 0x680), range(0x6E0, 0x700)),  # PDO, SDO, reserved
        range(0x701, 0x800),  # heartbeat, LSS
    ]
    ids = {DEFAULT_BASE_ID + n for n in (*frame_table(True), *frame_table(False))}
    assert not [hex(i) for i in ids if any(i in block for block in taken)]


def test_the_numbers_of_isotp_stay_free() -> None:
    assert not {0x46, 0x47} & {*frame_table(True), *frame_table(False)}


def test_a_message_without_numbers_for_a_robot_is_an_error() -> None:
    assert frame_number(BY_TYPE[RobotState], 7, 6) == 0x57
    with pytest.raises(ValueError, match=r"part 7 .* only, not for robot 4"):
        frame_number(BY_TYPE[RobotState], 4, 7)


@pytest.mark.parametrize(
    ("joints", "base", "parts", "octets"),
    [
        (0, 0, set(range(5)), 30),
        (6, 0, set(range(5)), 30),
        (7, 0, set(range(6)), 36),
        (8, 0, set(range(7)), 42),
        (9, 0, set(range(7)), 42),
        (6, 1, {*range(5), 7, 8}, 54),
        (9, 1, set(range(9)), 54),
    ],
)
def test_part_0_alone_says_which_parts_a_state_has(
    joints: int, base: int, parts: set[int], octets: int
) -> None:
    head = bytes((joints << 4 | 1, 0xFF, 0xFF, 0xFF, 0xFF, base << 4 | 0xF))
    assert needed_parts(BY_TYPE[RobotState], head) == parts
    assert needed_bytes(BY_TYPE[RobotState], head) == octets


def test_the_hash_changes_with_every_extra_part() -> None:
    place = DEFINITIONS.index(BY_TYPE[RobotState])
    extra = DEFINITIONS[place].extra
    hashes = {SCHEMA_HASH}
    for i, one in enumerate(extra):
        for name in ("number", "stride", "robots", "least"):
            other = replace(one, **{name: getattr(one, name) + 1})
            changed = replace(DEFINITIONS[place], extra=(*extra[:i], other, *extra[i + 1 :]))
            hashes.add(schema_hash((*DEFINITIONS[:place], changed, *DEFINITIONS[place + 1 :])))
    assert len(hashes) == 1 + 4 * len(extra)


def test_a_lower_id_wins_the_bus_in_order_of_urgency() -> None:
    def ids(*kinds: type[Message]) -> list[int]:
        return [n for n, (d, _, _) in frame_table(False).items() if d.type in kinds]

    assert max(ids(Advice, RobotState)) < min(ids(Status))
    assert max(ids(Status)) < min(ids(Schema))
    assert max(ids(Schema)) < min(ids(Zone, Pose))


def changed_fields(field: Field) -> list[Field]:
    return [
        replace(field, signal=field.signal + "_X"),
        replace(field, bits=field.bits + 1),
        replace(field, scale=field.scale + 1),
        replace(field, signed=not field.signed),
        replace(field, unit=field.unit + "k"),
        replace(field, optional=not field.optional),
        replace(field, bounded=not field.bounded),
        replace(field, wraps=not field.wraps),
    ]


def with_fields(definition: Definition, name: str, fields: tuple[Field, ...]) -> Definition:
    if name == "item":
        return replace(definition, item=fields)
    return replace(definition, fields=fields)


@pytest.mark.parametrize("position", range(len(DEFINITIONS)))
def test_the_hash_changes_with_every_field(position: int) -> None:
    definition = DEFINITIONS[position]
    hashes = {SCHEMA_HASH}
    changes = 0
    for name in ("fields", "item"):
        row = getattr(definition, name)
        for i, field in enumerate(row):
            for other in changed_fields(field):
                changed = with_fields(definition, name, (*row[:i], other, *row[i + 1 :]))
                hashes.add(
                    schema_hash((*DEFINITIONS[:position], changed, *DEFINITIONS[position + 1 :]))
                )
                changes += 1
    assert len(hashes) == 1 + changes


def test_the_hash_ignores_what_is_only_said_about_a_field() -> None:
    first = DEFINITIONS[0]
    reworded = replace(first, fields=(replace(first.fields[0], text="other"), *first.fields[1:]))
    assert schema_hash((reworded, *DEFINITIONS[1:])) == SCHEMA_HASH
