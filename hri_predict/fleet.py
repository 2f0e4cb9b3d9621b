"""All cells at a glance: what each node last said, and whether that still holds.

A view, never a permission: no robot may move because of it. What it shows must still never be more
than is known, so a level stands only while it is fresh by our own clock, its capture is not too
old, the node's schema is ours, and one node alone speaks under the cell's key.
"""

import threading
from collections import deque
from dataclasses import dataclass, field
from typing import Any

from hri_predict.protocol.keyed_codec import Keyed, KeyedReceiver, split_key
from hri_predict.protocol.messages import Advice, Message, NodeState, Schema, Status
from hri_predict.protocol.reception import FORGET_S, SchemaGate

MAX_CELLS = 256
SILENT_S = 0.5  # Status comes at least ten times a second
MAX_AGE_S = 1.0  # of the capture; a view need not be as strict as a controller
DISPUTE_S = 1.0
DISPUTE = 3  # refused Statuses within DISPUTE_S; a node that was restarted makes two

SILENT = "silent"
UNKNOWN = "unknown"


@dataclass(frozen=True, slots=True)
class RobotRow:
    """What is known of a robot: ``level`` is a level's name in lower case, or *silent*."""

    robot: int
    level: str
    reason: str
    speed_limit_m_s: float | None
    separation_m: float | None


@dataclass(frozen=True, slots=True)
class CellRow:
    """What is known of a cell.

    Attributes:
        site, cell: its key.
        state: the node's state in lower case, or *silent*, or *unknown*.
        why: one line where something is amiss, else empty.
        people: how many are here; ``None`` where that is not known.
        age_s: age of the newest capture, now.
        heard_s: seconds since the last Status; ``None`` if there never was one.
        robots: one row each.
        lost, refused: messages that never came; and that were wrong, repeated or not in order.
    """

    site: str
    cell: str
    state: str
    why: str
    people: int | None
    age_s: float | None
    heard_s: float | None
    robots: tuple[RobotRow, ...]
    lost: int
    refused: int

    def as_dict(self) -> dict[str, Any]:
        """For JSON: numbers to the millisecond and millimetre."""
        shown = {name: _rounded(getattr(self, name)) for name in self.__slots__}
        robots = [
            {name: _rounded(getattr(r, name)) for name in RobotRow.__slots__} for r in self.robots
        ]
        return shown | {"robots": robots}


@dataclass(slots=True)
class _Cell:
    """What came of one cell. ``*_ns`` are times of receipt on our clock."""

    receiver: KeyedReceiver = field(default_factory=KeyedReceiver)
    status: Status | None = None
    status_ns: int = 0
    schema: SchemaGate = field(default_factory=SchemaGate)
    heard_ns: int = 0
    advices: dict[int, tuple[Advice, int]] = field(default_factory=dict)
    disputed_ns: deque[int] = field(default_factory=lambda: deque(maxlen=DISPUTE))
    refused: int = 0
    out_of_order: int = 0

    def take(self, unit: Keyed, now_ns: int) -> None:
        if now_ns - self.heard_ns > FORGET_S * 1e9:
            self.schema.reset()  # another node, of another version even, may speak now
        before = self.receiver.counters.counter_errors
        messages = self.receiver.feed(unit)
        if not messages:
            out_of_order = self.receiver.counters.counter_errors - before
            self.refused += 1
            self.out_of_order += out_of_order
            if out_of_order and unit.key == "status":
                self.disputed_ns.append(now_ns)
        for message in messages:
            self._note(message, now_ns)

    def _note(self, message: Message, now_ns: int) -> None:
        self.heard_ns = now_ns
        if isinstance(message, Status):
            self.status, self.status_ns = message, now_ns
        elif isinstance(message, Schema):
            self.schema.take(message)
        elif isinstance(message, Advice):
            self.advices[message.robot] = (message, now_ns)


