"""A shift in numbers, counted in one pass over its recordings."""

import heapq
from collections import Counter
from dataclasses import dataclass, field
from typing import Any

from hri_predict.base.quantities.units import rounded
from hri_predict.explaining.counters import rise
from hri_predict.explaining.deciding import link_of, part_of
from hri_predict.explaining.episodes import (
    LEVEL_NAMES,
    Episode,
    EpisodeFinder,
    level_of,
    lost_s,
    robot_of,
)
from hri_predict.explaining.full_speed import full_speeds
from hri_predict.explaining.reason_clause import brief, reason_text
from hri_predict.explaining.recordings import Recordings
from hri_predict.explaining.shift.foresight import Foresight
from hri_predict.explaining.shift.spread import Spread
from hri_predict.explaining.times import NS, dated, shown
from hri_predict.explaining.values import listed, mapped, number, text
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


TOPICS = ("/advice", "/status", "/scene", "/forecast", "/zones", "/node", "/clock")
BINS = 40
"""Number of bins of the separation's histogram, 0.1 m each; the last bin holds the rest."""
_MOST_ROBOTS = 64
"""Above the node's maximum of robots; a forged file must not fill the memory."""


class Tally:
    """Counts message by message; ``result`` returns everything as plain data."""

    def __init__(self) -> None:
        self.robots: dict[str, RobotShift] = {}
        self.foresight = Foresight()
        self.conditions: dict[str, float] = {}
        self.counters: Counter[tuple[str, str, bool]] = Counter()
        self.clock_sets = 0
        self.dropped = self._dropped = 0
        self._node: Told | None = None
        self._status: Told | None = None
        self._first_ns: int | None = None
        self._last_ns = 0

    def add(self, told: Told, info: RecordingInfo) -> None:
        """Process the next message."""
        if self._first_ns is None:
            self._first_ns = told.utc_ns
        self._last_ns = max(self._last_ns, told.utc_ns)
        if told.topic.startswith("/advice"):
            name = robot_of(told.data)
            if name in self.robots or len(self.robots) < _MOST_ROBOTS:
                self.robots.setdefault(name, RobotShift(name)).add(told, info)
        elif told.topic == "/scene":
            self.foresight.scene(told, info)
        elif told.topic == "/forecast":
            self.foresight.forecast(told, info)
        elif told.topic == "/zones":
            self.foresight.zones(told)
        elif told.topic == "/status":
            self._conditions(told)
        elif told.topic == "/node":
            self._counted(told)
        elif told.topic == "/clock":
            self.clock_sets += abs(number(told.data.get("utc_moved_s")) or 0.0) > 1.0
            dropped = int(number(told.data.get("dropped")) or 0)
            before, self._dropped = self._dropped, dropped
            self.dropped += dropped - before if dropped >= before else dropped  # node restarted

    def _conditions(self, told: Told) -> None:
        last, self._status = self._status, told
        lasted_s = 0.0 if last is None else (told.utc_ns - last.utc_ns) / NS
        if last is not None and 0 <= lasted_s <= 1.0:
            for reason in {text(each) for each in listed(last.data.get("reasons"))}:
                self.conditions[reason] = self.conditions.get(reason, 0.0) + lasted_s

    def _counted(self, told: Told) -> None:
        """Add increases of the counters, which restart at 0 with the node."""
        last, self._node = self._node, told
        own = mapped(told.data.get("node")).get("scenes_in")
        was = None if last is None else mapped(last.data.get("node")).get("scenes_in")
        again = (number(own) or 0.0) < (number(was) or 0.0)
        before = {} if last is None or again else last.data
        for each in rise(before, told.data):
            self.counters[each.where, each.name, each.is_link] += each.by

    def finish(self, info: RecordingInfo) -> None:
        """Finish: there are no more messages."""
        for robot in self.robots.values():
            robot.finish(info)

    def result(self, recordings: Recordings) -> dict[str, Any]:
        """Return lengths in metres, times in seconds, shares from 0 to 1."""
        first_ns = self._first_ns or recordings.start_ns
        longest = [row for robot in self.robots.values() for row in robot.longest]
        longest.sort(key=lambda row: -row["seconds"])
        full = full_speeds(recordings.info)
        return {
            "cell": text(recordings.info.cell),
            "files": len(recordings.files),
            "from": dated(first_ns, recordings),
            "to": dated(self._last_ns, recordings),
            "has_utc": recordings.info.has_utc,
            "seconds": round((self._last_ns - first_ns) / NS, 1),
            "predictor": text(recordings.info.predictor),
            "robots": [
                _robot(robot, full.get(name), recordings) for name, robot in self.robots.items()
            ],
            "longest_stops": [
                {
                    **row,
                    "from": shown(row["from_utc_ns"], recordings),
                    "at": dated(row["worst_utc_ns"], recordings),
                }
                for row in longest[:LONGEST]
            ],
            "forecast": [
                {
                    "ahead_s": ahead_s,
                    "joints": int(spread.weight),
                    "mean_m": rounded(spread.mean),
                    "p50_m": rounded(spread.percentile(0.5)),
                    "p95_m": rounded(spread.percentile(0.95)),
                    "zone_joints": self.foresight.inside[ahead_s][1],
                    "coverage": _share(*self.foresight.inside[ahead_s]),
                }
                for ahead_s, spread in self.foresight.errors.items()
            ],
            "conditions": [
                {"reason": reason, "what": reason_text(reason), "seconds": round(seconds, 1)}
                for reason, seconds in sorted(self.conditions.items(), key=lambda i: -i[1])[:40]
            ],
            "counters": [
                {"where": where, "name": name, "link": is_link, "by": by}
                for (where, name, is_link), by in sorted(self.counters.items())
            ],
            "clock_sets": self.clock_sets,
            "dropped": self.dropped,
            "notes": list(recordings.notes),
        }


