"""One robot's shift, advice by advice."""

import heapq
from dataclasses import dataclass, field
from typing import Any

from hri_predict.explaining.episodes import (
    LEVEL_NAMES,
    Episode,
    EpisodeFinder,
    level_of,
    lost_s,
)
from hri_predict.explaining.reason_clause import brief, link_of, part_of
from hri_predict.explaining.shift.spread import Spread
from hri_predict.explaining.times import NS
from hri_predict.explaining.values import mapped, number
from hri_predict.protocol.messages import Level
from hri_predict.recording import RecordingInfo, Told

LONGEST = 10
HOUR_NS = 3600 * NS
_NOT_RECORDED_S = 1.0
"""Maximum interval between advices: after a longer pause the state is unknown until the next
advice.
"""
_NEAR_SHARE, _MOVING_M_S = 0.2, 0.01
"""The same value as in the node (``risk/levels/near_miss.py``)."""


@dataclass(slots=True)
class Hour:
    """Seconds at each level, sum of limit x seconds, and number of stops started."""

    seconds: dict[str, float] = field(default_factory=lambda: dict.fromkeys(LEVEL_NAMES, 0.0))
    limit_s: float = 0.0
    stops: int = 0


@dataclass(slots=True)
class Kind:
    """Slowdowns or stops with the same reason."""

    count: int = 0
    seconds: float = 0.0
    lasted_s: float = 0.0
    permitted_m: float = 0.0

    def lost_s(self, full_m_s: float) -> float:
        """See ``Episode.lost_s``."""
        return lost_s(self.lasted_s, self.permitted_m, full_m_s)


class RobotShift:
    """Counts of one robot; memory grows only with the number of hours and kinds."""

    def __init__(self, name: str) -> None:
        self.name = name
        self.seconds = dict.fromkeys(LEVEL_NAMES, 0.0)
        self.not_recorded_s = 0.0
        self.hours: dict[int, Hour] = {}
        self.kinds: dict[tuple[str, str], Kind] = {}
        self.stops = Kind()  # without those that are only a run's start or end
        self.separation, self.limits = Spread(0.1), Spread(0.01)
        self.nearest: tuple[float, int] | None = None  # metres, UTC
        self.ages = Spread(0.001)
        self.near: dict[tuple[str, str], list[float]] = {}
        self._finder = EpisodeFinder()
        self._longest: list[tuple[float, int, dict[str, Any]]] = []
        self._last: Told | None = None
        self._near_ns: int | None = None
        self._made = 0

    def add(self, told: Told, info: RecordingInfo) -> None:
        """Process the next advice."""
        if (ended := self._finder.add(told)) is not None:
            self._ended(ended, info)
        last, self._last = self._last, told
        if last is not None:
            lasted_s = (told.utc_ns - last.utc_ns) / NS
            if 0 <= lasted_s <= _NOT_RECORDED_S:
                self._lasted(last, lasted_s)
            else:
                self.not_recorded_s += max(0.0, lasted_s)
        age_s = number(told.data.get("age_s"))
        if age_s is not None and age_s >= 0:
            self.ages.add(age_s)
        self._near_miss(told, info)

    def finish(self, info: RecordingInfo) -> None:
        """Finish: there is no more advice."""
        for episode in self._finder.rest():
            self._ended(episode, info)

    @property
    def longest(self) -> list[dict[str, Any]]:
        """The longest stops, longest first."""
        return [row for *_, row in sorted(self._longest, reverse=True)]

    def _lasted(self, last: Told, seconds: float) -> None:
        level, limit = level_of(last.data), number(last.data.get("speed_limit_m_s")) or 0.0
        hour = self.hours.setdefault(last.utc_ns // HOUR_NS, Hour())
        self.seconds[level] += seconds
        hour.seconds[level] += seconds
        hour.limit_s += limit * seconds
        self.limits.add(max(0.0, limit), seconds)
        separation_m = number(last.data.get("separation_m"))
        if separation_m is not None:
            near = max(0.0, separation_m), last.utc_ns
            self.separation.add(near[0], seconds)
            self.nearest = near if self.nearest is None else min(self.nearest, near)

    def _ended(self, episode: Episode, info: RecordingInfo) -> None:
        worst = episode.worst
        stops = not Level[worst.level].may_move
        is_stop = stops and not episode.is_of_run
        lasted_ns = episode.stopped_ns if stops else episode.last_ns - episode.start_ns
        seconds = lasted_ns / NS
        kind = self.kinds.setdefault((worst.level, worst.reason), Kind())
        kind.count += 1
        kind.seconds += seconds
        kind.lasted_s += (episode.last_ns - episode.start_ns) / NS
        kind.permitted_m += episode.permitted_m
        if not is_stop:
            return
        self.stops.count += 1
        self.stops.seconds += seconds
        self.hours.setdefault(episode.start_ns // HOUR_NS, Hour()).stops += 1
        row = {
            "from_utc_ns": episode.start_ns,
            "worst_utc_ns": worst.first.utc_ns,
            "seconds": round(seconds, 1),
            "robot": self.name,
            "level": worst.level,
            "reason": worst.reason,
            "why": brief(worst.first, info),
        }
        self._made += 1
        heapq.heappush(self._longest, (seconds, self._made, row))
        if len(self._longest) > LONGEST:
            heapq.heappop(self._longest)

    def _near_miss(self, told: Told, info: RecordingInfo) -> None:
        """Count a near miss; several ticks within a second are one."""
        grounds = mapped(told.data.get("grounds"))
        speed, slack = number(told.data.get("speed_m_s")), number(grounds.get("slack_m"))
        separation = number(grounds.get("separation_m"))
        if speed is None or slack is None or separation is None or speed <= _MOVING_M_S:
            return
        if not 0 <= slack < _NEAR_SHARE * (separation - slack):
            return
        before, self._near_ns = self._near_ns, told.utc_ns
        if before is None or told.utc_ns - before > NS:
            pair = part_of(told) or "-", link_of(told, info) or "-"
            self.near.setdefault(pair, []).append(separation)