class Fleet:
    """Every cell that was heard; safe between one thread that hears and one that shows.

    Args:
        silent_s: after how much silence a cell, or the advice for a robot, is *silent*.

    Attributes:
        left_out: payloads of cells beyond ``MAX_CELLS``, or under no key of ours.
    """

    def __init__(self, silent_s: float = SILENT_S) -> None:
        self.left_out = 0
        self._silent_ns = round(silent_s * 1e9)
        self._cells: dict[tuple[str, str], _Cell] = {}
        self._lock = threading.Lock()

    def take(self, unit: Keyed, now_ns: int) -> None:
        """Take a payload under its whole key, received at ``now_ns``; survives anything."""
        key = split_key(unit.key)
        with self._lock:
            if key is None or (key[:2] not in self._cells and len(self._cells) >= MAX_CELLS):
                self.left_out += 1
                return
            cell = self._cells.setdefault((key.site, key.cell), _Cell())
            cell.take(Keyed(key.what, unit.data), now_ns)

    def rows(self, now_ns: int) -> list[CellRow]:
        """What is known at ``now_ns``, by site and cell."""
        with self._lock:
            return [self._row(*name, cell, now_ns) for name, cell in sorted(self._cells.items())]

    def _row(self, site: str, name: str, cell: _Cell, now_ns: int) -> CellRow:
        status, since_ns = cell.status, now_ns - cell.status_ns
        silent = status is None or since_ns > self._silent_ns
        why = self._trouble(cell, silent, now_ns)
        holds = status is not None and not why
        return CellRow(
            site,
            name,
            SILENT if silent else UNKNOWN if not holds else _name(status),
            why or _reason(status),
            status.people if status is not None and holds else None,
            _age_s(status, since_ns),
            None if status is None else since_ns * 1e-9,
            tuple(
                self._robot(*advice, SILENT if silent else UNKNOWN if not holds else None, now_ns)
                for _, advice in sorted(cell.advices.items())
            ),
            cell.receiver.counters.counter_errors - cell.out_of_order,
            cell.refused,
        )

    def _trouble(self, cell: _Cell, silent: bool, now_ns: int) -> str:
        """Why nothing that the cell says may be shown as true; empty if it may."""
        if silent:
            stopped = cell.status is not None and cell.status.node_state is NodeState.STOPPING
            return "its node was stopped" if stopped else "nothing heard"
        if cell.schema.heard is None:
            return "its schema is not heard yet"
        if not cell.schema.open:
            return "its node has another version of the protocol"
        first_ns = cell.disputed_ns[0] if len(cell.disputed_ns) == DISPUTE else None
        if first_ns is not None and now_ns - first_ns < DISPUTE_S * 1e9:
            return "out of order: restarted, or two nodes under one key"
        return ""

    def _robot(self, advice: Advice, heard_ns: int, instead: str | None, now_ns: int) -> RobotRow:
        """``instead`` of the level, where the whole cell is not to be believed."""
        since_ns = now_ns - heard_ns
        age_s = _age_s(advice, since_ns)
        if since_ns > self._silent_ns:
            instead = SILENT
        elif instead is None and (age_s is None or age_s > MAX_AGE_S) and advice.level in (1, 2, 3):
            instead = UNKNOWN  # it permits by what was seen too long ago
        if instead is not None:
            return RobotRow(advice.robot, instead, instead, None, None)
        limit, separation = advice.speed_limit_m_s, advice.separation_m
        return RobotRow(advice.robot, _name(advice), advice.reason.text, limit, separation)


def _name(message: Status | Advice | None) -> str:
    assert message is not None
    value = message.node_state if isinstance(message, Status) else message.level
    return value.name.lower()


def _reason(status: Status | None) -> str:
    if status is None or status.node_state is NodeState.RUNNING:
        return ""
    return status.reason.text


def _age_s(message: Status | Advice | None, since_ns: int) -> float | None:
    """Age of the capture now: what the message says, and the time since."""
    if message is None or message.age_s is None:
        return None
    return message.age_s + since_ns * 1e-9


def _rounded(value: Any) -> Any:
    return round(value, 3) if isinstance(value, float) else value
