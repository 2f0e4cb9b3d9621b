"""Compare another version or configuration with the validated one on the same recorded walk.

A result is *less safe* if, at any tick, it permits more than the validated one, or sees less: a
milder level, a higher speed limit, a missing or later stop, no person where one was seen, less of
the floor seen, or more people lost. Changes in the safe direction are listed, but are not faults.
Nor are changed separations: wider margins look farther ahead and may report larger or smaller
values. A stricter configuration includes more of the floor, so the walk may cover too little of it:
the result is not less safe, but the cell is no longer validated.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field

from hri_predict.commissioning.playback import AdviceRow, Played
from hri_predict.commissioning.report import GridResult, RobotAdvice, Walk
from hri_predict.commissioning.walk import advice_by_robot
from hri_predict.protocol.messages import Level

SAME_M = 0.002
"""Smaller differences in distance, in metres, are due to rounding on another processor."""
SAME_M_S = 0.002
"""Smaller differences in speed, in m/s, are due to rounding on another processor."""


@dataclass(slots=True)
class Comparison:
    """Differences, one line of text each.

    Attributes:
        worse: differences that are less safe.
        unwalked: the floor around the robots has changed, and the walk covers too little of it.
        other: any other difference.
    """

    worse: list[str] = field(default_factory=list)
    unwalked: list[str] = field(default_factory=list)
    other: list[str] = field(default_factory=list)


@dataclass(slots=True)
class _Change:
    """Ticks with one kind of change: their number, the first one, and the largest amount."""

    count: int = 0
    first_s: float = 0.0
    most: float = 0.0
    example: str = ""

    def add(self, time_s: float, amount: float, example: str) -> None:
        if not self.count:
            self.first_s, self.example = time_s, example
        self.count += 1
        self.most = max(self.most, amount)


def compare(walk: Walk, old: Sequence[AdviceRow], new: Played) -> Comparison:
    """Compare the validated result with the current result for the same recording.

    Args:
        walk: the validated walk.
        old: its advice messages.
        new: the same recording, played now.
    """
    found = Comparison()
    before, now = _by_robot(old), _by_robot(new.rows)
    for robot in dict.fromkeys([*before, *now]):
        if robot not in now:
            found.worse.append(f"robot {robot}: it no longer gets advice")
        elif robot not in before:
            found.other.append(f"robot {robot}: is new, so there is nothing to compare")
        else:
            _advices(found, robot, before[robot], now[robot])
    olds = {each.robot: each for each in walk.robots}
    for each in advice_by_robot(new):
        if each.robot in olds:
            _totals(found, olds[each.robot], each)
    _floor(found, walk, new)
    return found


def _advices(
    found: Comparison, robot: str, old: Sequence[AdviceRow], new: Sequence[AdviceRow]
) -> None:
    """Compare tick by tick."""
    changes = {name: (_Change(), _Change()) for name in ("level", "limit", "separation", "ahead")}
    reasons = _Change()
    pairs = list(_paired(old, new))
    for was, row in pairs:
        milder = Level[was.level.upper()].rank - Level[row.level.upper()].rank
        if was.level != row.level:
            text = f"{was.level} -> {row.level}"
            changes["level"][milder <= 0].add(row.time_s, abs(milder), text)
        elif was.reason != row.reason:
            reasons.add(row.time_s, 0, f"{was.reason} -> {row.reason}")
        more = row.limit_m_s - was.limit_m_s
        if abs(more) > SAME_M_S:
            text = f"{was.limit_m_s:.3f} -> {row.limit_m_s:.3f}"
            changes["limit"][more <= 0].add(row.time_s, abs(more), text)
        _distance(changes["separation"], row.time_s, was.separation_m, row.separation_m)
        _distance(changes["ahead"], row.time_s, was.predicted_m, row.predicted_m)
    texts = {
        "level": ("a milder level", "a stricter level", ""),
        "limit": ("a higher speed limit", "a lower speed limit", "m/s"),
        "separation": ("no person is seen where one was", "a different separation", "m"),
        "ahead": ("no person is predicted where one was", "a different predicted separation", "m"),
    }
    for name, both in changes.items():
        *words, unit = texts[name]
        for side, change in enumerate(both):
            if change.count:
                by = f", by up to {change.most:.3f} {unit}" if unit and change.most else ""
                line = (
                    f"robot {robot}: {words[side]} in {change.count} of {len(pairs)} advices{by}; "
                    f"first at {change.first_s:.2f} s: {change.example}"
                )
                (found.other if side else found.worse).append(line)
    if reasons.count:
        found.other.append(
            f"robot {robot}: a different reason in {reasons.count} advices; first at "
            f"{reasons.first_s:.2f} s: {reasons.example}"
        )
    if len(old) != len(new):
        found.other.append(f"robot {robot}: {len(old)} advices then, {len(new)} now")


def _distance(
    both: tuple[_Change, _Change], time_s: float, was: float | None, now: float | None
) -> None:
    """Note a changed distance. ``None`` (no known person) counts as the largest distance."""
    if was is None and now is None:
        return
    text = f"{_metres(was)} -> {_metres(now)}"
    if was is None or now is None:
        both[now is not None].add(time_s, 0.0, text)
    elif abs(now - was) > SAME_M:
        both[1].add(time_s, abs(now - was), text)


def _metres(value: float | None) -> str:
    return "no person" if value is None else f"{value:.3f} m"


def _totals(found: Comparison, old: RobotAdvice, new: RobotAdvice) -> None:
    """Compare stops, extremes and the time at each level."""
    at = f"robot {new.robot}: "
    if old.stops != new.stops:
        found.other.append(f"{at}stops {old.stops} -> {new.stops}")
    if old.first_stop_s is not None and new.first_stop_s is None:
        found.worse.append(f"{at}no stop any more; the first was at {old.first_stop_s:.2f} s")
    elif old.first_stop_s != new.first_stop_s:
        later = (new.first_stop_s or 0.0) - (old.first_stop_s or 0.0)
        line = f"{at}first stop {_seconds(old.first_stop_s)} -> {_seconds(new.first_stop_s)}"
        worse = old.first_stop_s is not None and later > 0
        (found.worse if worse else found.other).append(line)
    if _metres(old.least_separation_m) != _metres(new.least_separation_m):
        found.other.append(
            f"{at}smallest separation {_metres(old.least_separation_m)} -> "
            f"{_metres(new.least_separation_m)}"
        )
    if abs(old.mean_limit_m_s - new.mean_limit_m_s) > SAME_M_S:
        found.other.append(
            f"{at}mean speed limit {old.mean_limit_m_s:.3f} -> {new.mean_limit_m_s:.3f} m/s"
        )
    if old.ticks_at != new.ticks_at:
        found.other.append(f"{at}time at each level {_shares(old)} -> {_shares(new)}")


def _floor(found: Comparison, walk: Walk, new: Played) -> None:
    """Compare where people were seen and lost, on the floor around the robots, then and now."""
    was, now = _places(walk.grid, walk.grid.area), _places(new.grid, new.grid.area)
    seen, sees = _places(walk.grid, walk.grid.seen), _places(new.grid, new.grid.seen)
    blind = (was & now & seen) - sees
    if blind:
        found.worse.append(f"people are no longer seen in {len(blind)} cells of the floor")
    clearer = (was & now & sees) - seen
    if clearer:
        found.other.append(f"people are seen in {len(clearer)} more cells of the floor")
    if was != now:
        line = (
            f"floor around the robots: {len(was)} -> {len(now)} cells; people were seen in "
            f"{_of(was & seen, was)} -> {_of(now & sees, now)} of them"
        )
        if now - was and new.grid.coverage < walk.least_coverage:
            line += (
                f"; the walk asks for {100 * walk.least_coverage:g} %: walk again with this "
                f"configuration, over all of this floor"
            )
            found.unwalked.append(line)
        else:
            found.other.append(line)
    if walk.people_lost != new.people_lost:
        line = f"people lost {walk.people_lost} -> {new.people_lost}"
        (found.worse if new.people_lost > walk.people_lost else found.other).append(line)


def _of(some: set[tuple[int, int]], all_of: set[tuple[int, int]]) -> str:
    """Return number and share of the cells: on a large floor, the share alone may hide a change."""
    return f"{len(some)} ({100 * len(some) / max(len(all_of), 1):.1f} %)"


def _places(grid: GridResult, cells: Iterable[int]) -> set[tuple[int, int]]:
    """Return the cells by position in the room, to compare grids of different sizes."""
    x, y = (round(v / grid.cell_m) for v in grid.origin)
    return {(x + cell % grid.columns, y + cell // grid.columns) for cell in cells}


def _by_robot(rows: Sequence[AdviceRow]) -> dict[str, list[AdviceRow]]:
    found: dict[str, list[AdviceRow]] = {}
    for row in rows:
        found.setdefault(row.robot, []).append(row)
    return found


def _paired(
    old: Sequence[AdviceRow], new: Sequence[AdviceRow]
) -> Iterator[tuple[AdviceRow, AdviceRow]]:
    """Pair each new advice with the old one in force at that time: the rates may differ."""
    k = 0
    for row in new:
        while k + 1 < len(old) and old[k + 1].time_s <= row.time_s + 1e-6:
            k += 1
        yield old[k], row


def _seconds(value: float | None) -> str:
    return "none" if value is None else f"{value:.2f} s"


def _shares(robot: RobotAdvice) -> str:
    total = sum(robot.ticks_at.values()) or 1
    return ", ".join(f"{name} {100 * n / total:.1f} %" for name, n in robot.ticks_at.items())
