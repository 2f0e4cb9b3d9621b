"""A shift in numbers, counted in one pass over its recordings."""

from collections import Counter
from typing import Any

from hri_predict.base.quantities.units import rounded
from hri_predict.explaining.counters import rise
from hri_predict.explaining.episodes import LEVEL_NAMES, robot_of
from hri_predict.explaining.reason_clause import reason_text
from hri_predict.explaining.recordings import Recordings
from hri_predict.explaining.shift.foresight import Foresight
from hri_predict.explaining.shift.robot import HOUR_NS, LONGEST, RobotShift
from hri_predict.explaining.speeds import full_speeds
from hri_predict.explaining.times import NS, dated, shown
from hri_predict.explaining.values import listed, mapped, number, text
from hri_predict.recording import RecordingInfo, Told

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
        self.dropped = 0
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
            self.dropped = max(self.dropped, int(number(told.data.get("dropped")) or 0))

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
    info = recordings.info
    for told in recordings.read(TOPICS, start_ns=start_ns, end_ns=end_ns):
        found.add(told, info)
    found.finish(info)
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
