"""The tables of ``drivers/MODBUS.md``, generated from the register map."""

from collections.abc import Callable

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


def _table(registers: tuple[Register, ...], base: int, stride: int = 0) -> Callable[[], str]:
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


BLOCKS: Blocks = {
    "node": _table(NODE, 0),
    "sets": _table(SETS, SETS_BASE),
    "robot": _table(ROBOT + NEAREST, ROBOT_BASE, ROBOT_STRIDE),
    "written": _table(WRITTEN, WRITE_BASE),
    "chosen": _table(CHOSEN, CHOOSE_BASE),
    "state": _table(STATE, STATE_BASE, STATE_STRIDE),
}
