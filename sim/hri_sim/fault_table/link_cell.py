"""Faults of a link in real time: common parts for links without a simulated controller.

The link sends Status, Advice (*slow*) and Schema at 25 Hz. Its reader must never show advice less
strict than the node's.
"""

import time
from abc import ABC, abstractmethod
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, Literal

from hri_drivers.links.configured import ConfiguredLink, ConfiguredLinkSettings
from hri_predict.base.clock import MonotonicClock
from hri_sim.fault_table.outcome import RECOVERY_S, Expected, FaultOutcome
from hri_sim.faults.link_faults import FaultyTransport
from hri_sim.wires.samples import of_a_cycle

PERIOD_S, LOOK_S = 0.04, 0.005
LENGTH_S, SETTLED_S = 2.0, 1.0


@dataclass(frozen=True)
class LinkCase:
    """One fault; see ``fault_table.Case``.

    Attributes:
        fault: fault of the link's transport; or ``ends`` (the link stops, and starts again after
            the fault), ``hangs`` (the node posts nothing) or ``router`` (the router is gone).
    """

    name: str
    expected: Expected
    limit_ms: float | None
    fault: dict[str, Any] | Literal["ends", "hangs", "router"]
    drain_s: float = 0.0


class LinkCell(ABC):
    """A link with the fault of a case, and its reader.

    Attributes:
        start_s: time from the start to the fault, enough for link and reader to connect.
        acts: name of the reader in the table.
        well: what the reader shows while all is well.
        stopped: what the reader shows, with the reason, if it receives nothing or nothing valid.
        shown: everything the reader showed, with times in seconds of the monotonic clock.
    """

    start_s: ClassVar[float]
    acts: ClassVar[str]
    well: ClassVar[str]
    stopped: ClassVar[dict[str, str]]

    def __init__(self, case: LinkCase) -> None:
        self.case = case
        self.shown: list[tuple[float, str]] = []
        self._clock, self._cycle, self._due_ns = MonotonicClock(), 0, 0
        self._link: ConfiguredLink[Any, Any] | None = None

    @abstractmethod
    def settings(self) -> tuple[type[ConfiguredLink[Any, Any]], ConfiguredLinkSettings]:
        """Return the kind of link and its settings."""

    @abstractmethod
    def look(self) -> None:
        """Wait briefly, and record what the reader shows."""

    def counted(self) -> dict[str, int]:
        """Return the reader's counters."""
        return {}

    def run(self, name: str) -> FaultOutcome:
        """Run the case; return its row."""
        try:
            self._link = self._new_link()
            breaks_s = time.monotonic() + self.start_s
            mends_s = breaks_s + LENGTH_S
            end_s = mends_s + self.case.drain_s
            while (now_s := time.monotonic()) < end_s + RECOVERY_S:
                if now_s - max(end_s, self.well_since_s()) >= SETTLED_S:
                    break
                self._step(broken=breaks_s <= now_s < mends_s)
            return self._outcome(name, breaks_s, end_s)
        finally:
            self.close()

    def close(self) -> None:
        """Stop the link."""
        if self._link is not None:
            self._link.stop()

    def well_since_s(self) -> float:
        """Return the time since which all has been well; infinite if something is wrong."""
        since_s = float("inf")
        for at_s, text in reversed(self.shown):
            if text != self.well:
                break
            since_s = at_s
        return since_s

    def break_or_mend(self, broken: bool) -> None:
        """Stop the link or start it again, if that is the fault."""
        if self.case.fault == "ends" and broken and self._link is not None:
            self._link.stop()
            self._link = None
        elif not broken and self._link is None:
            self._link = self._new_link()

    def _step(self, broken: bool) -> None:
        """Post the messages that are due, as a node does."""
        self.break_or_mend(broken)
        now_ns = self._clock.now_ns()
        if now_ns >= self._due_ns:
            self._due_ns = max(self._due_ns + round(PERIOD_S * 1e9), now_ns)
            if self._link is not None and not (broken and self.case.fault == "hangs"):
                for message in of_a_cycle(self._cycle, now_ns, people=0):
                    self._link.post(message)
                self._cycle += 1
        self.look()

    def _new_link(self) -> ConfiguredLink[Any, Any]:
        kind, settings = self.settings()
        window = {"start_s": self.start_s, "duration_s": LENGTH_S, "direction": "out"}
        faults = [self.case.fault | window] if isinstance(self.case.fault, dict) else []
        device: Any = kind.make_transport(settings)
        wire: FaultyTransport[Any] = FaultyTransport(
            inner=device, faults=faults, clock=self._clock, seed=0
        )
        link = kind(settings, self._clock, wire)
        link.start()
        return link

    def _outcome(self, name: str, breaks_s: float, end_s: float) -> FaultOutcome:
        case, well_s = self.case, self.well_since_s()
        settled = any(text == self.well for s, text in self.shown if s < breaks_s)
        named = [text for text, reason in self.stopped.items() if reason == case.expected]
        wanted = named or list(self.stopped)
        during = [(s, text) for s, text in self.shown if s >= breaks_s]
        first = next(((s, text) for s, text in during if text in wanted), None)
        measured = None if first is None else 1e3 * (first[0] - breaks_s)
        in_time = case.limit_ms is None or (measured is not None and measured <= case.limit_ms)
        too_much = sum(text not in (self.well, *self.stopped) for _, text in self.shown)
        counts_only = case.expected == "count only"
        well = well_s < float("inf")
        reason = "" if first is None else self.stopped[first[1]]
        return FaultOutcome(
            fault=name,
            expected=case.expected,
            acts=self.acts,
            limit_ms=case.limit_ms,
            measured_ms=measured,
            reason=reason if settled else "received nothing before the fault",
            clear_while_near=too_much,
            recovered_ms=1e3 * max(0.0, well_s - end_s) if well and not counts_only else None,
            fine=settled
            and in_time
            and (measured is None) == counts_only
            and well
            and too_much == 0,
            counted=self.counted(),
        )


def run_cases(
    kind: str, cell: type[LinkCell], cases: Sequence[LinkCase], only: str | None
) -> Iterator[FaultOutcome]:
    """Run every case of a kind of link whose name contains ``only``."""
    for case in cases:
        name = f"{kind} link: {case.name}"
        if only is None or only in name:
            yield cell(case).run(name)
