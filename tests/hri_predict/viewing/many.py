"""Real messages of many cells, as what their page is fed with."""

from dataclasses import replace
from typing import Any

from hri_predict.operation.monitoring.fleet import Fleet
from hri_predict.operation.monitoring.fleet_changes import FleetChanges
from hri_predict.operation.monitoring.fleet_levels import tile
from hri_predict.protocol.keyed import KeyedSender, prefix
from hri_predict.protocol.messages import Level, Message, NodeState, Status
from hri_predict.protocol.reasons import Reason
from hri_predict.viewing.picture import Picture, empty_shapes
from tests.hri_predict.operation.monitoring.said import CLEAR, OURS, RUNNING

S = 1_000_000_000


class Cells:
    """Speaks for cells of the site *plant*, on a clock of its own."""

    def __init__(self) -> None:
        self.now_ns = 100 * S
        self.utc_s = 1.7e9
        self.fleet = Fleet()
        self.changes = FleetChanges(self.fleet, lambda: self.now_ns, lambda: self.utc_s)
        self._senders: dict[str, KeyedSender] = {}

    def say(self, cell: str, *messages: Message) -> bool:
        """Send these messages; return whether a level or a state changed."""
        sender = self._senders.setdefault(cell, KeyedSender())
        units = [sender.encode(message) for message in messages]
        key = prefix("plant", cell)
        news = [self.fleet.take(replace(u, key=key + u.key), self.now_ns) for u in units]
        return any(news)

    def advise(self, cell: str, level: Level, reason: Reason = Reason.NONE, **more: Any) -> None:
        """A whole cycle of a running node."""
        self.say(cell, OURS, RUNNING, replace(CLEAR, level=level, reason=reason, **more))

    def pass_s(self, seconds: float) -> None:
        """Let time pass."""
        self.now_ns += round(seconds * S)
        self.utc_s += seconds

    def facts(self, after: int = 0) -> dict[str, Any]:
        """What a page is told now."""
        return {
            "cells": [tile(row) for row in self.changes.look()],
            "changes": self.changes.after(after),
            "trouble": "",
            "left_out": self.fleet.left_out,
            "silent_s": 0.5,
        }

    def picture(self) -> Picture:
        """The same as a picture."""
        return Picture(self.facts(), **empty_shapes())


def forty() -> Picture:
    """Forty cells, some in each state, with the alerts of the last minutes."""
    cells, lines = Cells(), ("press", "weld", "paint", "pack", "mill")
    names = [f"{line}-{i:02}" for line in lines for i in range(1, 9)]
    bad: dict[str, tuple[Level, Reason, float | None]] = {
        "press-03": (Level.STOP, Reason.PERSON_NEAR, 0.0),
        "weld-02": (Level.SLOW, Reason.PERSON_APPROACHING, 0.25),
        "weld-07": (Level.SLOW, Reason.OUT_OF_VIEW, 0.4),
        "paint-05": (Level.WARN, Reason.ZONE_ENTRY_PREDICTED, 0.8),
        "pack-01": (Level.WARN, Reason.PERSON_APPROACHING, 0.9),
        "pack-06": (Level.UNKNOWN, Reason.INPUT_FROZEN, None),
        "mill-04": (Level.STOP, Reason.PERSON_LOST, 0.0),
    }
    clear: tuple[Level, Reason, float | None] = (Level.CLEAR, Reason.NONE, 1.0)
    levels = dict.fromkeys(names, clear)
    fault = replace(RUNNING, node_state=NodeState.FAULT, reason=Reason.NODE_FAULT)
    degraded = replace(RUNNING, node_state=NodeState.DEGRADED, reason=Reason.PREDICTOR_LATE)
    own: dict[str, Status] = {}
    quiet: set[str] = set()

    def speak(seconds: float) -> None:
        """All cycles of so many seconds, in a tenth of that; people's clock shows them all."""
        for _ in range(5):
            for name in names:
                level, reason, limit = levels[name]
                if name not in quiet:
                    advice = replace(CLEAR, level=level, reason=reason, speed_limit_m_s=limit)
                    cells.say(name, OURS, own.get(name, RUNNING), advice)
            cells.changes.look()
            cells.pass_s(0.15)
            cells.utc_s += seconds / 5

    for name in ("press-03", "weld-02", "pack-01"):  # what was, and has passed
        speak(41.0)
        levels[name] = bad[name]
        speak(7.0)
        levels[name] = clear
    for name, now in bad.items():
        speak(13.0)
        levels[name] = now
    quiet.add("weld-08")
    speak(23.0)
    own |= {"press-06": fault, "paint-07": degraded}
    speak(5.0)
    quiet.add("paint-02")
    speak(1.0)
    return cells.picture()
