"""Causes of a latch besides a stop, and what a restarted node must know of latches."""

import secrets
from collections.abc import Mapping, Sequence
from typing import Any

from hri_predict.people.snapshot import PeopleSnapshot
from hri_predict.protocol.reasons import Reason
from hri_predict.risk.levels.machine import LevelMachine

MAX_LATCH_ID = 65_000
"""Latch ids wrap here: they are 16 bits on the wire."""


class LatchIds:
    """Numbers what is to be acknowledged: each number once, over all robots.

    Each run begins at a random number, so that an Acknowledge of an earlier run names nothing.

    Args:
        last: the number before the first; ``None``: a random one.
    """

    def __init__(self, last: int | None = None) -> None:
        self.last = random_latch_id() if last is None else last % MAX_LATCH_ID

    def __call__(self) -> int:
        """A new number, never 0."""
        self.last = self.last % MAX_LATCH_ID + 1
        return self.last


def random_latch_id() -> int:
    """First number of a run."""
    return secrets.randbelow(MAX_LATCH_ID)


def causes_now(snapshot: PeopleSnapshot, untrusted: Sequence[Reason]) -> list[str]:
    """The present causes that may latch.

    Before the first capture, nothing was seen, so nothing can be lost from view: the cause is
    ``start``.
    """
    of_reasons = {reason.row.latches for reason in untrusted}
    causes = []
    if snapshot.captures and "blind" in of_reasons:
        causes.append("blind")
    if snapshot.lost or "lost" in of_reasons:
        causes.append("lost")
    return causes


def remembered(machines: Mapping[str, LevelMachine]) -> dict[str, Any]:
    """The latches of all robots, by name."""
    return {"robots": {name: machine.remember() for name, machine in machines.items()}}


def recall(machines: Mapping[str, LevelMachine], data: Mapping[str, Any]) -> None:
    """Take the latches that an earlier run left, and latch for ``restart``.

    A robot that this configuration does not have is left out.

    Raises:
        KeyError, TypeError, ValueError: ``data`` does not come from ``remembered``.
    """
    for name, latch in data["robots"].items():
        if name in machines:
            machines[name].recall(latch)
    for machine in machines.values():
        machine.latch("restart")
