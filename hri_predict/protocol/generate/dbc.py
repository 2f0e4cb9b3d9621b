"""The DBC files, one for classic CAN and one for FD, generated from the definition.

``hri-predict protocol dbc FOLDER`` writes both. The shipped files in ``drivers/dbc`` have the
default base id. Writing them requires cantools (extra ``dbc``); the node does not.
"""

from collections import OrderedDict
from collections.abc import Iterator, Sequence
from typing import Any

from hri_predict.protocol.can import (
    CLASSIC_BYTES,
    DEFAULT_BASE_ID,
    FD_LENGTHS,
    check_base_id,
)
from hri_predict.protocol.definition import (
    SCHEMA_HASH,
    SCHEMA_VERSION,
    frame_table,
)
from hri_predict.protocol.e2e import (
    PROFILE_2_HEADER,
    PROFILE_5_HEADER,
    data_id_16,
    data_id_list,
)
from hri_predict.protocol.fields import (
    PART_BYTES,
    Definition,
    Field,
    frame_number,
)

FILES = {False: "hri_predict.dbc", True: "hri_predict_fd.dbc"}

_CHECKSUM_2 = Field(signal="CHECKSUM", bits=8, text="AUTOSAR E2E profile 2 CRC; see PROTOCOL.md")
_COUNTER_2 = Field(signal="COUNTER", bits=4, text="AUTOSAR E2E profile 2 counter", wraps=True)
_COUNTER_HIGH = Field(
    signal="COUNTER_HIGH",
    bits=4,
    text="next four bits of the counter: COUNTER + 16 * COUNTER_HIGH counts 0..255",
)
_CHECKSUM_5 = Field(signal="CHECKSUM", bits=16, text="AUTOSAR E2E profile 5 CRC; see PROTOCOL.md")
_COUNTER_5 = Field(signal="COUNTER", bits=8, text="AUTOSAR E2E profile 5 counter", wraps=True)


def numbered_items(definition: Definition) -> tuple[Field, ...]:
    """Return the fields of all items in one frame, with signals numbered from 0."""
    return tuple(
        Field(
            signal=f"{f.signal}_{i}",
            bits=f.bits,
            text=f"item {i}: {f.text}",
            unit=f.unit,
            scale=f.scale,
            signed=f.signed,
            rounding=f.rounding,
        )
        for i in range(definition.items_per_frame)
        for f in definition.item
    )


def frame_fields(definition: Definition, part: int, fd: bool) -> list[tuple[int, Field]]:
    """Return (start bit, field) of all fields of one frame, headers included."""
    if fd:
        header: tuple[Field, ...] = (_CHECKSUM_5, _COUNTER_5)
        return list(_placed((*header, *definition.fields, *numbered_items(definition))))
    header = (_CHECKSUM_2, _COUNTER_2, _COUNTER_HIGH)
    first = 8 * PART_BYTES * part
    inside = [
        (8 * PROFILE_2_HEADER + start - first, f)
        for start, f in _placed(definition.fields)
        if first <= start < first + 8 * PART_BYTES
    ]
    return [*_placed(header), *inside]


def _placed(fields: Sequence[Field]) -> Iterator[tuple[int, Field]]:
    start = 0
    for field in fields:
        yield start, field
        start += field.bits


def frame_name(definition: Definition, robot: int, part: int, fd: bool) -> str:
    """Name of a frame in the DBC, such as ADVICE_R0_P2 (robot 0, part 2)."""
    snake = "".join("_" + c if c.isupper() else c for c in definition.name).lstrip("_").upper()
    name = f"{snake}_R{robot}" if definition.per_robot else snake
    return f"{name}_P{part}" if not fd and definition.parts > 1 else name


def frame_length(definition: Definition, fd: bool) -> int:
    """Maximum length of such a frame, in bytes."""
    if not fd:
        return CLASSIC_BYTES
    return next(n for n in FD_LENGTHS if n >= PROFILE_5_HEADER + definition.max_bytes)


