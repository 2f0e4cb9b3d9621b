"""Untrusted values from a recording: a file can be damaged or forged."""

import math
from collections.abc import Mapping
from typing import Any

LONGEST = 400


def number(value: Any) -> float | None:
    """A finite number, or ``None``."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        return None
    try:
        found = float(value)
    except OverflowError:
        return None
    return found if math.isfinite(found) else None


def whole(value: Any) -> int | None:
    """A whole number of 64 bits, or ``None``: JSON may hold numbers larger than a float."""
    if isinstance(value, bool) or not isinstance(value, int):
        return None
    return value if -(2**63) <= value < 2**63 else None


def text(value: Any) -> str:
    """Return a text safe for a terminal: without control characters, and of limited length."""
    raw = "-" if value is None else str(value)[:LONGEST]
    return "".join(c if c.isprintable() else "?" for c in raw)


def listed(value: Any) -> list[Any]:
    """A list, or an empty one."""
    return value if isinstance(value, list) else []


def mapped(value: Any) -> Mapping[str, Any]:
    """A mapping, or an empty one."""
    return value if isinstance(value, dict) else {}


def metres(value: Any, digits: int = 2) -> str:
    """``0.42 m``; ``-`` if it is not a number."""
    found = number(value)
    return "-" if found is None else f"{found:.{digits}f} m"
