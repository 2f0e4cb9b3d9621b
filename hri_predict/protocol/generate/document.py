"""The tables of ``drivers/PROTOCOL.md``, generated from the definition.

``hri-predict protocol document drivers/PROTOCOL.md`` regenerates the text between each line
``<!-- table: NAME -->`` and the next ``<!-- end -->``; the rest of the text is written by hand.
"""

from collections.abc import Callable, Iterable
from enum import IntEnum

from hri_predict.base.skeleton import CANONICAL
from hri_predict.protocol import e2e
from hri_predict.protocol.can import DEFAULT_BASE_ID, LAST_NUMBER
from hri_predict.protocol.definition import (
    BY_TYPE,
    DEFINITIONS,
    SCHEMA_HASH,
    SCHEMA_VERSION,
    frame_table,
)
from hri_predict.protocol.fields import (
    MAX_ROBOTS,
    PART_BYTES,
    Definition,
    Field,
    frame_number,
)
from hri_predict.protocol.generate import isotp
from hri_predict.protocol.generate.blocks import Blocks
from hri_predict.protocol.generate.dbc import frame_name
from hri_predict.protocol.generate.examples import EXAMPLES, encodings, fields_of, meaning
from hri_predict.protocol.messages import Level, Message, NodeState, OperatingMode, RobotMode
from hri_predict.protocol.reasons import Reason
from hri_predict.protocol.serial import MAX_DECODED, MAX_ENCODED
from hri_predict.protocol.wire import wire_bits


def table(head: Iterable[str], rows: Iterable[Iterable[object]]) -> str:
    """Return a Markdown table."""
    names = list(head)
    lines = ["| " + " | ".join(names) + " |", "|" + "---|" * len(names)]
    lines += ["| " + " | ".join(str(cell) for cell in row) + " |" for row in rows]
    return "\n".join(lines) + "\n"


def hexadecimal(data: bytes) -> str:
    """Return bytes in hexadecimal, two digits each."""
    return "`" + data.hex(" ").upper() + "`"


def field_table(definition: Definition) -> str:
    """Return the table of a message's fields, then the table of its repeated item."""
    text = _rows(definition, definition.fields)
    if definition.item:
        text += (
            f"\nThen COUNT items of {definition.item_bytes} bytes each, at most "
            f"{definition.items_per_frame} in a frame; byte 0 is the first byte of the item:\n\n"
        )
        text += _rows(definition, definition.item)
    return text


def _rows(definition: Definition, fields: tuple[Field, ...]) -> str:
    rows, start = [], 0
    classic = definition.classic
    for f in fields:
        place = [_bytes(start, f.bits)]
        if classic:
            part = start // (8 * PART_BYTES)
            inside = start - 8 * PART_BYTES * part + 8 * e2e.PROFILE_2_HEADER
            place.append(f"part {part}, {_bytes(inside, f.bits)}")
        kind = f"{'INT' if f.signed else 'UINT'}{f.bits}"
        step = f"{f.resolution:g} {f.unit}" if f.scale else ""
        rows.append((f.signal, *place, kind, step, _range(f), _absent(f), _text(f)))
        start += f.bits
    head = ["signal", "payload byte"] + (["classic frame"] if classic else [])
    return table([*head, "type", "step", "range", "not available", "meaning"], rows)


def _bytes(start: int, bits: int) -> str:
    first, last = start // 8, (start + bits - 1) // 8
    if bits % 8:
        inside = f"bits {start % 8}..{start % 8 + bits - 1}"
        return f"{first}..{last}, {inside}" if last > first else f"{first}, {inside}"
    return f"{first}..{last}" if last > first else f"{first}"


def _range(f: Field) -> str:
    if f.enum:
        return "see below"
    low, high = f.raw_range
    if not f.scale:
        return f"{low}..{high}"
    return f"{low / f.scale:g}..{high / f.scale:g} {f.unit}"


def _absent(f: Field) -> str:
    if f.not_available is None:
        return ""
    code = f.not_available & ((1 << f.bits) - 1)
    return f"`16#{code:0{f.bits // 4}X}`" + ("" if f.optional else ", refuse")


def _text(f: Field) -> str:
    rounded = {"nearest": "", "down": " (rounded down)", "up": " (rounded up)"}
    return f.text + rounded[f.rounding]


def frames() -> str:
    """Return the table of frames: number, ids, sender and content."""
    rows = []
    for d in DEFINITIONS:
        for part in range(d.parts if d.classic else 1):
            number = frame_number(d, 0, part)
            robot = f" + {frame_number(d, 1, part) - number} r" if d.per_robot else ""
            rows.append(
                (
                    f"{number:#04x}{robot}",
                    f"`{DEFAULT_BASE_ID + number:#05x}`{robot}",
                    d.name + (f", part {part}" if d.classic and d.parts > 1 else ""),
                    d.sender,
                    _carried(d, part),
                    "yes" if part == 0 else "",
                    f"{d.cycle_ms} ms" if d.cycle_ms else "event" if d.classic else "spare load",
                )
            )
    head = ("number", "CAN id (default)", "message", "sender", "classic CAN", "FD, serial", "cycle")
    return table(head, rows)


