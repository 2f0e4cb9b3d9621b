"""Convert a sequence of fields to bytes and back, with functions compiled at import.

The bytes form one integer that contains the bits of all fields. Calling a function for each field
would cost four times as much as the arithmetic itself. So the arithmetic for all fields is written
as the source of one function and compiled, as in ``dataclasses``. The source is built from the
definition only, never from data.
"""

from collections.abc import Callable, Sequence
from math import ceil, floor
from typing import Any

from hri_predict.protocol.fields import Field

EPSILON = 1e-6
"""Tolerance in steps, against wrong rounding of decimal fractions, which are inexact in binary."""
_ROUNDED = {"down": "floor(s + EPSILON)", "up": "ceil(s - EPSILON)", "nearest": "round(s)"}


class Malformed(ValueError):
    """A payload with a correct CRC but an impossible length or value."""


Pack = Callable[[Any, Sequence[Any]], bytes]
"""Converts a message, and the values that are not attributes of it, to bytes."""
Unpack = Callable[[bytes], tuple[Any, ...]]
"""Converts bytes to the values of all fields; missing bytes at the end are read as zeros.

Raises:
    Malformed: a mandatory value is not available.
"""


def packer(fields: Sequence[Field], values: Sequence[str]) -> Pack:
    """Return a function that converts values to bytes.

    Numbers saturate at the ends of their range; ``None`` and NaN become "not available".

    Args:
        fields: the fields, in order.
        values: the expression that gives each field's value: ``m.NAME`` from the message, or
            ``c[INDEX]`` from the other values.
    """
    lines = []
    for index, (field, value) in enumerate(zip(fields, values, strict=True)):
        lines += [f"v = {value}", *_packing(field, f"r{index}")]
    parts = [f"r{index} << {shift}" for index, shift in enumerate(_shifts(fields))]
    size = sum(field.bits for field in fields) // 8
    lines.append(f"return ({' | '.join(parts)}).to_bytes({size}, 'little')")
    return _compiled("pack", "m, c", lines, {})


def unpacker(fields: Sequence[Field]) -> Unpack:
    """Return a function that converts bytes to values."""
    lines, known = ["bits = int.from_bytes(data, 'little')"], dict[str, Any]()
    for index, (field, shift) in enumerate(zip(fields, _shifts(fields), strict=True)):
        value = f"v{index}"
        lines.append(f"{value} = bits >> {shift} & {_mask(field)}")
        lines += _unpacking(field, value)
        if field.enum is not None:
            known[f"KNOWN_{value}"] = {int(e): e for e in field.enum}
            known[f"FALLBACK_{value}"] = field.fallback
    lines.append(f"return ({', '.join(f'v{index}' for index in range(len(fields)))},)")
    return _compiled("unpack", "data", lines, known)


def _packing(field: Field, raw: str) -> list[str]:
    """Return the lines that set ``raw`` to the bits of ``v``."""
    mask, (low, high) = _mask(field), field.raw_range
    missing = None if field.not_available is None else field.not_available & mask
    if field.wraps:
        return [f"{raw} = int(v) & {mask}"]
    if field.flag:
        return [f"{raw} = 1 if v is True else 0"]
    if not field.scale:
        none = f"raise ValueError('{field.signal} must be a number')"
        below, above = (missing, missing) if field.bounded else (low, high)
        return [
            f"if v is None: {none if missing is None else f'{raw} = {missing}'}",
            f"elif v < {low}: {raw} = {below}",
            f"elif v > {high}: {raw} = {above}",
            f"else: {raw} = int(v)",
        ]
    assert missing is not None  # every scaled field has the code
    below, above = (missing, missing) if field.bounded else (low & mask, high & mask)
    return [
        f"if v is None or v != v: {raw} = {missing}",
        "else:",
        f"    s = v * {field.scale}",
        f"    if s >= {high}: {raw} = {high & mask} if s < {high + 1} else {above}",
        f"    elif s <= {low}: {raw} = {low & mask} if s > {low - 1} else {below}",
        f"    else: {raw} = {_ROUNDED[field.rounding]} & {mask}",
    ]


def _unpacking(field: Field, value: str) -> list[str]:
    """Return the lines that convert ``value`` from raw bits to the field's value."""
    if field.enum is not None:
        return [f"{value} = KNOWN_{value}.get({value}, FALLBACK_{value})"]
    if field.flag:
        return [f"{value} = {value} == 1"]
    if field.not_available is None:
        return []
    missing = f"raise Malformed('{field.signal} is not available')"
    lines = [
        f"if {value} == {field.not_available & _mask(field)}: "
        f"{f'{value} = None' if field.optional else missing}"
    ]
    signed = f"({value} - {1 << field.bits} if {value} >> {field.bits - 1} else {value})"
    number = signed if field.signed else value
    if field.scale:
        return [*lines, f"else: {value} = {number} / {field.scale}"]
    return [*lines, f"else: {value} = {number}"] if field.signed else lines


def _compiled(name: str, arguments: str, lines: Sequence[str], more: dict[str, Any]) -> Any:
    text = f"def {name}({arguments}):\n" + "".join(f"    {line}\n" for line in lines)
    names: dict[str, Any] = {
        "floor": floor,
        "ceil": ceil,
        "EPSILON": EPSILON,
        "Malformed": Malformed,
        **more,
    }
    exec(compile(text, f"<{name} of a message>", "exec"), names)
    return names[name]


def _mask(field: Field) -> int:
    return (1 << field.bits) - 1


def _shifts(fields: Sequence[Field]) -> list[int]:
    """Return the position of each field's first bit."""
    return [sum(field.bits for field in fields[:index]) for index in range(len(fields))]
