"""The tables of ``drivers/MODBUS.md`` and ``drivers/OPCUA.md``, generated from the register map."""

from collections.abc import Callable, Iterable

from hri_predict.protocol.generate.blocks import Blocks
from hri_predict.protocol.generate.document import table
from hri_predict.protocol.registers import (
    CHOOSE_BASE,
    CHOSEN,
    NEAREST,
    NODE,
    ROBOT,
    ROBOT_BASE,
    ROBOT_STRIDE,
    SETS,
    SETS_BASE,
    STATE,
    STATE_BASE,
    STATE_STRIDE,
    WRITE_BASE,
    WRITTEN,
    Register,
    placed,
)
from hri_predict.protocol.variables import (
    ARGUMENTS,
    INDEX,
    Variable,
    node_variables,
    robot_variables,
    type_of,
)


def _registers(registers: tuple[Register, ...], base: int, stride: int = 0) -> Callable[[], str]:
    def rows() -> str:
        return table(
            ("address", "name", "type", "unit", "without fresh data", "meaning"),
            (
                (
                    f"{base + at}" + (f" + {stride} r" if stride else ""),
                    f"`{register.name}`",
                    f"{'' if register.signed else 'U'}{'DINT' if register.words == 2 else 'INT'}",
                    register.unit,
                    "" if base >= WRITE_BASE else _stale(register),
                    register.text,
                )
                for at, register in placed(registers)
            ),
        )

    return rows


def _stale(register: Register) -> str:
    """Return the value of a register without fresh data, or state that it is kept."""
    if register.stale is None:
        return "stays"
    return f"{register.stale - (1 << 16) if register.signed else register.stale}"


MODBUS: Blocks = {
    "node": _registers(NODE, 0),
    "sets": _registers(SETS, SETS_BASE),
    "robot": _registers(ROBOT + NEAREST, ROBOT_BASE, ROBOT_STRIDE),
    "written": _registers(WRITTEN, WRITE_BASE),
    "chosen": _registers(CHOSEN, CHOOSE_BASE),
    "state": _registers(STATE, STATE_BASE, STATE_STRIDE),
}


def _variables(variables: Iterable[Variable]) -> str:
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


OPCUA: Blocks = {
    "node": lambda: _variables(node_variables()),
    "robot": lambda: _variables(robot_variables("r")),
    "acknowledge": lambda: _arguments(ARGUMENTS),
    "choose": lambda: _arguments(CHOSEN),
}
