"""Content of an alert: a change of a robot's level, of a named zone, or a test."""

from dataclasses import asdict, dataclass
from typing import Any
from urllib.parse import quote


def _when(at: str | None, time_s: float) -> str:
    """``[14:03:07.123Z]``, as accepted by ``explain --at``; without UTC, seconds since the
    start.
    """
    return f"[{time_s:8.2f} s]" if at is None else f"[{at[11:23]}Z]"


@dataclass(frozen=True, slots=True, kw_only=True)
class Alert:
    """One change of a robot's level, or of the reason for *unknown* or *fault*.

    ``at`` is the wall-clock time (UTC), ``None`` on the virtual clock; ``time_s`` is the node's
    time since the start. ``held_back`` counts the changes of the same robot since the last reported
    one, left out because the level alternates.
    """

    at: str | None
    time_s: float
    robot: str
    level: str
    was: str
    reason: str
    detail: str
    clears_when: str
    separation_m: float | None
    speed_limit_m_s: float | None
    held_back: int = 0

    @property
    def subject(self) -> str:
        """The changed part; a newer alert of the same subject replaces an older one."""
        return f"robot {self.robot}"

    def title(self) -> str:
        """The change alone."""
        return one_line(f"{self.robot}: {self._change}")

    def line(self) -> str:
        """One line for a person."""
        clears = f"; clears when {self.clears_when}" if self.clears_when else ""
        why = self.detail or f"{self.robot}: {self.reason}{clears}"
        return one_line(f"{_when(self.at, self.time_s)} {self._change}: {why}")

    @property
    def _change(self) -> str:
        return f"still {self.level}" if self.was == self.level else f"{self.was} -> {self.level}"


@dataclass(frozen=True, slots=True, kw_only=True)
class ZoneAlert:
    """One change of a named zone: ``empty``, ``entry predicted`` (in ``entry_s``), ``occupied``."""

    at: str | None
    time_s: float
    zone: str
    state: str
    was: str
    entry_s: float | None
    held_back: int = 0

    @property
    def subject(self) -> str:
        """The changed part; a newer alert of the same subject replaces an older one."""
        return f"zone {self.zone}"

    def title(self) -> str:
        """The change alone."""
        return one_line(f"zone {self.zone}: {self.was} -> {self.state}")

    def line(self) -> str:
        """One line for a person."""
        soon = self.state == "entry predicted" and self.entry_s is not None
        when = f" in {self.entry_s * 1e3:.0f} ms" if soon and self.entry_s is not None else ""
        return one_line(
            f"{_when(self.at, self.time_s)} zone {self.zone}: {self.was} -> {self.state}{when}"
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class Trial:
    """Alert sent by ``hri-predict alerts CELL --test``; it does not concern any robot."""

    at: str | None
    test: bool = True
    text: str = "test of this alert hook; no robot's level changed"
    subject = "test"
    held_back = 0

    def title(self) -> str:
        """Return its title."""
        return "test"

    def line(self) -> str:
        """One line for a person."""
        return one_line(self.text)


AnyAlert = Alert | ZoneAlert | Trial


def as_data(alert: AnyAlert) -> dict[str, Any]:
    """Return the change without the cell, as plain data."""
    data = asdict(alert)
    data.pop("held_back", None)
    return data


def payload(alert: AnyAlert, cell: str, more_changes: int) -> dict[str, Any]:
    """The alert as plain data for JSON.

    Args:
        alert: the change.
        cell: name of the cell.
        more_changes: number of changes that this receiver missed since its last alert.
    """
    return {"cell": cell, **as_data(alert), "more_changes": more_changes}


def more(count: int) -> str:
    """Return ``"; 3 more changes"``, or an empty string."""
    if not count:
        return ""
    return f"; {count} more change{'s' if count != 1 else ''} before"


MAX_LINE = 1000
"""Maximum number of characters; the node's alerts are less than half as long."""


def one_line(text: str, limit: int = MAX_LINE) -> str:
    """Return ``text`` on one line: each unprintable character, such as a line break, becomes a
    space.

    The names of robots or zones could otherwise add headers to an e-mail, or lines to a log.
    """
    line = "".join(c if c.isprintable() else " " for c in text)
    return line if len(line) <= limit else line[: limit - 3] + "..."


def ascii_word(text: str, limit: int) -> str:
    """``text`` as printable ASCII without spaces, at most ``limit`` long; ``-`` where it is empty.

    RFC 5424 requires this of the fields of a syslog header (section 6).
    """
    return "".join(c if "!" <= c <= "~" else "_" for c in text)[:limit] or "-"


def topic_level(name: str) -> str:
    """``name`` as one level of an MQTT topic; different names give different levels.

    Characters with a meaning in topics (``/``, ``+``, ``#``), ``%`` and unprintable characters are
    percent-encoded as in a URL. MQTT 3.1.1, section 4.7.
    """
    return "".join(
        c if c.isprintable() and c not in "/+#%" else quote(c, safe="", errors="surrogatepass")
        for c in name
    )
