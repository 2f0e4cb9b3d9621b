"""Generate the parts of the structured text in ``drivers/plc`` that depend on the definition.

The block ``HRI_ADVICE_FIELDS``, which reads each field of an Advice, is written between two markers
in ``hri_fields.st``. The constants listed below are updated wherever a block declares them, and so
are the sizes of arrays for a serial frame. The rest is written by hand.
"""

import re

from hri_predict.protocol import e2e
from hri_predict.protocol.can import DEFAULT_BASE_ID
from hri_predict.protocol.definition import BY_TYPE, SCHEMA_HASH, SCHEMA_VERSION
from hri_predict.protocol.fields import ROBOT_STRIDE, Field
from hri_predict.protocol.generate import blocks
from hri_predict.protocol.generate.c_messages import bits_of, name_of
from hri_predict.protocol.messages import Acknowledge, Advice, Schema
from hri_predict.protocol.reception import FORGET_S
from hri_predict.protocol.registers import MAP_VERSION, NEAREST, ROBOT, placed
from hri_predict.protocol.robot_state import BASE_ROBOTS, ROBOT_STATE
from hri_predict.protocol.serial import MAX_ENCODED

_CONSTANT = re.compile(r"^( +([A-Z_0-9]+) : U\w+ := )[\w#]+(;)", re.MULTILINE)

_WHOLE_FRAME = re.compile(r"^( +(?:Line|Frame) : ARRAY\[0\.\.)\d+(\] OF BYTE;)", re.MULTILINE)
_WIDTH = 105


def constants() -> dict[str, str]:
    """Literals of the constants that depend on the definition, by name."""
    return {
        "SCHEMA_VERSION": f"{SCHEMA_VERSION}",
        "SCHEMA_HASH_LOW": f"16#{SCHEMA_HASH & 0xFFFF:04X}",
        "SCHEMA_HASH_HIGH": f"16#{SCHEMA_HASH >> 16:04X}",
        "MAX_DELTA": f"{e2e.MAX_DELTA}",
        "RESYNC": f"{e2e.RESYNC}",
        "FORGET_MS": f"{round(1000 * FORGET_S)}",
        "BASE_ID": f"16#{DEFAULT_BASE_ID:X}",
        "ROBOT_STRIDE": f"{ROBOT_STRIDE}",
        "ADVICE_NUMBER": f"{BY_TYPE[Advice].number}",
        "ADVICE_PARTS": f"{BY_TYPE[Advice].parts}",
        "SCHEMA_NUMBER": f"16#{BY_TYPE[Schema].number:X}",
        "ACKNOWLEDGE_NUMBER": f"16#{BY_TYPE[Acknowledge].number:X}",
        "STATE_NUMBER": f"{ROBOT_STATE.number}",
        "STATE_PARTS": f"{ROBOT_STATE.always}",
        "EXTRA_STRIDE": f"{ROBOT_STATE.extra[0].stride}",
        **{f"PART_{e.part}_NUMBER": f"16#{e.number:X}" for e in ROBOT_STATE.extra},
        "BASE_ROBOTS": f"{BASE_ROBOTS}",
        "LONGEST": f"{MAX_ENCODED}",
        "MAP_VERSION": f"{MAP_VERSION}",
        **{f"{register.name}_AT": f"{at}" for at, register in placed(ROBOT + NEAREST)},
    }


def camel(name: str) -> str:
    """Name of a variable: ``speed_limit_mm_s`` is ``SpeedLimitMmS``."""
    return "".join(word.capitalize() for word in name.split("_"))


def _kind(field: Field) -> str:
    size = {8: "SINT", 16: "INT", 32: "DINT"}[bits_of(field)]
    return size if field.signed else f"U{size}"


def _raw(field: Field, start: int) -> str:
    """The expression that reads a field from ``Payload``.

    Raises:
        ValueError: the structured text has no function for such a field.
    """
    byte, inside, bits = start // 8, start % 8, field.bits
    two = f"(Low := Payload[{byte}], High := Payload[{byte + 1}])"
    if field.signed and (inside, bits) == (0, 16):
        return f"HRI_INT{two}"
    if field.signed or inside + bits > 16:
        raise ValueError(f"{field.signal}: the structured text cannot read this kind of field")
    wide = inside + bits > 8
    raw = f"HRI_UINT{two}" if wide else f"BYTE_TO_USINT(Payload[{byte}])"
    raw += f" / {1 << inside}" if inside else ""
    raw += f" MOD {1 << bits}" if inside + bits not in (8, 16) else ""
    return f"UINT_TO_USINT({raw})" if wide and bits <= 8 else raw


def fields() -> str:
    """Return the block that reads the fields of an Advice."""
    d = BY_TYPE[Advice]
    outputs, statements, start = [], [], 0
    for f in d.fields:
        name = camel(name_of(f, d))
        code = "" if f.not_available is None else f"; {f.not_available}: not available"
        outputs += _declared(f"{name} : {_kind(f)};", f"(* {f.text}{code} *)")
        statements.append(f"{name} := {_raw(f, start)};")
        if f.enum and f.fallback is not None and sorted(f.enum) == list(range(len(f.enum))):
            statements += [f"IF {name} > {max(f.enum)} THEN", f"    {name} := {int(f.fallback)};"]
            statements.append("END_IF;")
        start += f.bits
    lines = [
        "FUNCTION_BLOCK HRI_ADVICE_FIELDS",
        "(* All fields of an Advice; a number that this program does not know is the safe one. *)",
        "VAR_INPUT",
        f"    Payload : ARRAY[0..{d.fixed_bytes - 1}] OF BYTE;",
        "END_VAR",
        "VAR_OUTPUT",
        *outputs,
        "END_VAR",
        *statements,
        "END_FUNCTION_BLOCK",
    ]
    return "\n".join(lines) + "\n"


def _declared(declaration: str, comment: str) -> list[str]:
    line = f"    {declaration:<36} {comment}"
    return [line] if len(line) <= _WIDTH else [f"    {declaration}", f"        {comment}"]


BLOCKS: blocks.Blocks = {"fields": fields}


def renewed(text: str) -> str:
    """Return a source with its generated block and constants updated."""
    known = constants()
    text = blocks.renewed(text, BLOCKS)
    if "LONGEST :" in text:  # the serial line's: a PLC does not refuse an index beyond its array
        text = _WHOLE_FRAME.sub(rf"\g<1>{MAX_ENCODED - 1}\2", text)
    return _CONSTANT.sub(lambda m: f"{m[1]}{known[m[2]]}{m[3]}" if m[2] in known else m[0], text)
