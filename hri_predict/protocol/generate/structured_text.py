"""Parse our structured text into parts, which ``plcopen`` and ``scl`` write in their own formats.

Only the subset of IEC 61131-3 used in ``drivers/plc`` is supported; the rest is refused.
"""

import re
from collections.abc import Iterator
from dataclasses import dataclass, field

from hri_predict.base.errors import ConfigError

FILES = (
    "hri_fields.st",
    "hri_advice.st",
    "hri_send.st",
    "hri_serial.st",
    "hri_modbus.st",
)  # each uses those before it
_UNIT = re.compile(
    r"^(FUNCTION|FUNCTION_BLOCK) (\w+)(?: : (\w+))?\n(.*?)^END_\1$", re.DOTALL | re.MULTILINE
)
_COMMENT = re.compile(r"\s*\(\*\s*(.*?)\s*\*\)\n", re.DOTALL)
_SECTION = re.compile(r"\s*(VAR\w*(?: CONSTANT)?)\n(.*?)END_VAR\n", re.DOTALL)
_VARIABLE = re.compile(
    r"(\w+) : (?:ARRAY\[(\d+)\.\.(\d+)\] OF )?(\w+)(?: := ([^;]+))?;(?:\s*\(\*\s*(.*?)\s*\*\))?"
)


@dataclass(frozen=True)
class Variable:
    """One declaration; ``kind`` is the element type if there are ``bounds``."""

    name: str
    kind: str
    bounds: tuple[str, str] | None
    initial: str | None
    comment: str


@dataclass(frozen=True)
class Unit:
    """A function (``returns`` is its type) or a function block.

    Attributes:
        sections: variables by ``VAR_INPUT``, ``VAR_OUTPUT``, ``VAR`` or ``VAR CONSTANT``.
        body: the statements, with their comments.
    """

    name: str
    returns: str | None
    comment: str
    sections: dict[str, list[Variable]] = field(default_factory=dict)
    body: str = ""


def units(text: str) -> Iterator[Unit]:
    """Return the functions and function blocks of a source, in order.

    Raises:
        ConfigError: there is none, or a declaration cannot be parsed.
    """
    found = 0
    for match in _UNIT.finditer(text):
        found += 1
        yield _unit(match[2], match[3], match[4])
    if not found:
        raise ConfigError("it has no FUNCTION or FUNCTION_BLOCK; provide structured text")


def _unit(name: str, returns: str | None, rest: str) -> Unit:
    comment = ""
    if match := _COMMENT.match(rest):
        comment, rest = match[1], rest[match.end() :]
    sections: dict[str, list[Variable]] = {}
    while match := _SECTION.match(rest):
        sections[match[1]] = list(_variables(name, match[2]))
        rest = rest[match.end() :]
    return Unit(name, returns, comment, sections, rest.strip("\n"))


def _variables(unit: str, text: str) -> Iterator[Variable]:
    place = 0
    while text[place:].strip():
        gap = len(text[place:]) - len(text[place:].lstrip())
        match = _VARIABLE.match(text, place + gap)
        if match is None:
            line = text[place:].strip().splitlines()[0]
            raise ConfigError(f"{unit}: cannot parse the declaration: {line}; write NAME : TYPE;")
        name, low, high, kind, initial, comment = match.groups()
        bounds = (low, high) if low else None
        yield Variable(name, kind, bounds, initial, comment or "")
        place = match.end()
