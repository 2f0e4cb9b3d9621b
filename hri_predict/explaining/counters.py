"""Error counters that increased during an episode, of links and of the node."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from hri_predict.explaining.times import NS
from hri_predict.explaining.values import mapped, text, whole
from hri_predict.explaining.window import TimeWindow

BEFORE_NS, AFTER_NS = 3 * NS, 1 * NS
"""Counters are recorded once a second, so a moment's errors appear within the next second."""
_NORMAL = {
    "messages_sent", "bytes_sent", "messages_received", "bytes_received", "superseded", "decimated",
    "scenes", "scenes_in", "frames_in", "appeared", "left_by_exit", "stamps_evened", "seen_free",
    "echoes",
}  # fmt: skip
"""Counters that increase in a healthy cell."""
SLOW_SHARE = 0.1
"""Share of late and missed ticks above which the node's machine was too slow."""
DAMAGE = ("crc_errors", "malformed", "incomplete", "counter_errors")
"""Counters of messages on a disturbed wire."""


@dataclass(frozen=True, slots=True)
class Moved:
    """A counter and its increase; ``where`` is ``people``, ``node`` or a link's name."""

    where: str
    name: str
    by: int
    is_link: bool


@dataclass(frozen=True, slots=True)
class LinkNow:
    """A link at one instant: ``connected`` is ``None`` if not recorded."""

    name: str
    connected: bool | None
    last_error: str


def _values(data: Mapping[str, Any]) -> Iterator[tuple[tuple[str, str, bool], int]]:
    for where in ("people", "node"):
        for name, count in mapped(data.get(where)).items():
            if whole(count) is not None:
                yield (where, text(name), False), count
    for link, told in mapped(data.get("links")).items():
        for name, count in mapped(mapped(told).get("counters")).items():
            if whole(count) is not None:
                yield (text(link), text(name), True), count


def rise(before: Mapping[str, Any], after: Mapping[str, Any]) -> list[Moved]:
    """Return the increases between two messages of /node, without those of a healthy cell."""
    was = dict(_values(before))
    return [
        Moved(where, name, count - was.get((where, name, is_link), 0), is_link)
        for (where, name, is_link), count in _values(after)
        if name not in _NORMAL and count > was.get((where, name, is_link), 0)
    ]


def moved(window: TimeWindow, utc_ns: int) -> list[Moved]:
    """Return the increases from some seconds before a moment until the second after it."""
    around = [told for told in window.node if told.utc_ns <= utc_ns + AFTER_NS]
    early = [told for told in around if told.utc_ns <= utc_ns - BEFORE_NS]
    if not around:
        return []
    first = early[-1].data if early else {} if _is_start(window) else around[0].data
    return rise(first, around[-1].data)


def slow_ticks(window: TimeWindow, rises: Sequence[Moved], utc_ns: int) -> tuple[int, int] | None:
    """Return the late and the missed ticks around a moment if they are more than a tenth of all.

    ``None``: they are fewer, or the recording does not have these counters, as older ones do not.
    """
    own = {each.name: each.by for each in rises if each.where == "node" and not each.is_link}
    late, missed = own.get("late_ticks", 0), own.get("missed_ticks", 0)
    around = [t for t in window.status if utc_ns - BEFORE_NS <= t.utc_ns <= utc_ns + AFTER_NS]
    is_slow = late + missed > SLOW_SHARE * (len(around) + missed)
    return (late, missed) if is_slow else None


def _is_start(window: TimeWindow) -> bool:
    """Whether the window starts with the node, so that its counters started at 0."""
    cycle = whole(window.status[0].data.get("cycle")) if window.status else None
    return cycle is not None and cycle <= 1


def links_at(window: TimeWindow, utc_ns: int) -> list[LinkNow]:
    """Return the links in the first message of /node from ``utc_ns`` on, otherwise in the last
    one.
    """
    after = [told for told in window.node if told.utc_ns >= utc_ns]
    told = after[0] if after else window.node[-1] if window.node else None
    if told is None:
        return []
    found = []
    for name, link in mapped(told.data.get("links")).items():
        connected, error = mapped(link).get("connected"), mapped(link).get("last_error")
        known = connected if isinstance(connected, bool) else None
        found.append(LinkNow(text(name), known, "" if error is None else text(error)))
    return found
