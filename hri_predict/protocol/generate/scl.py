"""Structured text as Siemens SCL source, which TIA Portal imports ("external source files").

In SCL, local names have the form ``#Name``, block names are quoted, BEGIN ends the declarations,
and the local variables of a function are called temporary. The statements are the same.
"""

import re
from collections.abc import Iterable, Iterator

from hri_predict.protocol.generate.plcopen import ELEMENTARY
from hri_predict.protocol.generate.structured_text import Unit, Variable

_ORDER = ("VAR_INPUT", "VAR_OUTPUT", "VAR", "VAR CONSTANT")
_PIECE = re.compile(r"\(\*.*?\*\)|16#[0-9A-F]+|\w+|\s*:=|.|\n", re.DOTALL)


def scl(units: Iterable[Unit]) -> str:
    """Return one source with all ``units``, each after the units that it uses."""
    units = list(units)
    blocks = {unit.name for unit in units}
    return "\n".join(line for unit in units for line in _unit(unit, blocks))


def _unit(unit: Unit, blocks: set[str]) -> Iterator[str]:
    word = "FUNCTION" if unit.returns else "FUNCTION_BLOCK"
    yield f'{word} "{unit.name}"' + (f" : {unit.returns}" if unit.returns else "")
    yield "{ S7_Optimized_Access := 'TRUE' }"
    yield "VERSION : 0.1"
    if unit.comment:
        yield f"(* {unit.comment} *)"
    for section in _ORDER:
        if section in unit.sections:
            yield "VAR_TEMP" if unit.returns and section == "VAR" else section
            yield from map(_variable, unit.sections[section])
            yield "END_VAR"
    yield "BEGIN"
    yield _body(unit, blocks)
    yield f"END_{word}\n"


def _variable(variable: Variable) -> str:
    kind = variable.kind if variable.kind in ELEMENTARY else f'"{variable.kind}"'
    if variable.bounds:
        kind = f"ARRAY[{variable.bounds[0]}..{variable.bounds[1]}] OF {kind}"
    initial = f" := {variable.initial}" if variable.initial else ""
    comment = f"  (* {variable.comment} *)" if variable.comment else ""
    return f"    {variable.name} : {kind}{initial};{comment}"


def _body(unit: Unit, blocks: set[str]) -> str:
    local = {v.name for variables in unit.sections.values() for v in variables}
    pieces = _PIECE.findall(unit.body)
    depth, text = 0, ""
    for place, piece in enumerate(pieces):
        depth += {"(": 1, ")": -1}.get(piece, 0)
        follows = pieces[place + 1].strip() if place + 1 < len(pieces) else ""
        argument = depth > 0 and follows == ":="  # the callee's own name
        member = text.endswith(".")
        if piece == unit.name or (piece in local and not argument and not member):
            piece = f"#{piece}"
        elif piece in blocks:
            piece = f'"{piece}"'
        text += piece
    return text
