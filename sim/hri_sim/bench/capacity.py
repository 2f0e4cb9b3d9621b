"""Share of a serial wire that an overloaded link uses, and bytes that wait in the port."""

import contextlib
import sys
from collections.abc import Iterator
from typing import Any

import numpy as np

from hri_drivers.links.serial.link import SerialLink, SerialLinkSettings
from hri_predict.base.clock import MonotonicClock
from hri_predict.protocol.codec import SCHEMA_HASH, SCHEMA_VERSION
from hri_predict.protocol.messages import (
    Advice,
    Level,
    Message,
    NodeState,
    Pose,
    Schema,
    Status,
    Zone,
    ZoneCapsule,
)
from hri_predict.protocol.reasons import Reason
from hri_predict.run.runtime import SWITCH_INTERVAL_S
from hri_sim.wires.far_end import far_end

PEOPLE, STEPS, SEGMENTS, JOINTS = 6, 3, 17, 21
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


def saturate(
    baudrate: int, seconds: float, reserved_load: float = 0.0, rate_hz: float = 25.0
) -> dict[str, Any]:
    """Post more Zones and Poses than the wire can carry, and measure what it carried.

    Returns:
        ``used``: bytes carried, divided by the wire's capacity in that time; ``backlog_ms``: time
        that the bytes waiting in the port take to leave (p50, p99, max); the link's counters.
    """
    with far_end("serial", str(baudrate / 10)) as (path, reports), prompt_threads():
        settings = SerialLinkSettings(
            name="bench",
            port=path,
            baudrate=baudrate,
            reserved_load=reserved_load,
            robot_state_rate_hz=0.0,
        )
        clock = MonotonicClock()
        link = SerialLink(settings, clock, rate_hz=rate_hz)
        link.start()
        posted = 0
        start_ns = clock.now_ns()
        for cycle in range(int(seconds * rate_hz)):
            clock.wait_until(start_ns + round(cycle * 1e9 / rate_hz))
            for message in _messages(cycle, clock.now_ns(), cycle % round(rate_hz) == 0):
                link.post(message)
                posted += 1
        link.stop()
        counters = link.counters
    report = reports[0]
    backlog_ms = np.asarray(report["backlog_bytes"] or [0]) * 1e4 / baudrate
    return {
        "baudrate": baudrate,
        "reserved_load": reserved_load,
        "seconds": round(report["busy_s"], 3),
        "bytes": report["received"],
        "used": round(report["received"] / (report["busy_s"] * baudrate / 10), 4),
        "backlog_ms": {
            "p50": round(float(np.percentile(backlog_ms, 50)), 2),
            "p99": round(float(np.percentile(backlog_ms, 99)), 2),
            "max": round(float(backlog_ms.max()), 2),
        },
        "posted": posted,
        "sent": counters.messages_sent,
        "decimated": counters.decimated,
        "superseded": counters.superseded,
        "write_errors": counters.write_errors,
    }


def _messages(cycle: int, now_ns: int, with_schema: bool) -> list[Message]:
    capsules = tuple(
        ZoneCapsule(i, (0.1 * i, 0.5, 1.0), (0.1 * i, 0.6, 1.3), 0.2) for i in range(SEGMENTS)
    )
    joints = tuple((i, 0.1 * i, 0.5, 1.0) for i in range(JOINTS))
    messages: list[Message] = [
        Advice(
            robot=0,
            level=Level.SLOW,
            reason=Reason.PERSON_NEAR,
            latch_id=0,
            separation_m=1.2,
            predicted_separation_m=0.8,
            time_to_breach_s=0.5,
            speed_limit_m_s=0.4,
            capture_ns=now_ns,
        ),
        Status(
            node_state=NodeState.RUNNING,
            reason=Reason.NONE,
            people=PEOPLE,
            predictor=0,
            cycle=cycle,
            capture_ns=now_ns,
        ),
    ]
    if with_schema:
        messages.append(Schema(SCHEMA_VERSION, SCHEMA_HASH))
    for person in range(PEOPLE):
        for step in range(STEPS):
            messages.append(
                Zone(
                    person=person,
                    step=step,
                    horizon_s=0.4 * step,
                    capsules=capsules,
                    age_s=None,
                    capture_ns=now_ns,
                )
            )
            messages.append(
                Pose(
                    person=person,
                    step=step,
                    horizon_s=0.4 * step,
                    joints=joints,
                    age_s=None,
                    capture_ns=now_ns,
                )
            )
    return messages
