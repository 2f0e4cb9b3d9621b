"""The tables of ``drivers/OPCUA.md``, generated from the register map."""

from collections.abc import Iterable

from hri_predict.protocol.generate.blocks import Blocks
from hri_predict.protocol.generate.document import table
from hri_predict.protocol.registers import CHOSEN, Register
from hri_predict.protocol.variables import (
    ARGUMENTS,
    INDEX,
    Variable,
    node_variables,
    robot_variables,
    type_of,
)


def _table(variables: Iterable[Variable]) -> str:
    return table(
        ("node id", "type", "unit", "without fresh data", "meaning"),
        (
            (
                f"`ns={INDEX};s={each.node_id}`",
                each.type,
                each.register.unit,
                "Uncertain" if each.register.stale is None else "Bad",
                each.register.text,
            )
            for each in variables
        ),
    )


def _arguments(registers: Iterable[Register]) -> str:
    return table(
        ("argument", "type", "meaning"),
        ((f"`{each.name}`", type_of(each), each.text) for each in registers),
    )


BLOCKS: Blocks = {
    "node": lambda: _table(node_variables()),
    "robot": lambda: _table(robot_variables("r")),
    "acknowledge": lambda: _arguments(ARGUMENTS),
    "choose": lambda: _arguments(CHOSEN),
}
