"""Episodes: each from a robot's slowdown or stop until it was released."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from typing import Any

from hri_predict.explaining.values import number, text
from hri_predict.protocol.messages import LEVELS, Level
from hri_predict.protocol.reason_row import Kind
from hri_predict.protocol.reasons import CLEARED, RISING, Reason
from hri_predict.recording import Told

LEVEL_NAMES = tuple(level.name for level in LEVELS)
WAITING = tuple(r.name for r in Reason if r.row.kind is Kind.WAITING)
"""Reasons that only state that the previous condition continues."""
_PENDING = Reason.RELEASE_PENDING.row.rank or 0
_STEADY = tuple(r.name for r in Reason if (r.row.rank or 0) > _PENDING)
"""Reasons that an advice keeps for some captures (``risk.levels.steady_reason``)."""
_OF_RUN = tuple(r.name for r in Reason if r.row.kind is Kind.RUN)
_NS = 1e9
GAP_NS = 2_000_000_000
"""Maximum gap without advice within an episode: after a longer gap the advice is unknown. An
episode also ends where time goes back by this much, in another file from before the wall clock was
set.
"""


@dataclass(slots=True)
class Phase:
    """A phase of constant level and reason; ``first`` is its first advice."""

    first: Told
    last_ns: int

    @property
    def level(self) -> str:
        """The level's name."""
        return level_of(self.first.data)

    @property
    def reason(self) -> str:
        """The reason's name."""
        return text(self.first.data.get("reason"))


@dataclass(slots=True)
class Episode:
    """Attributes: ``end_ns`` and ``after`` are ``None`` if the episode lasts to the end of the
    data.

    ``before`` and ``after`` are the levels around the episode; ``least_m`` is its minimum
    separation; ``permitted_m`` is the distance that the robot could have moved at its speed limit,
    and ``limit_m_s`` the last advised limit.
    """

    robot: str
    before: str | None = None
    after: str | None = None
    phases: list[Phase] = field(default_factory=list)
    end_ns: int | None = None
    least_m: float | None = None
    permitted_m: float = 0.0
    limit_m_s: float = 0.0

    @property
    def start_ns(self) -> int:
        """Start of the episode."""
        return self.phases[0].first.utc_ns

    @property
    def last_ns(self) -> int:
        """End of the episode, or its last advice."""
        return self.phases[-1].last_ns if self.end_ns is None else self.end_ns

    @property
    def worst(self) -> Phase:
        """The phase after which the episode is named: the longest of the most severe ones, ignoring
        "waiting".

        The node's start or stop names an episode only if no other phase does.
        """

        def telling(phase: Phase) -> tuple[bool, tuple[bool, int], bool, int]:
            lasted_ns = phase.last_ns - phase.first.utc_ns
            says_more = phase.reason not in WAITING
            cause = phase if says_more else self.cause_before(phase.first.utc_ns) or phase
            return cause.reason not in _OF_RUN, severity(phase.level), says_more, lasted_ns

        return max(self.phases, key=telling)

    @property
    def is_of_run(self) -> bool:
        """Whether only the start or end of the run kept the robot from moving."""
        if any(phase.level in ("STOP", "FAULT") for phase in self.phases):
            return False
        return self.phases[0].reason == "STARTING" or self.worst.reason in _OF_RUN

    @property
    def stopped_ns(self) -> int:
        """Time within the episode for which the robot had to stand, in ns."""
        return sum(p.last_ns - p.first.utc_ns for p in self.phases if not Level[p.level].may_move)

    def lost_s(self, full_m_s: float) -> float:
        """Lost working time, s: a second at half of the full speed (m/s) counts half."""
        return lost_s((self.last_ns - self.start_ns) / _NS, self.permitted_m, full_m_s)

    def cause_before(self, utc_ns: int) -> Phase | None:
        """Return the cause of a waiting phase: the last earlier phase with another reason."""
        before = [p for p in self.phases if p.first.utc_ns <= utc_ns and p.reason not in WAITING]
        return before[-1] if before else None


