"""The expected and the measured effect of a fault: one row of the fault table."""

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
