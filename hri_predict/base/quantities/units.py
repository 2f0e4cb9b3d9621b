"""Unit of a setting, and a hint for a number given in another unit."""

import math
import re

_UNITS = {
    "_m_s2": "m/s^2",
    "_m_s": "m/s",
    "_rad_s": "rad/s",
    "_rad": "rad",
    "_hz": "Hz",
    "_kg": "kg",
    "_mb": "MB",
    "_gb": "GB",
    "_minutes": "min",
    "_days": "days",
    "_cm2": "cm^2",
    "_ppm": "ppm",
    "_s": "s",
    "_m": "m",
    "baudrate": "bit/s",
    "bitrate": "bit/s",
    "seconds": "s",
    "yaw": "rad",
}
_NAMES = {  # name of the unit, and how much of the unit that is often mistaken for it makes one
    "m": ("metres", 1e-3),
    "m/s": ("metres per second", 1e-3),
    "m/s^2": ("metres per second squared", 1e-3),
    "rad": ("radians", math.pi / 180),
    "rad/s": ("radians per second", math.pi / 180),
    "kg": ("kilograms", 1e-3),
    "s": ("seconds", 1e-3),
}
MAX_MEANT = 1000.0  # what is still larger in the other unit is simply wrong
_SAID = re.compile(r"[,;] (m|m/s|rad|rad/s|kg|s)$")


def unit_of(key: str) -> str:
    """Return the unit at the end of a key's name; empty if there is none."""
    return next((unit for end, unit in _UNITS.items() if key.endswith(end)), "")


def unit_at(key: str, description: str) -> str:
    """Return the unit of a key from its name or the end of its description; empty if neither has
    one.
    """
    said = _SAID.search(description.split("; ")[0])
    return unit_of(key) or (said[1] if said else "")


def phrase(key: str, description: str) -> str:
    """Return a key's description up to its first semicolon, with its unit."""
    said = description.split("; ")[0]
    unit = unit_of(key)
    return f"{said}, {unit}" if unit else said


def rounded(value: float | None) -> float | None:
    """Return a number for people and files, to four digits after the point."""
    return None if value is None else round(value, 4)


def meant(value: float, unit: str, low: float = -math.inf, high: float = math.inf) -> str:
    """Return the hint for a number that is too large: ``metres are meant: 0.8?``; empty for other
    units.

    The proposed number assumes that a thousandth of the unit, or degrees, was meant; it is omitted
    if outside ``low`` .. ``high``.
    """
    if unit not in _NAMES:
        return ""
    name, share = _NAMES[unit]
    if not abs(value) * share <= MAX_MEANT or not low <= value * share <= high:
        return f"{name} are meant"
    return f"{name} are meant: {value * share:.4g}?"
