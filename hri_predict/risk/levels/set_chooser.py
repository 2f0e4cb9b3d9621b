"""Which configuration set is in force, and what holds while it changes.

A set must be chosen again and again: a PLC that fell silent, or never spoke, has chosen none, and
what the node then assumed could be too mild. Each set asked for since the number was last steady
holds at once, and together with the others: so what is stricter about the new one comes with the
next tick, and what was stricter about the old one goes when the number has been steady for
``STEADY_S``. A number that changes to and fro, or two PLCs that differ, have the stricter of each.
"""

import logging
import math
from collections.abc import Sequence
from dataclasses import dataclass

from hri_predict.protocol.reasons import Reason
from hri_predict.risk.areas import NamedZoneSettings
from hri_predict.risk.sets import SetSettings, set_hash

STALE_S = 1.0
"""A choice that is older than this has ended; PLCs write in each of their cycles."""
STEADY_S = 0.2
"""Two cycles of a slow PLC (100 ms), whose number passes through others while a switch turns; and
far less than the captures that a release needs anyway."""

log = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True)
class InForce:
    """Content of the set in force.

    Attributes:
        number: of the set; 0: none is in force, or it changes just now.
        hash: see ``sets.set_hash``; 0 like ``number``.
        is_known: whether a configured set is chosen.
        zones: names of the zones that ask; ``None``: all.
        max_speed_m_s: limit for all robots.
    """

    number: int = 0
    hash: int = 0
    is_known: bool = True
    zones: frozenset[str] | None = None
    max_speed_m_s: float = math.inf

    def asks(self, zone: str) -> bool:
        """Whether a named zone asks anything of robots."""
        return self.zones is None or zone in self.zones


@dataclass(slots=True)
class _Line:
    """A link's choice: its number, since when without a gap, and when it came last."""

    number: int
    since_ns: int
    heard_ns: int


class SetChooser:
    """Follows the choices of all links.

    Args:
        sets: as configured; without any there is nothing to choose, and all is in force.
        zones: the user's zones.

    Attributes:
        in_force: by the newest call of ``update``.
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
        """Reason for the node's status where no set is in force."""
        return () if self.in_force.is_known else (Reason.SET_UNKNOWN,)

    @property
    def shown(self) -> tuple[int, int] | None:
        """Number and hash of the set in force; ``None`` without sets."""
        return (self.in_force.number, self.in_force.hash) if self._known else None

    def choose(self, link: str, number: int, at_ns: int) -> None:
        """Take a PLC's choice, received at ``at_ns``."""
        self._came.add(number)
        line = self._lines.get(link)
        if line is None or number != line.number or at_ns - line.heard_ns > STALE_S * 1e9:
            self._lines[link] = _Line(number, at_ns, at_ns)
        else:
            line.heard_ns = max(line.heard_ns, at_ns)

    def update(self, now_ns: int) -> InForce:
        """Return what is in force now."""
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
            return f"no choice has come for {STALE_S:g} s by link {', '.join(sorted(silent))}"
        asked = sorted({line.number for line in self._lines.values()} - self._known.keys())
        if asked:
            return f"no set has number {', '.join(map(str, asked))}"
        return "a set was chosen a moment ago" if self._lines else "none was chosen yet"


def _strictest(held: Sequence[InForce]) -> InForce:
    """All of them at once."""
    zones = frozenset[str]().union(*(each.zones or () for each in held))
    return InForce(
        zones=None if any(each.zones is None for each in held) else zones,
        max_speed_m_s=min(each.max_speed_m_s for each in held),
    )