def choices(field: Field) -> dict[int, str]:
    """Names of raw values: the values of an enumeration, or "not available" for a number."""
    names = {int(e): e.name for e in field.enum} if field.enum else {}
    if field.not_available is not None:
        names[field.not_available] = "NOT_AVAILABLE"
    return names


def frame_comment(definition: Definition, number: int, part: int, fd: bool) -> str:
    """Return the comment on a frame: its purpose, and the data id in its CRC."""
    text = definition.text + "." + (_part_of(definition, part) if not fd else "")
    if fd:
        return f"{text} E2E profile 5, data id {data_id_16(number):#06x}."
    return f"{text} E2E profile 2, data id {data_id_list(number)[0]} for every counter."


def _part_of(definition: Definition, part: int) -> str:
    """Describe which part the frame is, and which other parts it must be used with."""
    if definition.parts == 1:
        return ""
    if not definition.extra:
        others = f"Part {part + 1} of {definition.parts}; use it only with all parts"
        return f" {others} of the same counter."
    text = f" Part {part}; use it only with all parts that part 0 asks for, of the same counter."
    if part < definition.always:
        return text
    extra = definition.extra[part - definition.always]
    return f"{text} It is sent only if {extra.signal} is {extra.least} or more."


def dbc_text(fd: bool, base_id: int = DEFAULT_BASE_ID, extended: bool = False) -> str:
    """Return the DBC file of classic CAN or FD.

    Raises:
        ConfigError: ``base_id`` leaves no room for all ids.
    """
    check_base_id(base_id, extended)
    from cantools.database import Database
    from cantools.database.can import Node
    from cantools.database.can.formats.dbc import DbcAttribute, DbcAttributeDefinition, DbcSpecifics

    bus_type = DbcAttributeDefinition("BusType", "CAN", None, "STRING")
    specifics = DbcSpecifics()
    specifics.attribute_definitions["BusType"] = bus_type
    specifics.attributes["BusType"] = DbcAttribute("CAN FD" if fd else "CAN", bus_type)
    nodes = [
        Node("NODE", "hri-predict: watches people and advises the robot"),
        Node("CONTROLLER", "robot controller: decides and acts"),
    ]
    messages = [
        _message(
            definition=definition,
            robot=robot,
            part=part,
            frame_id=base_id + number,
            fd=fd,
            extended=extended,
        )
        for number, (definition, robot, part) in sorted(frame_table(classic=not fd).items())
    ]
    version = f"{SCHEMA_VERSION} hash {SCHEMA_HASH:#010x}"
    text: str = Database(messages, nodes, version=version, dbc_specifics=specifics).as_dbc_string()
    return text.replace("\r\n", "\n").rstrip("\n") + "\n"


def _message(
    *, definition: Definition, robot: int, part: int, frame_id: int, fd: bool, extended: bool
) -> Any:
    from cantools.database.can import Message

    sender, receiver = "NODE", "CONTROLLER"
    if definition.sender == "controller":
        sender, receiver = receiver, sender
    return Message(
        frame_id=frame_id,
        is_extended_frame=extended,
        name=frame_name(definition, robot, part, fd),
        length=frame_length(definition, fd),
        signals=[_signal(start, f, receiver) for start, f in frame_fields(definition, part, fd)],
        senders=[sender],
        cycle_time=definition.cycle_ms or None,
        comment=frame_comment(definition, frame_number(definition, robot, part), part, fd),
        is_fd=fd,
    )


def _signal(start: int, field: Field, receiver: str) -> Any:
    from cantools.database.can import Signal
    from cantools.database.conversion import BaseConversion

    low, high = field.raw_range
    scale = field.resolution if field.scale else 1
    return Signal(
        name=field.signal,
        start=start,
        length=field.bits,
        is_signed=field.signed,
        conversion=BaseConversion.factory(scale=scale, choices=OrderedDict(choices(field)) or None),
        minimum=low / field.scale if field.scale else low,
        maximum=high / field.scale if field.scale else high,
        unit=field.unit or None,
        receivers=[receiver],
        comment=field.text,
    )
