"""The messages of the node in C: structures, decoding, and printing in ``examples/decode.c``.

Member names are the signal names in lower case with the unit of one step: ``SPEED_LIMIT`` in steps
of 1 mm/s is ``speed_limit_mm_s``; ``A_X``, ``A_Y``, ``A_Z`` become one array ``a_mm``.
"""

import re
import textwrap
from collections.abc import Iterator

from hri_predict.protocol.definition import DEFINITIONS
from hri_predict.protocol.fields import Definition, Field
from hri_predict.protocol.messages import Level, NodeState, OperatingMode, RobotMode
from hri_predict.protocol.reasons import Reason

SENT = [d for d in DEFINITIONS if d.sender == "node"]
BODIES = [d for d in SENT if d.item]
ENUMS = {
    Level: "LEVEL",
    Reason: "REASON",
    NodeState: "NODE_STATE",
    RobotMode: "MODE",
    OperatingMode: "OPERATING_MODE",
}
"""Prefix of each enumeration's C constants, after ``HRI_``."""

_PREFIXES = {1: "", 10: "d", 100: "c", 1000: "m", 1_000_000: "u"}
_WIDTH = 100


def snake(definition: Definition) -> str:
    """Name of a message in capitals, such as ROBOT_STATE."""
    return re.sub(r"(?<!^)(?=[A-Z])", "_", definition.name).upper()


def name_of(field: Field, definition: Definition) -> str:
    """Name of a field in the C structure of its message."""
    name = field.signal.removeprefix(f"{snake(definition)}_").lower()
    return name + _unit(field)


def _unit(field: Field) -> str:
    """Suffix of the name: the unit of one step, such as ``_mm_s``, or ``_steps`` without a unit."""
    if not field.scale:
        return ""
    if not field.unit or field.scale not in _PREFIXES:
        return "_steps"
    return f"_{_PREFIXES[field.scale]}{field.unit.replace('/', '_')}"


def bits_of(field: Field) -> int:
    """Width in bits of the C type of a field."""
    return next(bits for bits in (8, 16, 32) if bits >= field.bits)


def _type(field: Field) -> str:
    return "bool" if field.flag else f"{'' if field.signed else 'u'}int{bits_of(field)}_t"


def not_available(field: Field) -> str:
    """Name of the constant for "not available"."""
    return f"HRI_NO_{'I' if field.signed else 'U'}{field.bits}"


def codes() -> dict[str, str]:
    """Name -> C literal of each code for "not available" that the node may send."""
    found = {}
    for d in SENT:
        for f in (*d.fields, *d.item):
            code = f.not_available
            if code is not None:
                literal = f"(-{-code - 1} - 1)" if f.signed else f"0x{code:X}u"
                found[not_available(f)] = literal
    return dict(sorted(found.items()))


def _members(fields: tuple[Field, ...], d: Definition) -> Iterator[tuple[str, int, list[Field]]]:
    """Yield (name, first bit, fields) of each member; the fields of a point are one array."""
    start, i = 0, 0
    while i < len(fields):
        three = list(fields[i : i + 3])
        stems = {re.sub(r"_?[XYZ]$", "", f.signal) for f in three}
        axes = [f.signal[-1] for f in three]
        if axes == ["X", "Y", "Z"] and len(stems) == 1:
            stem = stems.pop().lower() or "position"
            yield stem + _unit(three[0]), start, three
        else:
            three = three[:1]
            yield name_of(fields[i], d), start, three
        i += len(three)
        start += sum(f.bits for f in three)


def _structure(name: str, fields: tuple[Field, ...], d: Definition, more: str = "") -> str:
    lines = ["typedef struct {"]
    for member, _, held in _members(fields, d):
        f = held[0]
        code = f"{not_available(f)}: not available" if f.optional else ""
        names = f"HRI_{ENUMS[f.enum]}_..." if f.enum in ENUMS else ""
        comment = "; ".join(filter(None, (f.text.removesuffix("."), names, code)))
        array = f"[{len(held)}]" if len(held) > 1 else ""
        lines += _declared(f"{_type(f)} {member}{array};", comment)
    return "\n".join(lines) + f"\n{more}}} {name};\n"


def _declared(declaration: str, comment: str) -> list[str]:
    line = f"    {declaration} /* {comment} */"
    if len(line) <= _WIDTH:
        return [line]
    above = textwrap.wrap(f"/* {comment} */", _WIDTH - 4)
    return [f"    {above[0]}", *(f"     * {text}" for text in above[1:]), f"    {declaration}"]


