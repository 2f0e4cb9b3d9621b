"""Causes of a latch other than a stop, and the latch data that a restarted node needs."""

import secrets
from collections.abc import Mapping, Sequence
from typing import Any

from hri_predict.people.snapshot import PeopleSnapshot
from hri_predict.protocol.reasons import Reason
from hri_predict.risk.levels.machine import LevelMachine

MAX_LATCH_ID = 65_000
"""Latch ids wrap at this value, because they have 16 bits on the wire."""


class LatchIds:
    """Assigns ids for acknowledgement; each id is used once over all robots.

    Each run starts at a random id, so that an Acknowledge from an earlier run matches nothing.

    Args:
        last: id before the first one; ``None``: random.
    """

    def __init__(self, last: int | None = None) -> None:
        self.last = random_latch_id() if last is None else last % MAX_LATCH_ID

    def __call__(self) -> int:
        """Return a new id, never 0."""
        self.last = self.last % MAX_LATCH_ID + 1
        return self.last


def random_latch_id() -> int:
    """First id of a run."""
    return secrets.randbelow(MAX_LATCH_ID)


def causes_now(snapshot: PeopleSnapshot, untrusted: Sequence[Reason]) -> list[str]:
    """Return the present causes that may latch.

    Before the first capture no person was seen, so none can be lost: the cause is ``start``.
    """
    of_reasons = {reason.row.latches for reason in untrusted}
    causes = []
    if snapshot.captures and "blind" in of_reasons:
        causes.append("blind")
    if snapshot.lost or "lost" in of_reasons:
        causes.append("lost")
    return causes


def remembered(machines: Mapping[str, LevelMachine]) -> dict[str, Any]:
    """Return the latches of all robots, by name."""
    return {"robots": {name: machine.remember() for name, machine in machines.items()}}


def recall(machines: Mapping[str, LevelMachine], data: Mapping[str, Any]) -> None:
    """Restore the latches of an earlier run, and latch for ``restart``.

    Robots that are not in this configuration are ignored.

    Raises:
        KeyError, TypeError, ValueError: ``data`` is not a result of ``remembered``.
    """
    for name, latch in data["robots"].items():
        if name in machines:
            machines[name].recall(latch)
    for machine in machines.values():
        machine.latch("restart")
