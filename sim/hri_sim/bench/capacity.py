"""Share of a serial wire that an overloaded link uses, and bytes that wait in the port."""

import contextlib
import sys
from collections.abc import Iterator
from typing import Any

from hri_drivers.links.serial.link import SerialLink, SerialLinkSettings
from hri_predict.base.clock import MonotonicClock
from hri_predict.run.runtime import SWITCH_INTERVAL_S
from hri_sim.bench.rows import spread
from hri_sim.bench.samples import of_a_cycle
from hri_sim.wires.child import child
from hri_sim.wires.far_end import serial_line

RATE_HZ = 25.0
PEOPLE = 6
"""Zones and poses of six people at 25 Hz are 1.9 times the capacity of 921600 bit/s."""


@contextlib.contextmanager
def prompt_threads() -> Iterator[None]:
    """Let threads switch as promptly as in the running node."""
    interval = sys.getswitchinterval()
    sys.setswitchinterval(SWITCH_INTERVAL_S)
    try:
        yield
    finally:
        sys.setswitchinterval(interval)


def saturate(baudrate: int, seconds: float, reserved_load: float = 0.0) -> dict[str, Any]:
    """Post more Zones and Poses than the wire can carry, and measure what it carried.

    Returns:
        ``used``: bytes carried, divided by the wire's capacity in that time; ``backlog_ms``: time
        that the bytes waiting in the port take to leave (p50, p99, max); the link's counters.
    """
    with child(serial_line, baudrate / 10) as line, prompt_threads():
        settings = SerialLinkSettings(
            name="bench",
            port=line.receive(),
            baudrate=baudrate,
            reserved_load=reserved_load,
            robot_state_rate_hz=0.0,
        )
        clock = MonotonicClock()
        link = SerialLink(settings, clock, rate_hz=RATE_HZ)
        link.start()
        posted = 0
        start_ns = clock.now_ns()
        for cycle in range(int(seconds * RATE_HZ)):
            clock.wait_until(start_ns + round(cycle * 1e9 / RATE_HZ))
            for message in of_a_cycle(cycle, clock.now_ns(), PEOPLE):
                link.post(message)
                posted += 1
        link.stop()
        report = line.report()
    counters = link.counters
    backlog_ms = [bytes_ * 1e4 / baudrate for bytes_ in report.backlog_bytes or [0]]
    return {
        "baudrate": baudrate,
        "reserved_load": reserved_load,
        "seconds": round(report.busy_s, 3),
        "bytes": report.received,
        "used": round(report.received / (report.busy_s * baudrate / 10), 4),
        "backlog_ms": spread(backlog_ms, 2),
        "posted": posted,
        "sent": counters.messages_sent,
        "decimated": counters.decimated,
        "superseded": counters.superseded,
        "write_errors": counters.write_errors,
    }
