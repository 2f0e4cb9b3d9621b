"""Overview of all cells: the last report of each node, and whether it is still valid.

The view does not permit motion: no robot may move because of it. Still, it must never claim more
than is known. A level is shown only if it is recent by our own clock, its capture is not too old,
the node uses our schema, and only one node sends under the cell's key.
"""

import threading
from collections import deque
from dataclasses import dataclass, field
from typing import Any

from hri_predict.protocol.e2e import RESYNC
from hri_predict.protocol.keyed import Keyed, KeyedReceiver, split_key
from hri_predict.protocol.messages import Advice, Message, NodeState, Schema, Status
from hri_predict.protocol.reception import FORGET_S, SchemaGate
from hri_predict.risk.wording import reason_beside, troubles

MAX_CELLS = 256
SILENT_S = 0.5  # a node sends Status at least ten times a second
MAX_AGE_S = 1.0  # age of the capture; a view need not be as strict as a controller
DISPUTE_S = 1.0
DISPUTE = 3  # refused Status messages within DISPUTE_S; a restarted node causes two

SILENT = "silent"
UNKNOWN = "unknown"
NO_SCHEMA = "no schema received yet"
DISPUTED = "out of order: the node restarted, or two nodes use one key"


@dataclass(frozen=True, slots=True, kw_only=True)
class RobotRow:
    """State of a robot; ``level`` is a level's name in lower case, or *silent*."""

    robot: int
    level: str
    reason: str
    speed_limit_m_s: float | None
    separation_m: float | None


@dataclass(frozen=True, slots=True, kw_only=True)
class CellRow:
    """State of a cell.

    Attributes:
        site, cell: the cell's key.
        state: the node's state in lower case, or *silent*, or *unknown*.
        why: one line if something is wrong, otherwise empty.
        people: number of people in the cell; ``None`` if it is not known.
        age_s: current age of the newest capture.
        heard_s: seconds since the last Status; ``None`` before the first.
        robots: one row for each robot.
        lost: messages that never arrived.
        refused: messages that were invalid, repeated or out of order.
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
        """Return plain data for JSON, rounded to milliseconds and millimetres."""
        shown = {name: _rounded(getattr(self, name)) for name in self.__slots__}
        robots = [
            {name: _rounded(getattr(r, name)) for name in RobotRow.__slots__} for r in self.robots
        ]
        return shown | {"robots": robots}


@dataclass(slots=True, kw_only=True)
class _Cell:
    """The messages of one cell. ``*_ns`` are times of receipt on our clock."""

    receiver: KeyedReceiver = field(default_factory=KeyedReceiver)
    status: Status | None = None
    status_ns: int = 0
    schema: SchemaGate = field(default_factory=SchemaGate)
    heard_ns: int = 0
    advices: dict[int, tuple[Advice, int]] = field(default_factory=dict)
    disputed_ns: deque[int] = field(default_factory=lambda: deque(maxlen=DISPUTE))
    refused: int = 0
    out_of_order: int = 0
    jumped: int = 0  # Status messages refused in a row: a restarted node begins with some
    restarted_ns: int | None = None  # until the robots of the node before are forgotten

    @property
    def first_disputed_ns(self) -> int | None:
        """Time of the first of the newest ``DISPUTE`` refused Status messages."""
        return self.disputed_ns[0] if len(self.disputed_ns) == DISPUTE else None

    def take(self, unit: Keyed, now_ns: int) -> bool:
        """Return whether a level or the node's state changed."""
        before = self._said()
        self._take(unit, now_ns)
        return self._said() != before

    def _said(self) -> list[Any]:
        state = self.status and self.status.node_state
        return [state, self.schema.open, *(a.level for a, _ in self.advices.values())]

    def _take(self, unit: Keyed, now_ns: int) -> None:
        if now_ns - self.heard_ns > FORGET_S * 1e9:
            self.schema.reset()  # another node may send now, even with another version
        before = self.receiver.counters.counter_errors
        messages = self.receiver.feed(unit)
        if not messages:
            out_of_order = self.receiver.counters.counter_errors - before
            self.refused += 1
            self.out_of_order += out_of_order
            if out_of_order and unit.key == "status":
                self.disputed_ns.append(now_ns)
                self.jumped += 1
        for message in messages:
            self._note(message, now_ns)
        self._forget_robots(now_ns)

    def _forget_robots(self, now_ns: int) -> None:
        """Forget robots that a restarted node has not advised for ``FORGET_S`` since."""
        since_ns = self.restarted_ns
        if since_ns is not None and now_ns - since_ns > FORGET_S * 1e9:
            self.restarted_ns = None
            self.advices = {k: each for k, each in self.advices.items() if each[1] >= since_ns}

    def _note(self, message: Message, now_ns: int) -> None:
        if now_ns - self.heard_ns > FORGET_S * 1e9:
            self.advices.clear()  # nor need it have the robots of the node before
        self.heard_ns = now_ns
        if isinstance(message, Status):
            self.status, self.status_ns = message, now_ns
            if self.jumped >= RESYNC - 1:
                self.restarted_ns = now_ns
            self.jumped = 0
        elif isinstance(message, Schema):
            self.schema.take(message)
        elif isinstance(message, Advice):
            self.advices[message.robot] = (message, now_ns)


