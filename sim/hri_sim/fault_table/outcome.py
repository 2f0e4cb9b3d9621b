"""The expected and the measured effect of a fault: one row of the fault table."""

from dataclasses import dataclass, field
from typing import Literal

RECOVERY_S = 6.0  # from the fault's end until the advice is as before it

Expected = Literal[
    "unknown",
    "silent",
    "stop",
    "stays stopped",
    "may stop",
    "not clear",
    "fault",
    "degraded",
    "count only",
    "no contact",
]


@dataclass(kw_only=True)
class FaultOutcome:
    """Measurements of one fault; a row of the fault table."""

    fault: str
    expected: str
    acts: str
    limit_ms: float | None = None
    measured_ms: float | None = None
    reason: str
    clear_while_near: int = 0
    recovered_ms: float | None = None
    fine: bool
    counted: dict[str, int] = field(default_factory=dict)
