"""A second node with the same ids on one wire: it sees an empty room."""

from dataclasses import replace
from typing import Any

from hri_predict.protocol.can import CanFrame, CanReceiver, CanSender
from hri_predict.protocol.keyed import Keyed, KeyedReceiver, KeyedSender
from hri_predict.protocol.messages import Advice, Level, NodeState, RobotState, Status
from hri_predict.protocol.reasons import Reason
from hri_predict.protocol.reception import OURS
from hri_predict.protocol.serial import SerialReceiver, SerialSender

PERIOD_NS = 40_000_000
SCHEMA_NS = 1_000_000_000
CLEAR = Advice(
    robot=0,
    level=Level.CLEAR,
    reason=Reason.NONE,
    speed_limit_m_s=5.0,
    age_s=0.03,
)
STATUS = Status(node_state=NodeState.RUNNING, reason=Reason.NONE, people=0, predictor=0, cycle=0)


class EmptyRoom:
    """Says *clear* to every robot whose RobotState it hears, and echoes the state like a node.

    Args:
        base_id: base id of the CAN frames.
    """

    def __init__(self, base_id: int) -> None:
        self._base_id = base_id
        self._sender: Any = None
        self._receiver: Any = None
        self._echoes: dict[int, int] = {}
        self._due_ns = self._schema_ns = 0
        self._cycle = 0

    def hear(self, unit: Any) -> None:
        """Take a unit of the wire; the sender learns the kind of wire from it."""
        if self._sender is None:
            self._sender, self._receiver = _ends(unit, self._base_id)
        for message in self._receiver.feed(unit):
            if isinstance(message, RobotState):
                self._echoes[message.robot] = message.counter

    def says(self, now_ns: int) -> list[Any]:
        """The units that are due by now."""
        if self._sender is None or now_ns < self._due_ns:
            return []
        self._due_ns = now_ns + PERIOD_NS
        self._cycle += 1
        messages: list[Any] = [replace(STATUS, cycle=self._cycle)]
        if now_ns >= self._schema_ns:
            self._schema_ns = now_ns + SCHEMA_NS
            messages.append(OURS)
        for robot, echo in self._echoes.items():
            messages.append(replace(CLEAR, robot=robot, echo=min(echo, 65534)))
        units: list[Any] = []
        for message in messages:
            encoded = self._sender.encode(message)
            units += encoded if isinstance(encoded, list) else [encoded]
        return units


def _ends(unit: Any, base_id: int) -> tuple[Any, Any]:
    """A sender and a receiver for the wire that carries such units."""
    if isinstance(unit, CanFrame):
        kind = (unit.fd, base_id, unit.extended)
        return CanSender(*kind), CanReceiver(*kind)
    if isinstance(unit, Keyed):
        return KeyedSender(), KeyedReceiver()
    return SerialSender(), SerialReceiver()
