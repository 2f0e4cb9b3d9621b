"""Selects the configuration set in force, and combines sets while the choice changes.

A PLC must renew its choice continually: after a PLC has fallen silent, or before it sends, any
assumed set could be too mild. All sets requested since the number was last steady apply together:
stricter rules of the new set apply from the next tick, and stricter rules of the old set until the
number has been steady for ``STEADY_S``. If a number alternates, or two PLCs differ, the stricter
rules of each set apply.
"""

import logging
import math
from collections.abc import Sequence
from dataclasses import dataclass

from hri_predict.protocol.reasons import Reason
from hri_predict.risk.areas import NamedZoneSettings
from hri_predict.risk.sets import SetSettings, set_hash

STALE_S = 1.0
"""Age at which a choice expires; PLCs write in each of their cycles."""
STEADY_S = 0.2
"""Two cycles of a slow PLC (100 ms), whose number passes through other values while a switch is
turned. This is far less than the captures for a release take anyway."""

log = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True)
class InForce:
    """Content of the set in force.

    Attributes:
        number: number of the set; 0: none is in force, or it is changing.
        hash: see ``sets.set_hash``; 0 like ``number``.
        is_known: whether a configured set is chosen.
        zones: names of the active zones; ``None``: all.
        max_speed_m_s: limit for all robots.
    """

    number: int = 0
    hash: int = 0
    is_known: bool = True
    zones: frozenset[str] | None = None
    max_speed_m_s: float = math.inf

    def asks(self, zone: str) -> bool:
        """Return whether a named zone is active."""
        return self.zones is None or zone in self.zones


@dataclass(slots=True)
class _Line:
    """A link's choice: the number, the start of its uninterrupted renewal, and its last arrival."""

    number: int
    since_ns: int
    heard_ns: int


class SetChooser:
    """Tracks the choices of all links.

    Args:
        sets: as configured; if there are none, everything is in force.
        zones: the user's zones.

    Attributes:
        in_force: result of the last ``update``.
    """

    def __init__(self, sets: Sequence[SetSettings], zones: Sequence[NamedZoneSettings]) -> None:
        self._known = {
            each.number: InForce(
                number=each.number,
                hash=set_hash(each, zones),
                zones=None if each.zones is None else frozenset(each.zones),
                max_speed_m_s=each.max_speed_m_s or math.inf,
            )
            for each in sets
        }
        self._names = {each.number: each.name for each in sets}
        self._lines: dict[str, _Line] = {}
        self._came: set[int] = set()  # all numbers chosen since the last update
        self._held: set[int] = set()
        self.in_force = InForce(is_known=not sets)

    @property
    def reasons(self) -> tuple[Reason, ...]:
        """Reason for the node's status if no set is in force."""
        return () if self.in_force.is_known else (Reason.SET_UNKNOWN,)

    @property
    def shown(self) -> tuple[int, int] | None:
        """Number and hash of the set in force; ``None`` without sets."""
        return (self.in_force.number, self.in_force.hash) if self._known else None

    def choose(self, link: str, number: int, at_ns: int) -> None:
        """Process a PLC's choice, received at ``at_ns``."""
        self._came.add(number)
        line = self._lines.get(link)
        if line is None or number != line.number or at_ns - line.heard_ns > STALE_S * 1e9:
            self._lines[link] = _Line(number, at_ns, at_ns)
        else:
            line.heard_ns = max(line.heard_ns, at_ns)

    def update(self, now_ns: int) -> InForce:
        """Update and return the set in force."""
        before, self.in_force = self.in_force, self._found(now_ns) if self._known else InForce()
        if (before.number, before.is_known) != (self.in_force.number, self.in_force.is_known):
            self._say(now_ns)
        return self.in_force

    def _found(self, now_ns: int) -> InForce:
        lines = self._lines.values()
        silent = any(now_ns - line.heard_ns > STALE_S * 1e9 for line in lines)
        steady = bool(lines) and now_ns - max(x.since_ns for x in lines) >= STEADY_S * 1e9
        asked = {line.number for line in lines} | (set() if steady else self._came)
        self._came.clear()
        if silent or not asked or not asked <= self._known.keys():
            self._held.clear()
            return InForce(is_known=False)
        if steady:
            self._held = asked
        elif self._held:
            self._held |= asked
        else:
            return InForce(is_known=False)
        held = [self._known[number] for number in sorted(self._held)]
        return held[0] if len(held) == 1 else _strictest(held)

    def _say(self, now_ns: int) -> None:
        if not self.in_force.is_known:
            log.warning("no configuration set is in force: %s; the robots stop", self._why(now_ns))
        elif number := self.in_force.number:
            log.info("configuration set %d (%s) is in force", number, self._names[number])

    def _why(self, now_ns: int) -> str:
        silent = [k for k, line in self._lines.items() if now_ns - line.heard_ns > STALE_S * 1e9]
        if silent:
            return (
                f"no choice has been received for {STALE_S:g} s by link {', '.join(sorted(silent))}"
            )
        asked = sorted({line.number for line in self._lines.values()} - self._known.keys())
        if asked:
            return f"there is no set with number {', '.join(map(str, asked))}"
        return "a set was chosen a moment ago" if self._lines else "none was chosen yet"


def _strictest(held: Sequence[InForce]) -> InForce:
    """Return the combination of all sets."""
    zones = frozenset[str]().union(*(each.zones or () for each in held))
    return InForce(
        zones=None if any(each.zones is None for each in held) else zones,
        max_speed_m_s=min(each.max_speed_m_s for each in held),
    )
