"""Causes of a latch besides a stop, and what a restarted node must know of latches."""

from collections.abc import Mapping, Sequence
from typing import Any

from hri_predict.people.snapshot import PeopleSnapshot
from hri_predict.protocol.reasons import Reason
from hri_predict.risk.levels.machine import LevelMachine

MAX_LATCH_ID = 65_000
"""Latch ids wrap here: they are 16 bits on the wire."""
_BLIND = frozenset(
    (Reason.SOURCE_BLIND, Reason.INPUT_STALE, Reason.INPUT_FROZEN, Reason.INPUT_REPEATS)
)


class LatchIds:
    """Gives each latch its own id, over all robots and restarts."""

    def __init__(self) -> None:
        self.last = 0

    def __call__(self) -> int:
        """A new id, never 0."""
        self.last = self.last % MAX_LATCH_ID + 1
        return self.last


def causes_now(snapshot: PeopleSnapshot, untrusted: Sequence[Reason]) -> list[str]:
    """The present causes that may latch.

    Before the first capture, nothing was seen, so nothing can be lost from view: the cause is
    ``start``.
    """
    causes = []
    if snapshot.captures and not _BLIND.isdisjoint(untrusted):
        causes.append("blind")
    if snapshot.lost or Reason.ROOM_NOT_SEEN_EMPTY in untrusted:
        causes.append("lost")
    return causes


def remembered(machines: Mapping[str, LevelMachine], ids: LatchIds) -> dict[str, Any]:
    """The latches of all robots, by name, and the last id given."""
    return {
        "last_id": ids.last,
        "robots": {name: machine.remember() for name, machine in machines.items()},
    }


def recall(machines: Mapping[str, LevelMachine], ids: LatchIds, data: Mapping[str, Any]) -> None:
    """Take the latches that an earlier run left, and latch for ``restart``.

    A robot that this configuration does not have is left out.

    Raises:
        KeyError, TypeError, ValueError: ``data`` does not come from ``remembered``.
    """
    last = int(data["last_id"])
    if not 0 <= last <= MAX_LATCH_ID:
        raise ValueError(f"latch id {last}")
    ids.last = last
    for name, latch in data["robots"].items():
        if name in machines:
            machines[name].recall(latch)
    for machine in machines.values():
        machine.latch("restart")