def kinds() -> str:
    """Return the constants of the message kinds, and of their number."""
    rows = ["#define HRI_NOTHING 0u"]
    rows += [f"#define HRI_{snake(d)} {i}u" for i, d in enumerate(SENT, 1)]
    return "\n".join((*rows, f"#define HRI_KINDS {len(SENT) + 1}u")) + "\n"


def _held(d: Definition) -> str:
    """Name of the structure that holds a message, without ``hri_``."""
    return "body" if d.item else snake(d).lower()


def structures() -> str:
    """Return the structures of all messages that a controller receives.

    Raises:
        ValueError: two messages with items differ in their other fields.
    """
    if len({d.fields for d in BODIES}) > 1:
        raise ValueError("the C code keeps messages with items in one hri_body: one row of fields")
    parts = [_structure(f"hri_{_held(d)}", d.fields, d) for d in SENT if not d.item]
    arrays, content = "", []
    for d in BODIES:
        one = d.items.removesuffix("s")
        parts.append(_structure(f"hri_{one}", d.item, d))
        arrays += f"    hri_{one} {d.items}[HRI_{snake(d)}_ITEMS];\n"
        content.append(f"a {d.name} ({d.items})")
    if BODIES:
        what = f"/* One frame of {' or of '.join(content)}: items first .. first + count - 1. */\n"
        parts.append(what + _structure("hri_body", BODIES[0].fields, BODIES[0], arrays))
    held = "".join(f"    hri_{h} {h};\n" for h in dict.fromkeys(map(_held, SENT)))
    why = "/* The newest message of each kind; no union (MISRA C:2012, rule 19.2). */\n"
    return "\n".join((*parts, f"{why}typedef struct {{\n{held}}} hri_message;\n"))


def _raw(field: Field, start: int) -> str:
    """Return the C expression that reads a field from the payload ``p``.

    Raises:
        ValueError: a signed field does not fill whole bytes.
    """
    byte, inside, bits = start // 8, start % 8, field.bits
    if inside == 0 and bits in (16, 32):
        return f"get_{'i' if field.signed else 'u'}{bits}(&p[{byte}])"
    if field.signed:
        raise ValueError(f"{field.signal}: the C code reads signed fields of 16 or 32 bits only")
    if inside == 0 and bits == 8:
        return f"p[{byte}]"
    if inside + bits > 8:
        return f"({_type(field)})get_bits(p, {start}u, {bits}u)"
    shifted = f"(p[{byte}] >> {inside})" if inside else f"p[{byte}]"
    kept = shifted if inside + bits == 8 else f"({shifted} & {(1 << bits) - 1}u)"
    return f"({_type(field)}){kept}"


def _read(field: Field, start: int) -> str:
    """Like ``_raw``, but an unknown value becomes the fallback of its enumeration."""
    raw = _raw(field, start)
    if field.flag:
        return f"({raw} == 1u)"
    enum, fallback = field.enum, field.fallback
    if enum is None or fallback is None or sorted(enum) != list(range(len(enum))):
        return raw
    prefix = f"HRI_{ENUMS[enum]}_"
    return f"known({raw},\n        {prefix}{max(enum).name}, {prefix}{fallback.name})"


def _reading(fields: tuple[Field, ...], d: Definition) -> tuple[list[str], list[str]]:
    """Return the statements that read fields into ``m``, and the conditions that they must meet."""
    statements, conditions = [], []
    for member, start, held in _members(fields, d):
        for i, f in enumerate(held):
            target = f"m->{member}[{i}]" if len(held) > 1 else f"m->{member}"
            statements.append(f"    {target} = {_read(f, start)};")
            start += f.bits
            if f.not_available is not None and not f.optional:
                conditions.append(f"({target} != {not_available(f)})")
    return statements, conditions


def _decoder(name: str, fields: tuple[Field, ...], d: Definition, more: str = "") -> str:
    """Return the function that reads ``fields`` into an hri_``name``."""
    statements, conditions = _reading(fields, d)
    if fields is d.fields:
        least = f"HRI_BYTES_{snake(d)}"
        short = [f"    if (length < {least}) {{", "        return false;", "    }"]
        statements = [*short, *statements]
        more = f", uint32_t length{more}"
    if d.item and fields is d.fields:
        conditions += [
            "(m->count <= room)",
            "(((uint32_t)m->first + m->count) <= m->total)",
            f"(length >= ({least} + (m->count * item_bytes)))",
        ]
    valid = " &&\n           ".join(conditions) or "true"
    head = f"static bool decode_{name}(hri_{name} *m, const uint8_t *p{more})"
    return "\n".join((head, "{", *statements, f"    return {valid};", "}\n"))


