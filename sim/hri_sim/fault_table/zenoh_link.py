"""Faults of a zenoh link: their effect on the fleet view. Needs the extra ``fleet``.

The node's link sends through a router to the fleet view. No controller relies on zenoh.
"""

import contextlib
import time
from dataclasses import replace
from typing import Any

from hri_drivers.links.zenoh.link import ZenohLink, ZenohLinkSettings
from hri_drivers.wires.zenoh_session import ZenohSettings, open_session
from hri_predict.base.errors import LinkError
from hri_predict.operation.monitoring.fleet import SILENT, SILENT_S, UNKNOWN, Fleet
from hri_predict.protocol.messages import Level
from hri_sim.fault_table.link_cell import LOOK_S, PERIOD_S, LinkCase, LinkCell
from hri_sim.wires.ports import free_tcp_port

LATE = 1e3 * (PERIOD_S + 2 * LOOK_S)  # one cycle, plus the time until the view reads

CASES = (
    LinkCase("router gone", "silent", 1e3 * SILENT_S + LATE, "router"),
    LinkCase("restarted", "silent", 1e3 * SILENT_S + LATE, "ends"),
    LinkCase("delayed 1 s", "silent", 1e3 * SILENT_S + LATE,
             {"kind": "delay", "delay_s": 1.0}, drain_s=1.0),
    # repeats look like two nodes under one key
    LinkCase("flooded, everything 10 times", "unknown", LATE, {"kind": "flood"}),
    LinkCase("1 bit in 10000 wrong", "count only", None, {"kind": "bit_errors", "rate": 1e-4}),
)  # fmt: skip


class ZenohCell(LinkCell):
    """The link, its router and the fleet view, which shows a level for the robot."""

    start_s, acts = 3.0, "view"
    well = Level.SLOW.name.lower()
    stopped = {SILENT: "silent", UNKNOWN: "unknown"}

    def __init__(self, case: LinkCase) -> None:
        super().__init__(case)
        self._routing = ZenohSettings(mode="router", listen=[f"tcp/127.0.0.1:{free_tcp_port()}"])
        self._router: Any = open_session(self._routing)
        self._observer = ZenohLink.observer(ZenohSettings(connect=self._routing.listen), None)
        self._observer.open()
        self._fleet = Fleet()

    def settings(self) -> tuple[type[ZenohLink], ZenohLinkSettings]:
        """Return a client of the router."""
        connect = self._routing.listen
        return ZenohLink, ZenohLinkSettings(name="fleet", cell="faults", connect=connect)

    def look(self) -> None:
        """Receive messages, and read the view."""
        with contextlib.suppress(LinkError):  # not connected: the cell turns silent
            for unit in self._observer.read(LOOK_S):
                self._fleet.take(replace(unit, key=f"hri/{unit.key}"), self._clock.now_ns())
        rows = self._fleet.rows(self._clock.now_ns())
        level = rows[0].robots[0].level if rows and rows[0].robots else SILENT
        self.shown.append((time.monotonic(), level))

    def counted(self) -> dict[str, int]:
        """Return the number of messages that the view lost and refused."""
        rows = self._fleet.rows(self._clock.now_ns())
        return {"lost": rows[0].lost, "refused": rows[0].refused} if rows else {}

    def break_or_mend(self, broken: bool) -> None:
        """See ``LinkCell``; also stops the router and starts it again."""
        super().break_or_mend(broken)
        if self.case.fault == "router" and broken and self._router is not None:
            self._router.close()
            self._router = None
        elif not broken and self._router is None:
            self._router = open_session(self._routing)

    def close(self) -> None:
        """Stop the link, the view and the router."""
        super().close()
        self._observer.close()
        if self._router is not None:
            self._router.close()