def tally(recordings: Recordings, start_ns: int | None, end_ns: int | None) -> dict[str, Any]:
    """Count a shift."""
    found = Tally()
    for told in recordings.read(TOPICS, start_ns=start_ns, end_ns=end_ns):
        found.add(told, recordings.info_at(told.utc_ns))
    found.finish(recordings.files[-1].info)
    speeds = [full_speeds(file.info) for file in recordings.files]
    if any(each != speeds[0] for each in speeds):
        recordings.notes.append(
            "max_speed_m_s was changed between the files: lost time and shares of the full speed "
            "are relative to that of the first; report the files separately for exact ones"
        )
    return found.result(recordings)


def _robot(robot: RobotShift, full_m_s: float | None, recordings: Recordings) -> dict[str, Any]:
    seconds = sum(robot.seconds.values())
    top = full_m_s or max((edge for edge, weight in robot.limits.rows(1001) if weight), default=0.0)
    near = [m for found in robot.near.values() for m in found]
    mean = robot.limits.mean
    return {
        "name": robot.name,
        "seconds": round(seconds, 1),
        "not_recorded_s": round(robot.not_recorded_s, 1),
        "seconds_at": {name: round(robot.seconds[name], 1) for name in LEVEL_NAMES},
        "stops": robot.stops.count,
        "stopped_s": round(robot.stops.seconds, 1),
        "lost_s": _lost(sum(kind.lost_s(top) for kind in robot.kinds.values()), top),
        "causes": [
            {
                "level": level,
                "reason": reason,
                "what": reason_text(reason),
                "count": kind.count,
                "seconds": round(kind.seconds, 1),
                "lost_s": _lost(kind.lost_s(top), top),
            }
            for (level, reason), kind in sorted(
                robot.kinds.items(), key=lambda item: -item[1].seconds
            )
        ],
        "near_misses": len(near),
        "nearest_miss_m": rounded(min(near, default=None)),
        "near_by_pair": [
            {"body_part": part, "robot_part": link, "count": len(found), "least_m": min(found)}
            for (part, link), found in sorted(robot.near.items(), key=lambda i: -len(i[1]))
        ],
        "nearest_m": None if robot.nearest is None else round(robot.nearest[0], 3),
        "nearest_at": None if robot.nearest is None else shown(robot.nearest[1], recordings),
        "separation": [[round(edge, 1), round(s, 1)] for edge, s in robot.separation.rows(BINS)],
        "age_p50_s": rounded(robot.ages.percentile(0.5)),
        "age_p99_s": rounded(robot.ages.percentile(0.99)),
        "top_m_s": round(top, 3),
        "permitted_share": None if mean is None or not top else round(mean / top, 4),
        "full_speed_share": rounded(robot.limits.share_at_least(top - 0.01) if top else None),
        "hours": [
            {
                "from": shown(max(key * HOUR_NS, recordings.start_ns), recordings, 0),
                "seconds_at": {name: round(hour.seconds[name], 1) for name in LEVEL_NAMES},
                "stops": hour.stops,
                "permitted_share": _share(hour.limit_s, sum(hour.seconds.values()) * top),
            }
            for key, hour in sorted(robot.hours.items())
        ],
    }


def _lost(seconds: float, top_m_s: float) -> float | None:
    return round(seconds, 1) if top_m_s else None


def _share(part: float, whole: float) -> float | None:
    return round(part / whole, 4) if whole else None