def decoding() -> str:
    """Return the functions that decode each message, and the function that dispatches to them."""
    parts = [_decoder(_held(d), d.fields, d) for d in SENT if not d.item]
    if BODIES:
        more = ",\n                        uint32_t room, uint32_t item_bytes"
        parts.append(_decoder("body", BODIES[0].fields, BODIES[0], more))
    for d in BODIES:
        one = d.items.removesuffix("s")
        parts.append(_decoder(one, d.item, d))
        parts.append(_ITEMS.format(d.name.lower(), snake(d), d.items, one))
    return "\n".join((*parts, _choice()))


_ITEMS = """\
static bool decode_{0}(hri_body *m, const uint8_t *p, uint32_t length)
{{
    bool valid = decode_body(m, p, length, HRI_{1}_ITEMS, HRI_ITEM_BYTES_{1});
    for (uint32_t i = 0u; valid && (i < m->count); i++) {{
        valid = decode_{3}(&m->{2}[i], &p[HRI_BYTES_{1} + (i * HRI_ITEM_BYTES_{1})]);
    }}
    return valid;
}}
"""


_CHOICE = """\
/* Decode into the newest message of its kind; refuse impossible values and change nothing. */
bool hri_lib_decode(hri_message *message, uint8_t kind, const uint8_t *p, uint32_t length)
{{
    hri_message next = *message;
    bool valid = false;
    switch (kind) {{
{0}    default:
        break; /* HRI_NOTHING */
    }}
    if (valid) {{
        *message = next;
    }}
    return valid;
}}
"""


def _choice() -> str:
    cases = ""
    for d in SENT:
        name = d.name.lower() if d.item else _held(d)
        cases += (
            f"    case HRI_{snake(d)}:\n"
            f"        valid = decode_{name}(&next.{_held(d)}, p, length);\n"
            "        break;\n"
        )
    return _CHOICE.format(cases)


_NUMBERS = """\
/* Kind of the frame with this number; HRI_NOTHING if it belongs to another robot or sender. */
uint8_t hri_lib_kind(uint32_t number, uint32_t robot, bool wide)
{{
    uint8_t kind = HRI_NOTHING;
    {0}{{
        /* not for us */
    }}
    return kind;
}}
"""


def numbers() -> str:
    """Return the function that maps a frame number to the kind of its message.

    Raises:
        ValueError: a message without a robot has several parts on classic CAN.
    """
    choices = ""
    for d in SENT:
        first, parts = f"HRI_NUMBER_{snake(d)}", f"HRI_PARTS_{snake(d)}"
        if d.per_robot:
            place = f"(number - ({first} + (HRI_ROBOT_STRIDE * robot)))"
            condition = f"{place} <\n        (wide ? 1u : {parts})"
        elif d.classic and d.parts > 1:
            raise ValueError(f"{d.name}: the C code assembles parts only for messages per robot")
        else:
            condition = f"number == {first}" if d.classic else f"wide && (number == {first})"
        choices += f"if ({condition}) {{\n        kind = HRI_{snake(d)};\n    }} else "
    return _NUMBERS.format(choices)


def printing() -> str:
    """Return the function in ``examples/decode.c`` that prints a message."""
    lines = [
        "static void print_message(uint8_t kind, unsigned robot, const hri_message *message)",
        *("{", "    switch (kind) {"),
    ]
    for d in SENT:
        held = f"message->{_held(d)}"
        lines += [f"    case HRI_{snake(d)}:", f'        printf("{d.name}");']
        if d.per_robot:
            lines.append('        printf(" ROBOT=%u", robot);')
        lines += [f"        {line}" for line in _printed(d.fields, d, f"{held}.")]
        if d.item:
            lines.append(f"        for (unsigned i = 0; i < {held}.count; i++) {{")
            items = f"{held}.{d.items}[i]."
            lines += [f"            {line}" for line in _printed(d.item, d, items)]
            lines.append("        }")
        lines.append("        break;")
    lines += ["    default:", "        break;", "    }", "}"]
    return "\n".join(lines) + "\n"


def _printed(fields: tuple[Field, ...], d: Definition, held: str) -> Iterator[str]:
    """Yield a print statement for each field; for a field of an item, with its index i."""
    index, argument = ("_%u", "i, ") if fields is d.item else ("", "")
    for member, _, row in _members(fields, d):
        for i, f in enumerate(row):
            value = f"{held}{member}[{i}]" if len(row) > 1 else f"{held}{member}"
            long = bits_of(f) == 32
            code = ("%l" if long else "%") + ("d" if f.signed else "u")
            cast = f"({'' if f.signed else 'unsigned '}long)" if long else ""
            yield f'printf(" {f.signal}{index}={code}", {argument}{cast}{value});'
