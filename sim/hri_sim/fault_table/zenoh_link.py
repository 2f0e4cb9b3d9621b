"""Faults of a zenoh link in real time: their effect on the fleet view. Needs the extra ``fleet``.

The node's link sends Status, Advice (*slow*) and Schema at 25 Hz through a router, and the view
receives them. No controller relies on zenoh, so the test is that the view never shows too much.
"""

import contextlib
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

from hri_drivers.links.zenoh.link import ZenohLink, ZenohLinkSettings
from hri_drivers.wires.zenoh_session import ZenohSettings, open_session
from hri_predict.base.clock import MonotonicClock
from hri_predict.base.errors import LinkError
from hri_predict.operation.monitoring.fleet import SILENT, SILENT_S, UNKNOWN, Fleet
from hri_predict.protocol.codec import SCHEMA_HASH, SCHEMA_VERSION
from hri_predict.protocol.messages import Advice, Level, NodeState, Schema, Status
from hri_predict.protocol.reasons import Reason
from hri_sim.fault_table.outcome import RECOVERY_S, Expected, FaultOutcome
from hri_sim.faults.link_faults import FaultyTransport
from hri_sim.senders.stream_ends import free_tcp_port

PERIOD_S, READ_S = 0.04, 0.005
START_S, LENGTH_S, SETTLED_S = 3.0, 2.0, 1.0
SHOWN = Level.SLOW.name.lower()
LATE = 1e3 * (PERIOD_S + 2 * READ_S)  # one cycle, plus the time until the view reads


@dataclass(frozen=True)
class ZenohCase:
    """One fault; see ``fault_table.Case``.

    Attributes:
        fault: fault of the link's transport; ``None``: the router or the link itself is gone.
    """

    name: str
    expected: Expected
    limit_ms: float | None
    fault: dict[str, Any] | None = None
    drain_s: float = 0.0


CASES = (
    ZenohCase("router gone", "silent", 1e3 * SILENT_S + LATE),
    ZenohCase("restarted", "silent", 1e3 * SILENT_S + LATE),
    ZenohCase("delayed 1 s", "silent", 1e3 * SILENT_S + LATE,
              {"kind": "delay", "delay_s": 1.0}, drain_s=1.0),
    # repeats look like two nodes under one key
    ZenohCase("flooded, everything 10 times", "unknown", LATE, {"kind": "flood"}),
    ZenohCase("1 bit in 10000 wrong", "count only", None, {"kind": "bit_errors", "rate": 1e-4}),
)  # fmt: skip


def run_zenoh_faults(only: str | None = None) -> Iterator[FaultOutcome]:
    """Run every case whose name contains ``only``."""
    for case in CASES:
        name = f"zenoh link: {case.name}"
        if only is None or only in name:
            yield run_zenoh_case(name, case)


def run_zenoh_case(name: str, case: ZenohCase) -> FaultOutcome:
    """Run one case.

    Raises:
        LinkError: no router can run on this machine.
    """
    with contextlib.ExitStack() as stack:
        cell = _Cell(case, stack)
        end_s = START_S + LENGTH_S + case.drain_s
        settled = 0.0
        while cell.since_s < end_s + RECOVERY_S and settled < SETTLED_S:
            cell.step()
            settled = cell.since_s - max(end_s, cell.well_since_s)
    return _outcome(name, case, cell, end_s)


def _outcome(name: str, case: ZenohCase, cell: "_Cell", end_s: float) -> FaultOutcome:
    during = [(s, level) for s, level in cell.shown if s >= START_S]
    settled = any(level == SHOWN for s, level in cell.shown if s < START_S)
    wanted = {"silent": (SILENT,), "unknown": (UNKNOWN,)}.get(case.expected, (SILENT, UNKNOWN))
    first = next(((s, level) for s, level in during if level in wanted), None)
    measured = None if first is None else 1e3 * (first[0] - START_S)
    recovered = 1e3 * max(0.0, cell.well_since_s - end_s) if during[-1][1] == SHOWN else None
    in_time = case.limit_ms is None or (measured is not None and measured <= case.limit_ms)
    shown_too_much = sum(level not in (SHOWN, SILENT, UNKNOWN) for _, level in during)
    return FaultOutcome(
        fault=name,
        expected=case.expected,
        acts="view",
        limit_ms=case.limit_ms,
        measured_ms=measured,
        reason="" if first is None else first[1],
        clear_while_near=shown_too_much,
        recovered_ms=None if case.expected == "count only" else recovered,
        fine=settled
        and in_time
        and (measured is None) == (case.expected == "count only")
        and recovered is not None
        and shown_too_much == 0,
        counted=cell.counted(),
    )


