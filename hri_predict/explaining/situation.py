"""One robot at one moment, with all data recorded around it."""

import re
from dataclasses import dataclass, field
from typing import Any

from hri_predict.base.errors import ConfigError, nearest
from hri_predict.base.skeleton import JOINTS, hidden_ends, in_words
from hri_predict.explaining.bodies import SeenPerson, people_of
from hri_predict.explaining.counters import LinkNow, Moved, links_at, moved
from hri_predict.explaining.deciding import part_of, person_of, stated_hidden
from hri_predict.explaining.episodes import Episode, episodes, level_of, severity, slows, waits
from hri_predict.explaining.recordings import Recordings
from hri_predict.explaining.times import NS, AskedTime, dated, shown
from hri_predict.explaining.values import listed, text, whole
from hri_predict.explaining.window import (
    AFTER_NS,
    BEFORE_NS,
    TOPICS,
    TimeWindow,
    newest,
)
from hri_predict.recording import RecordingInfo, Told

# -- people present at a moment: tracked or lost, how old, and which joints were seen --------------

_SPEED_UNKNOWN = re.compile(r"speed of person (\d+) unknown")
_FAST = re.compile(r"person (\d+) is fast: ([\w ]+?) ([\d.]+) m/s")
_PRESENT_NS = NS // 2
"""Maximum time without a scene for which a person is tracked."""


def people_seen(
    window: TimeWindow, info: RecordingInfo, utc_ns: int, detail: str
) -> list[dict[str, Any]]:
    """Return each person at one instant.

    Returns:
        One dict per person: ``id``; ``state``: tracked or lost; ``last_seen_s``: seconds since a
        joint was last seen, ``None`` if none was; ``age_s``: age of the capture when the last
        recorded forecast was made, which may be earlier, ``None`` without a forecast;
        ``observed``, ``joints``: numbers of observed and of available joints;
        ``missing``: names of the missing joints; ``unmapped``: names of joints that the source
        never delivers; ``speed``: "" if the standard's speed is used.
    """
    last = _last_seen(window, info, utc_ns)
    lost = _lost(window, utc_ns, last)
    joint_ns = _last_joint_ns(window, info, utc_ns)
    captures = _captures(newest(window.forecasts, utc_ns, 1.0))
    found: list[dict[str, Any]] = []
    mapped = info.joint_map.mapped
    unmapped = [name for name, has in zip(JOINTS, mapped, strict=True) if not has]
    for id_, (told, seen) in sorted(last.items()):
        if id_ not in lost and utc_ns - told.utc_ns > _PRESENT_NS:
            continue  # went by an exit, or was acknowledged
        missing = [n for n, has, at in zip(JOINTS, mapped, seen.observed, strict=True) if has > at]
        made, seen_ns = captures.get(id_), joint_ns.get(id_)
        found.append(
            {
                "id": id_,
                "state": "lost" if id_ in lost else "tracked",
                "last_seen_s": None if seen_ns is None else round((utc_ns - seen_ns) / NS, 3),
                "last_seen_utc_ns": seen_ns,
                "age_s": None if made is None else round((made[1] - made[0]) / NS, 3),
                "observed": int(seen.observed.sum()),
                "joints": int(mapped.sum()),
                "missing": missing,
                "unmapped": unmapped,
                "speed": _speed(detail, id_),
            }
        )
    for id_ in sorted(lost - set(last)):
        unseen = {"id": id_, "state": "lost", "last_seen_s": None, "last_seen_utc_ns": None}
        joints = {"observed": 0, "joints": int(mapped.sum()), "missing": [], "unmapped": unmapped}
        found.append(unseen | {"age_s": None} | joints | {"speed": ""})
    return found


def _last_seen(
    window: TimeWindow, info: RecordingInfo, utc_ns: int
) -> dict[int, tuple[Told, SeenPerson]]:
    found: dict[int, tuple[Told, SeenPerson]] = {}
    for told in window.scenes:
        if told.utc_ns <= utc_ns:
            found.update({seen.person: (told, seen) for seen in people_of(told, info.joint_map)})
    return found