class Fleet:
    """All cells that sent messages. ``take`` and ``rows`` may be called from different threads.

    Args:
        silent_s: a cell, or the advice for a robot, is *silent* after this long without a message.

    Attributes:
        left_out: number of payloads ignored: cells beyond ``MAX_CELLS``, or unknown keys.
    """

    def __init__(self, silent_s: float = SILENT_S) -> None:
        self.left_out = 0
        self._silent_ns = round(silent_s * 1e9)
        self._cells: dict[tuple[str, str], _Cell] = {}
        self._lock = threading.Lock()

    def take(self, unit: Keyed, now_ns: int) -> bool:
        """Process a payload with its full key, received at ``now_ns``; never raises for any
        payload.

        Returns:
            Whether a level or the state of a node changed.
        """
        key = split_key(unit.key)
        with self._lock:
            if key is None or (key[:2] not in self._cells and len(self._cells) >= MAX_CELLS):
                self.left_out += 1
                return False
            cell = self._cells.setdefault((key.site, key.cell), _Cell())
            return cell.take(Keyed(key.what, unit.data), now_ns)

    def rows(self, now_ns: int) -> list[CellRow]:
        """Return the rows of all cells at ``now_ns``, sorted by site and cell."""
        with self._lock:
            return [self._row(*name, cell, now_ns) for name, cell in sorted(self._cells.items())]

    def row(self, site: str, cell: str, now_ns: int) -> CellRow:
        """Return the row at ``now_ns`` of a cell that has sent a message."""
        with self._lock:
            return self._row(site, cell, self._cells[site, cell], now_ns)

    def _row(self, site: str, name: str, cell: _Cell, now_ns: int) -> CellRow:
        status, since_ns = cell.status, now_ns - cell.status_ns
        first_ns = cell.first_disputed_ns
        disputed = first_ns is not None and now_ns - first_ns < DISPUTE_S * 1e9
        silent = not disputed and (status is None or since_ns > self._silent_ns)
        why = DISPUTED if disputed else self._trouble(cell, silent)
        holds = status is not None and not why
        return CellRow(
            site=site,
            cell=name,
            state=SILENT if silent else UNKNOWN if not holds else _name(status),
            why=why or _reason(status),
            people=status.people if status is not None and holds else None,
            age_s=_age_s(status, since_ns),
            heard_s=None if status is None else since_ns * 1e-9,
            robots=tuple(
                self._robot(*advice, SILENT if silent else UNKNOWN if not holds else None, now_ns)
                for _, advice in sorted(cell.advices.items())
            ),
            lost=cell.receiver.counters.counter_errors - cell.out_of_order,
            refused=cell.refused,
        )

    def _trouble(self, cell: _Cell, silent: bool) -> str:
        """Return why the cell's report is not trusted; empty if it is."""
        if silent:
            stopped = cell.status is not None and cell.status.node_state is NodeState.STOPPING
            return "the node was stopped" if stopped else "no messages"
        if cell.schema.heard is None:
            return NO_SCHEMA
        if not cell.schema.open:
            return "the node uses another version of the protocol"
        return ""

    def _robot(self, advice: Advice, heard_ns: int, instead: str | None, now_ns: int) -> RobotRow:
        """Return a robot's row; ``instead`` replaces its level if the cell is not trusted."""
        since_ns = now_ns - heard_ns
        age_s = _age_s(advice, since_ns)
        if instead is None and since_ns > self._silent_ns:
            instead = SILENT
        elif instead is None and (age_s is None or age_s > MAX_AGE_S) and advice.level in (1, 2, 3):
            instead = UNKNOWN  # it permits motion on an old capture
        if instead is not None:
            return RobotRow(
                robot=advice.robot,
                level=instead,
                reason=instead,
                speed_limit_m_s=None,
                separation_m=None,
            )
        limit, separation = advice.speed_limit_m_s, advice.separation_m
        return RobotRow(
            robot=advice.robot,
            level=_name(advice),
            reason=reason_beside(advice),
            speed_limit_m_s=limit,
            separation_m=separation,
        )


def _name(message: Status | Advice | None) -> str:
    assert message is not None
    value = message.node_state if isinstance(message, Status) else message.level
    return value.name.lower()


def _reason(status: Status | None) -> str:
    if status is None or status.node_state is NodeState.RUNNING:
        return ""
    return "; ".join(troubles(status.node_state, [status.reason]))


def _age_s(message: Status | Advice | None, since_ns: int) -> float | None:
    """Return the capture's age now: the age in the message plus the time since its receipt."""
    if message is None or message.age_s is None:
        return None
    return message.age_s + since_ns * 1e-9


def _rounded(value: Any) -> Any:
    return round(value, 3) if isinstance(value, float) else value
