"""Detection of events: the ticks at which a stop, a fault or a near miss starts."""

from collections import Counter
from dataclasses import dataclass
from typing import Any

from hri_predict.node.listeners import Tick
from hri_predict.operation.evidence.settings import Kind
from hri_predict.protocol.messages import Advice, Level
from hri_predict.protocol.reasons import Reason
from hri_predict.risk.types import NearMiss

AGAIN_NS = 1_000_000_000
"""Minimum gap between two near misses that are counted separately."""
_FAULTS = (Level.UNKNOWN, Level.FAULT)


@dataclass(frozen=True, slots=True, kw_only=True)
class Event:
    """One event of one robot.

    Attributes:
        kind: see ``Kind``.
        robot: index of the robot.
        now_ns: time of the tick.
        advice: the robot's advice.
        near_miss: details of a near miss; otherwise ``None``.
    """

    kind: Kind
    robot: int
    now_ns: int
    advice: Advice
    near_miss: NearMiss | None = None


class Events:
    """Compares each tick with the ticks before it."""

    def __init__(self) -> None:
        self.count: Counter[Kind] = Counter()
        self.near_misses: Counter[tuple[int, str, int]] = Counter()
        self._levels: dict[int, Level] = {}
        self._near_ns: dict[int, int] = {}

    def of(self, tick: Tick) -> list[Event]:
        """Return the events that start with this tick."""
        found = [event for advice in tick.advices for event in self._level(tick, advice)]
        advices = {advice.robot: advice for advice in tick.advices}
        for miss in tick.assessment.near_misses if tick.assessment is not None else ():
            last_ns = self._near_ns.get(miss.robot)
            self._near_ns[miss.robot] = tick.now_ns
            if last_ns is not None and tick.now_ns - last_ns < AGAIN_NS:
                continue
            self.near_misses[miss.robot, miss.segment, miss.link] += 1
            found.append(
                Event(
                    kind="near_miss",
                    robot=miss.robot,
                    now_ns=tick.now_ns,
                    advice=advices[miss.robot],
                    near_miss=miss,
                )
            )
        self.count.update(event.kind for event in found)
        return found

    def _level(self, tick: Tick, advice: Advice) -> list[Event]:
        was = self._levels.get(advice.robot)
        self._levels[advice.robot] = advice.level
        kind: Kind
        if advice.level is Level.STOP and was is not Level.STOP:
            kind = "stop"
        elif advice.level in _FAULTS and was is not None and was not in _FAULTS:
            if advice.reason is Reason.STOPPING:  # the node was told to end
                return []
            kind = "fault"
        else:
            return []
        return [Event(kind=kind, robot=advice.robot, now_ns=tick.now_ns, advice=advice)]

    def report(self, robots: list[str], links: list[tuple[str, ...]]) -> dict[str, Any]:
        """Return counts by kind, and near misses by robot, body part and link, most frequent
        first.
        """
        return {
            "events": dict(self.count),
            "near_misses": [
                {"robot": robots[i], "body_part": part, "robot_link": links[i][link], "count": n}
                for (i, part, link), n in self.near_misses.most_common()
            ],
        }