class _Cell:
    """The link, its router and the view.

    Attributes:
        shown: (seconds since the start, level that the view showed for the robot), at each read.
        well_since_s: time since which the view has shown the node's advice.
    """

    def __init__(self, case: ZenohCase, stack: contextlib.ExitStack) -> None:
        self.shown: list[tuple[float, str]] = []
        self.well_since_s = float("inf")
        self._case, self._clock = case, MonotonicClock()
        self._routing = ZenohSettings(mode="router", listen=[f"tcp/127.0.0.1:{free_tcp_port()}"])
        self._router: Any = open_session(self._routing)
        self._observer = ZenohLink.observer(ZenohSettings(connect=self._routing.listen), None)
        self._observer.open()
        self._fleet, self._link, self._cycle = Fleet(), self._new_link(), 0
        self._began_ns = self._due_ns = self._clock.now_ns()
        stack.callback(self._close)

    @property
    def since_s(self) -> float:
        """Seconds since the start."""
        return (self._clock.now_ns() - self._began_ns) * 1e-9

    def step(self) -> None:
        """Post the due messages, receive, and read the view."""
        self._break_or_mend(START_S <= self.since_s < START_S + LENGTH_S)
        if self._link is not None and self._clock.now_ns() >= self._due_ns:
            self._post(self._link)
            self._due_ns = max(self._due_ns + round(PERIOD_S * 1e9), self._clock.now_ns())
        with contextlib.suppress(LinkError):  # not connected: the cell turns silent
            for unit in self._observer.read(READ_S):
                self._fleet.take(replace(unit, key=f"hri/{unit.key}"), self._clock.now_ns())
        rows = self._fleet.rows(self._clock.now_ns())
        level = rows[0].robots[0].level if rows and rows[0].robots else SILENT
        self.shown.append((self.since_s, level))
        if level != SHOWN:
            self.well_since_s = float("inf")
        elif self.well_since_s == float("inf"):
            self.well_since_s = self.since_s

    def counted(self) -> dict[str, int]:
        """Return the counts of messages that the view lost and refused."""
        rows = self._fleet.rows(self._clock.now_ns())
        return {"lost": rows[0].lost, "refused": rows[0].refused} if rows else {}

    def _break_or_mend(self, broken: bool) -> None:
        if self._case.name == "router gone":
            if broken and self._router is not None:
                self._router.close()
                self._router = None
            elif not broken and self._router is None:
                self._router = open_session(self._routing)
        elif self._case.name == "restarted":
            if broken and self._link is not None:
                self._link.stop()
                self._link = None
            elif not broken and self._link is None:
                self._link = self._new_link()

    def _new_link(self) -> ZenohLink | None:
        settings = ZenohLinkSettings(name="fleet", cell="faults", connect=self._routing.listen)
        window = {"start_s": START_S, "duration_s": LENGTH_S, "direction": "out"}
        faults = [] if self._case.fault is None else [self._case.fault | window]
        wire = FaultyTransport(
            inner=ZenohLink.make_transport(settings), faults=faults, clock=self._clock, seed=0
        )
        link = ZenohLink(settings, self._clock, wire)
        link.start()
        return link

    def _post(self, link: ZenohLink) -> None:
        now_ns = self._clock.now_ns()
        if self._cycle % 25 == 0:
            link.post(Schema(SCHEMA_VERSION, SCHEMA_HASH))
        link.post(
            Advice(
                robot=0,
                level=Level.SLOW,
                reason=Reason.PERSON_NEAR,
                speed_limit_m_s=0.2,
                capture_ns=now_ns,
            )
        )
        link.post(
            Status(
                node_state=NodeState.RUNNING,
                reason=Reason.NONE,
                people=1,
                predictor=0,
                cycle=self._cycle % 256,
                capture_ns=now_ns,
            )
        )
        self._cycle += 1

    def _close(self) -> None:
        if self._link is not None:
            self._link.stop()
        self._observer.close()
        if self._router is not None:
            self._router.close()