def _last_joint_ns(window: TimeWindow, info: RecordingInfo, utc_ns: int) -> dict[int, int]:
    """Return when a joint of each person was last seen: a source may follow a body without any."""
    return {
        seen.person: told.utc_ns
        for told in window.scenes
        if told.utc_ns <= utc_ns
        for seen in people_of(told, info.joint_map)
        if seen.observed.any()
    }


def _lost(window: TimeWindow, utc_ns: int, last: dict[int, tuple[Told, SeenPerson]]) -> set[int]:
    """Zones include lost people; a person in a zone but in no newer scene is lost."""
    zones = newest(window.zones, utc_ns, 1.0)
    if zones is None:
        return set()
    ids = {id_ for id_ in listed(zones.data.get("ids")) if whole(id_) is not None}
    newest_scene = newest(window.scenes, utc_ns, 3600.0)
    arrived_ns = utc_ns if newest_scene is None else newest_scene.utc_ns
    return {i for i in ids if i not in last or arrived_ns > last[i][0].utc_ns + NS // 10}


def _captures(forecast: Told | None) -> dict[int, tuple[int, int]]:
    if forecast is None:
        return {}
    now_ns = whole(forecast.data.get("now_ns"))
    pairs = zip(
        listed(forecast.data.get("ids")), listed(forecast.data.get("capture_ns")), strict=False
    )
    return {i: (c, now_ns) for i, c in pairs if None not in (whole(i), whole(c)) and now_ns}


def _speed(detail: str, person: int) -> str:
    if any(int(match[1]) == person for match in _SPEED_UNKNOWN.finditer(detail)):
        return "unknown yet"
    for match in _FAST.finditer(detail):
        if int(match[1]) == person:
            return f"fast: {in_words(text(match[2]))} {match[3]} m/s"
    return ""


# --------------------------------------------------------------------------------------------------

_LOOK_S = (120, 1800)
"""Time spans searched for an episode's ends, or for the nearest episode, before all data are
read.
"""


@dataclass(frozen=True, slots=True, kw_only=True)
class Situation:
    """Attributes: ``advice`` is the advice to explain; ``episode`` is ``None`` if it does not slow
    the robot.
    """

    recordings: Recordings
    window: TimeWindow
    robot: str
    advice: Told
    episode: Episode | None
    people: list[dict[str, Any]]
    moved: list[Moved]
    links: list[LinkNow]
    also: dict[str, str] = field(default_factory=dict)

    @property
    def info(self) -> RecordingInfo:
        """Properties of the file that contains the moment."""
        return self.recordings.info_at(self.advice.utc_ns)

    @property
    def status(self) -> Told | None:
        """The node's state at this advice."""
        return newest(self.window.status, self.advice.utc_ns)

    def clock(self, utc_ns: int, digits: int = 1) -> str:
        """Format a time for display."""
        return shown(utc_ns, self.recordings, digits)


def situation(recordings: Recordings, at: AskedTime, robot: str | None) -> Situation:
    """Return the known facts about a moment.

    The most severe advice within the requested time is used, and among several the first with a
    reason other than waiting; without ``robot``, among all robots.

    Raises:
        ConfigError: the moment was not recorded, or recorded twice, or the robot does not exist.
    """
    start_ns, end_ns = at.start_ns - BEFORE_NS, at.start_ns + at.width_ns + AFTER_NS
    known = len(recordings.twice)
    window = TimeWindow.of(recordings.read(TOPICS, start_ns=start_ns, end_ns=end_ns))
    if len(recordings.twice) > known:
        names = " or ".join(str(path) for path in recordings.twice[-1])
        raise ConfigError(
            f"--at {dated(at.start_ns, recordings)}: the seconds around were recorded twice: the "
            f"wall clock was set back, or a file is a copy; name one file, {names}"
        )
    found = {name: told for name, each in window.advice.items() if (told := _worst(each, at))}
    if robot is not None and robot not in found:
        raise ConfigError(_no_robot(robot, [*(found or window.advice)], recordings))
    if not found:
        raise ConfigError(_nothing(recordings, at))
    chosen = robot or max(found, key=lambda name: severity(level_of(found[name].data)))
    advice = found[chosen]
    slowed = slows(advice.data)
    episode = episode_around(recordings, chosen, advice.utc_ns) if slowed else None
    detail, info = text(advice.data.get("detail")), recordings.info_at(advice.utc_ns)
    return Situation(
        recordings=recordings,
        window=window,
        robot=chosen,
        advice=advice,
        episode=episode,
        people=people_seen(window, info, advice.utc_ns, detail),
        moved=moved(window, advice.utc_ns),
        links=links_at(window, advice.utc_ns),
        also={name: level_of(t.data) for name, t in found.items() if name != chosen},
    )


def _no_robot(robot: str, there: list[str], recordings: Recordings) -> str:
    """Return that no robot has this name, or that it had no advice at that time."""
    named = [name for name, _ in recordings.info.robots]
    shown = f"available: {', '.join(there) or 'none'}"
    if robot in named or robot in there:
        return f"--robot {robot}: no advice for this robot at that time; {shown}"
    known = list(dict.fromkeys([*there, *named]))
    return f"--robot {robot}: no robot has this name{nearest(robot, known)}; {shown}"


def hidden_ends_in(about: Situation) -> int:
    """Return how many joints of the deciding body part were not seen, 0 to 2; if the advice does
    not state it, by the newest scene.
    """
    stated, person = stated_hidden(about.advice), person_of(about.advice)
    seen = next((each for each in about.people if each["id"] == person), None)
    if stated is not None or seen is None or seen["state"] == "lost":
        return stated or 0
    hidden = {*seen["missing"], *seen["unmapped"]}
    return hidden_ends(part_of(about.advice), [joint not in hidden for joint in JOINTS])


def _worst(advice: list[Told], at: AskedTime) -> Told | None:
    """Return the most severe advice within the requested time, or the last one before it."""
    within = [t for t in advice if at.start_ns <= t.utc_ns < at.start_ns + at.width_ns]
    before = newest(advice, at.start_ns)
    within = within if before is None or within else [before]
    return max(within, key=lambda t: (severity(level_of(t.data)), not waits(t.data)), default=None)


def _nothing(recordings: Recordings, at: AskedTime) -> str:
    first, last = recordings.start_ns, recordings.end_ns()
    unit = " UTC" if recordings.info.has_utc else " s"
    if first <= at.start_ns <= last:
        return (
            f"--at {dated(at.start_ns, recordings)}: nothing was recorded at that time; try another"
        )
    return (
        f"--at {dated(at.start_ns, recordings)}: not recorded; these recordings are from "
        f"{dated(first, recordings)} to {dated(last, recordings)}{unit}"
    )


def episode_around(recordings: Recordings, robot: str, utc_ns: int) -> Episode | None:
    """Return the complete episode that contains a moment, however long it is."""
    found = None
    for reach_s in (*_LOOK_S, None):
        start_ns = None if reach_s is None else utc_ns - reach_s * NS
        end_ns = None if reach_s is None else utc_ns + reach_s * NS
        for episode in _of_robot(recordings, robot, start_ns, end_ns):
            if episode.start_ns <= utc_ns <= episode.last_ns:
                found = episode
        if found is None:
            continue
        whole = start_ns is None or found.start_ns > start_ns + NS
        ended = end_ns is None or found.end_ns is not None or found.last_ns < end_ns - 3 * NS
        if whole and ended:
            break
    return found


def nearest_episodes(
    recordings: Recordings, robot: str, utc_ns: int
) -> tuple[Episode | None, Episode | None]:
    """Return the last episode before a moment, and the first one after it."""
    before = after = None
    for reach_s in (*_LOOK_S, None):
        start_ns = None if reach_s is None else utc_ns - reach_s * NS
        end_ns = None if reach_s is None else utc_ns + reach_s * NS
        found = list(_of_robot(recordings, robot, start_ns, end_ns))
        before = next((e for e in reversed(found) if e.start_ns <= utc_ns), None)
        after = next((e for e in found if e.start_ns > utc_ns), None)
        if before is not None and after is not None:
            break
    return before, after


def _of_robot(
    recordings: Recordings, robot: str, start_ns: int | None, end_ns: int | None
) -> list[Episode]:
    advice = recordings.read(["/advice"], start_ns=start_ns, end_ns=end_ns)
    return sorted(
        (e for e in episodes(advice) if e.robot == robot), key=lambda episode: episode.start_ns
    )