def lost_s(lasted_s: float, permitted_m: float, full_m_s: float) -> float:
    """Return the time left over after moving ``permitted_m`` at full speed; at least zero."""
    return max(0.0, lasted_s - permitted_m / full_m_s) if full_m_s > 0 else 0.0


def level_of(advice: dict[str, Any]) -> str:
    """The level's name; ``UNKNOWN`` for any other value."""
    level = advice.get("level")
    return level if isinstance(level, str) and level in Level.__members__ else "UNKNOWN"


def severity(level: str) -> tuple[bool, int]:
    """Order in which levels name an episode or a moment: by the requested action.

    A fault takes precedence over other stops, however short, because its cause must be repaired.
    """
    return level == Level.FAULT.name, Level[level].rank


def slows(advice: dict[str, Any]) -> bool:
    """Whether an advice slows or stops its robot."""
    return Level[level_of(advice)].rank >= Level.SLOW.rank


def waits(advice: dict[str, Any]) -> bool:
    """Whether the robot is only waiting, although the reason may still name the original cause.

    A reason is kept for some captures to avoid flicker; the detail is always current.
    """
    reason, detail = text(advice.get("reason")), text(advice.get("detail"))
    return reason in WAITING or (reason in _STEADY and (RISING in detail or CLEARED in detail))


def robot_of(advice: dict[str, Any]) -> str:
    """The robot's name, or its number in old recordings."""
    return text(advice.get("name", advice.get("robot")))


class EpisodeFinder:
    """Finds the episodes of all robots, advice by advice."""

    def __init__(self) -> None:
        self._open: dict[str, Episode] = {}
        self._level: dict[str, str] = {}

    def add(self, told: Told) -> Episode | None:
        """Process the next advice; return the episode that it ends."""
        robot, level = robot_of(told.data), level_of(told.data)
        slowed = slows(told.data)
        before, self._level[robot] = self._level.get(robot), level
        episode, ended = self._open.get(robot), None
        if episode is not None and abs(told.utc_ns - episode.phases[-1].last_ns) > GAP_NS:
            ended, episode = self._open.pop(robot), None
        if not slowed:
            if episode is not None:
                episode.end_ns, episode.after = told.utc_ns, level
                self._lasted(episode, told)
                ended = self._open.pop(robot)
            return ended
        if episode is None:
            episode = self._open[robot] = Episode(robot, before)
        self._extend(episode, told)
        return ended

    def _extend(self, episode: Episode, told: Told) -> None:
        last = episode.phases[-1] if episode.phases else None
        same = last is not None and (last.level, last.reason) == (
            level_of(told.data),
            text(told.data.get("reason")),
        )
        if last is not None:
            self._lasted(episode, told)
        if not same:
            episode.phases.append(Phase(told, told.utc_ns))
        episode.limit_m_s = max(0.0, number(told.data.get("speed_limit_m_s")) or 0.0)
        distance_m = number(told.data.get("separation_m"))
        if distance_m is not None:
            least_m = episode.least_m
            episode.least_m = distance_m if least_m is None else min(least_m, distance_m)

    def _lasted(self, episode: Episode, until: Told) -> None:
        """Extend the newest advice until now."""
        last = episode.phases[-1]
        episode.permitted_m += max(0, until.utc_ns - last.last_ns) / _NS * episode.limit_m_s
        last.last_ns = until.utc_ns

    def rest(self) -> list[Episode]:
        """Return the episodes that last to the end."""
        left, self._open = list(self._open.values()), {}
        return left


def episodes(advice: Iterable[Told]) -> Iterator[Episode]:
    """Yield every episode of the advice, as it ends."""
    finder = EpisodeFinder()
    for told in advice:
        if (ended := finder.add(told)) is not None:
            yield ended
    yield from finder.rest()
