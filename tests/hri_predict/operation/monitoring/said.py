"""What a healthy cell says, for tests of those who hear many, and who says what changes."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any, TextIO

from hri_predict.base.clock import Clock, VirtualClock
from hri_predict.operation.monitoring.alerts import Alerts, AlertSettings
from hri_predict.protocol.codec import SCHEMA_HASH, SCHEMA_VERSION
from hri_predict.protocol.messages import Level, Schema
from tests.messages import make_advice, make_status

CLEAR = make_advice(Level.CLEAR, speed_limit_m_s=1.0, separation_m=2.5, age_s=0.05)
RUNNING = make_status(people=2, cycle=9, age_s=0.05)
OURS = Schema(SCHEMA_VERSION, SCHEMA_HASH)


def alerts_of(
    folder: Path,
    *,
    robots: Sequence[str] = ("arm",),
    zones: Sequence[str] = (),
    clock: Clock | None = None,
    out: TextIO | None = None,
    threaded: bool = False,
    **settings: Any,
) -> Alerts:
    """Alerts of one robot on ``out``, in the thread that observes."""
    return Alerts(
        settings=AlertSettings(**settings),
        robots=list(robots),
        zones=zones,
        clock=clock or VirtualClock(0),
        base_dir=folder,
        terminal=out,
        threaded=threaded,
    )