def _carried(d: Definition, part: int) -> str:
    """Return whether, and under which condition, classic CAN carries a part."""
    if not d.classic:
        return "no"
    if part < d.always:
        return "yes"
    extra = d.extra[part - d.always]
    asked = f"if {extra.signal} is {extra.least} or more"
    return asked if extra.robots == MAX_ROBOTS else f"{asked}; r up to {extra.robots - 1}"


def reasons() -> str:
    """Return the table of the reasons and the conditions that clear them."""
    return table(
        ("value", "name", "meaning", "clears when"),
        ((int(r), r.name, r.text, r.clears_when or "–") for r in Reason),
    )


def enumeration(enum: type[IntEnum]) -> str:
    """Return the table of an enumeration's values."""
    return table(("value", "name"), ((int(e), e.name) for e in enum))


def data_ids() -> str:
    """Return the data ids of the frames of robot 0 and of the frames without a robot."""
    rows = []
    for number, (d, robot, part) in sorted(frame_table(classic=True).items()):
        if robot == 0:
            wide = f"`16#{e2e.data_id_16(number):04X}`" if part == 0 else ""
            serial = f"`16#{e2e.data_id_32(number):08X}`" if part == 0 else ""
            narrow = f"`16#{e2e.data_id_list(number)[0]:02X}`"
            rows.append((frame_name(d, 0, part, False), f"{number:#04x}", narrow, wide, serial))
    for d in DEFINITIONS:
        if not d.classic:
            ids = (f"`16#{e2e.data_id_16(d.number):04X}`", f"`16#{e2e.data_id_32(d.number):08X}`")
            rows.append((frame_name(d, 0, 0, True), f"{d.number:#04x}", "", *ids))
    head = ("frame", "number", "profile 2", "profile 5", "profile 4")
    return table(head, rows)


def sizes() -> str:
    """Return the worst-case size of each message on the wire."""
    rows = []
    for d in DEFINITIONS:
        classic = f"{wire_bits(d.type, 'can').nominal}" if d.classic else "-"  # of six joints
        fd, serial = wire_bits(d.type, "can_fd"), wire_bits(d.type, "serial")
        rows.append((d.name, classic, f"{fd.nominal} + {fd.data}", serial.nominal))
    return table(("message", "classic", "FD, nominal + data", "serial"), rows)


def example(message: Message) -> str:
    """Return the worked example of a message: the bytes as sent, then the payload by field."""
    units = []
    for link, identifier, data in encodings(message):
        name = link if identifier is None else f"{link}, id `{identifier:#05x}`"
        units.append((name, hexadecimal(data)))
    rows = [
        (f.signal, _bytes(start, f.bits), f"`16#{raw:0{(f.bits + 3) // 4}X}`", meaning(f, raw))
        for f, start, raw in fields_of(message)
    ]
    return (
        table(("link", "bytes in the order sent"), units)
        + "\n"
        + table(("signal", "payload byte", "raw", "means"), rows)
    )


def example_block(message: Message) -> Callable[[], str]:
    """Return the function that writes the example of one message."""
    return lambda: example(message)


def schema() -> str:
    """Return version and hash."""
    rows = [("SCHEMA_VERSION", SCHEMA_VERSION), ("SCHEMA_HASH", f"`16#{SCHEMA_HASH:08X}`")]
    return table(("constant", "value"), rows)


def names_of(words: Iterable[str]) -> str:
    """Return names with their indices."""
    return table(("index", "name"), enumerate(words))


def message_block(kind: type[Message]) -> Callable[[], str]:
    """Return the function that writes the table of one message."""
    return lambda: field_table(BY_TYPE[kind])


BLOCKS: Blocks = {
    **{d.name: message_block(d.type) for d in DEFINITIONS},
    "frames": frames,
    "fd frames": isotp.fd_frames,
    "isotp sizes": isotp.sizes,
    "isotp example": isotp.example,
    "levels": lambda: enumeration(Level),
    "node states": lambda: enumeration(NodeState),
    "robot modes": lambda: enumeration(RobotMode),
    "operating modes": lambda: enumeration(OperatingMode),
    "reasons": reasons,
    "data ids": data_ids,
    "sizes": sizes,
    "schema": schema,
    "segments": lambda: names_of(s.name for s in CANONICAL.segments),
    "joints": lambda: names_of(CANONICAL.joints),
    **{f"{BY_TYPE[type(m)].name} example": example_block(m) for m in EXAMPLES},
    "limits": lambda: table(
        ("constant", "value"),
        (
            ("robots on one link, at most", MAX_ROBOTS),
            ("highest base id, 11 bits", f"`16#{0x7FF - LAST_NUMBER:X}`"),
            ("highest base id, 29 bits", f"`16#{0x1FFFFFFF - LAST_NUMBER:X}`"),
            ("MAX_DELTA", e2e.MAX_DELTA),
            ("RESYNC", e2e.RESYNC),
            ("longest serial frame, bytes, before COBS", MAX_DECODED),
            ("longest serial frame after COBS, without the 16#00", MAX_ENCODED),
        ),
    ),
}
