"""The register map as OPC UA variables: single definition for ``drivers/OPCUA.md`` and the server.

Each register that the node writes becomes one variable with the same name, unit and meaning.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from hri_predict.protocol.registers import (
    NEAREST,
    NODE,
    ROBOT,
    SETS,
    SETS_BASE,
    WRITTEN,
    Register,
    nearest_address,
    robot_address,
)

NAMESPACE = "urn:hri-predict:registers"
INDEX = 2
"""Index of ``NAMESPACE`` in this server's array of namespaces."""
LEFT_OUT = frozenset({"PLC_ALIVE"})  # no PLC_HEARTBEAT is written: OPC UA has sessions
METHOD, CHOOSE = "Acknowledge", "ChooseSet"
ARGUMENTS = tuple(register for register in WRITTEN if register.name.startswith("ACK"))


@dataclass(frozen=True, slots=True)
class Variable:
    """A variable of the server.

    Attributes:
        node_id: string identifier in ``NAMESPACE``.
        address: address of the register's block in the register map.
    """

    node_id: str
    address: int
    register: Register

    @property
    def type(self) -> str:
        """OPC UA built-in type."""
        return type_of(self.register)


def type_of(register: Register) -> str:
    """Return the OPC UA built-in type for the values of a register."""
    return f"{'' if register.signed else 'U'}Int{16 * register.words}"


def node_variables() -> Iterator[Variable]:
    """Yield the variables of the node."""
    for register in NODE:
        if register.name not in LEFT_OUT:
            yield Variable(f"Node.{register.name}", 0, register)
    for register in SETS:
        yield Variable(f"Node.{register.name}", SETS_BASE, register)


def robot_variables(robot: int | str) -> Iterator[Variable]:
    """Yield the variables of a robot; ``"r"`` is a placeholder for any robot."""
    index = robot if isinstance(robot, int) else 0
    for address, block in ((robot_address(index), ROBOT), (nearest_address(index), NEAREST)):
        for register in block:
            yield Variable(f"Robots.{robot}.{register.name}", address, register)


def variables(robots: Sequence[int]) -> list[Variable]:
    """Return all variables of a server that advises these robots."""
    return [*node_variables(), *(each for robot in robots for each in robot_variables(robot))]
