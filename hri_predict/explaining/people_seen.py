"""People present at a moment: tracked or lost, how old, and which joints were seen."""

import re
from typing import Any

from hri_predict.base.skeleton import JOINTS, in_words
from hri_predict.explaining.bodies import SeenPerson, people_of
from hri_predict.explaining.times import NS
from hri_predict.explaining.values import listed, text, whole
from hri_predict.explaining.window import TimeWindow, newest
from hri_predict.recording import RecordingInfo, Told

_SPEED_UNKNOWN = re.compile(r"speed of person (\d+) unknown")
_FAST = re.compile(r"person (\d+) is fast: ([\w ]+?) ([\d.]+) m/s")
_PRESENT_NS = NS // 2
"""Maximum time without a scene for which a person is tracked."""


def people_seen(
    window: TimeWindow, info: RecordingInfo, utc_ns: int, detail: str
) -> list[dict[str, Any]]:
    """Each person at a moment.

    Returns:
        ``id``; ``state``: tracked or lost; ``last_seen_s`` ago; ``age_s`` of the capture, where a
        forecast gives it; ``observed`` of ``joints``; ``missing`` joints by name; ``speed``: "" if
        it is as the standard assumes.
    """
    last = _last_seen(window, info, utc_ns)
    lost = _lost(window, utc_ns, last)
    captures = _captures(newest(window.forecasts, utc_ns, 1.0))
    found: list[dict[str, Any]] = []
    mapped = info.joint_map.mapped
    for id_, (told, seen) in sorted(last.items()):
        if id_ not in lost and utc_ns - told.utc_ns > _PRESENT_NS:
            continue  # went by an exit, or was acknowledged
        missing = [n for n, has, at in zip(JOINTS, mapped, seen.observed, strict=True) if has > at]
        made = captures.get(id_)
        found.append(
            {
                "id": id_,
                "state": "lost" if id_ in lost else "tracked",
                "last_seen_s": round((utc_ns - told.utc_ns) / NS, 3),
                "last_seen_utc_ns": told.utc_ns,
                "age_s": None if made is None else round((made[1] - made[0]) / NS, 3),
                "observed": int(seen.observed.sum()),
                "joints": int(mapped.sum()),
                "missing": missing,
                "speed": _speed(detail, id_),
            }
        )
    for id_ in sorted(lost - set(last)):
        unseen = {"id": id_, "state": "lost", "last_seen_s": None, "last_seen_utc_ns": None}
        joints = {"observed": 0, "joints": int(mapped.sum()), "missing": [], "speed": ""}
        found.append(unseen | {"age_s": None} | joints)
    return found


def _last_seen(
    window: TimeWindow, info: RecordingInfo, utc_ns: int
) -> dict[int, tuple[Told, SeenPerson]]:
    found: dict[int, tuple[Told, SeenPerson]] = {}
    for told in window.scenes:
        if told.utc_ns <= utc_ns:
            found.update({seen.person: (told, seen) for seen in people_of(told, info.joint_map)})
    return found


def _lost(window: TimeWindow, utc_ns: int, last: dict[int, tuple[Told, SeenPerson]]) -> set[int]:
    """Zones hold lost people too; a person of them who is in no newer scene is lost."""
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
