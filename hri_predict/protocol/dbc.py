"""The DBC files, one for classic CAN and one for FD, written from the definition.

``python -m hri_predict.protocol.dbc FOLDER`` writes both; the shipped ones are in ``drivers/dbc``,
with the default base id. cantools is needed to write them (extra ``dev``), not to use the node.
"""

import argparse
from collections import OrderedDict
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from hri_predict.errors import ConfigError
from hri_predict.protocol.can_codec import (
    CLASSIC_BYTES,
    DEFAULT_BASE_ID,
    FD_LENGTHS,
    check_base_id,
)
from hri_predict.protocol.definition import (
    PART_BYTES,
    SCHEMA_HASH,
    SCHEMA_VERSION,
    Definition,
    Field,
    frame_number,
    frame_table,
)
from hri_predict.protocol.e2e import (
    PROFILE_2_HEADER,
    PROFILE_5_HEADER,
    data_id_16,
    data_id_list,
)

FILES = {False: "hri_predict.dbc", True: "hri_predict_fd.dbc"}

_CHECKSUM_2 = Field("CHECKSUM", 8, "AUTOSAR E2E profile 2 CRC; see PROTOCOL.md")
_COUNTER_2 = Field("COUNTER", 4, "AUTOSAR E2E profile 2 counter", wraps=True)
_COUNTER_HIGH = Field(
    "COUNTER_HIGH", 4, "next four bits of the counter: COUNTER + 16 * COUNTER_HIGH counts 0..255"
)
_CHECKSUM_5 = Field("CHECKSUM", 16, "AUTOSAR E2E profile 5 CRC; see PROTOCOL.md")
_COUNTER_5 = Field("COUNTER", 8, "AUTOSAR E2E profile 5 counter", wraps=True)


def numbered_items(definition: Definition) -> tuple[Field, ...]:
    """Return the fields of all items that one frame carries, their signals numbered from 0."""
    return tuple(
        Field(
            f"{f.signal}_{i}",
            *(f.bits, f"item {i}: {f.text}", f.unit, f.scale, f.signed, f.rounding),
        )
        for i in range(definition.items_per_frame)
        for f in definition.item
    )


def frame_fields(definition: Definition, part: int, fd: bool) -> list[tuple[int, Field]]:
    """Return (start bit, field) of everything in one frame, headers included."""
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
    """Bytes of the longest such frame."""
    if not fd:
        return CLASSIC_BYTES
    return next(n for n in FD_LENGTHS if n >= PROFILE_5_HEADER + definition.max_bytes)


def choices(field: Field) -> dict[int, str]:
    """Names of raw values: of the enumeration, and "not available" of a number."""
    names = {int(e): e.name for e in field.enum} if field.enum else {}
    if field.not_available is not None:
        names[field.not_available] = "NOT_AVAILABLE"
    return names


def frame_comment(definition: Definition, number: int, part: int, fd: bool) -> str:
    """Return what the frame is for, and the data ids that its CRC takes in."""
    of = f" Part {part + 1} of {definition.parts}, applied only when all parts of one counter came."
    text = definition.text + "." + (of if definition.parts > 1 and not fd else "")
    if fd:
        return f"{text} E2E profile 5, data id {data_id_16(number):#06x}."
    return f"{text} E2E profile 2, data id {data_id_list(number)[0]} at every counter."


def dbc_text(fd: bool, base_id: int = DEFAULT_BASE_ID, extended: bool = False) -> str:
    """Return the DBC file of classic CAN or FD.

    Raises:
        ConfigError: not all ids fit above ``base_id``.
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
        Node("NODE", "hri-predict, which watches the people and advises"),
        Node("CONTROLLER", "the robot controller, which decides and acts"),
    ]
    messages = [
        _message(definition, robot, part, base_id + number, fd, extended)
        for number, (definition, robot, part) in sorted(frame_table(classic=not fd).items())
    ]
    version = f"{SCHEMA_VERSION} hash {SCHEMA_HASH:#010x}"
    text: str = Database(messages, nodes, version=version, dbc_specifics=specifics).as_dbc_string()
    return text.replace("\r\n", "\n").rstrip("\n") + "\n"


def _message(
    definition: Definition, robot: int, part: int, frame_id: int, fd: bool, extended: bool
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


def main() -> None:
    """Write both files into the folder named on the command line."""
    parser = argparse.ArgumentParser(description="Write the DBC files of classic CAN and of FD.")
    parser.add_argument("folder", nargs="?", type=Path, default=Path("drivers/dbc"))
    parser.add_argument(
        "--base-id", type=lambda text: int(text, 0), default=DEFAULT_BASE_ID, help="such as 0x680"
    )
    parser.add_argument("--extended", action="store_true", help="29-bit ids")
    options = parser.parse_args()
    try:
        for fd, name in FILES.items():
            text = dbc_text(fd, options.base_id, options.extended)
            (options.folder / name).write_text(text, encoding="ascii")
    except (ConfigError, OSError) as error:
        parser.error(str(error))


if __name__ == "__main__":
    main()
