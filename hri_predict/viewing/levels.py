"""How levels look everywhere: colours, and what a person calls them."""

from collections.abc import Iterable

Rgb = tuple[int, int, int]

COLOURS: dict[str, Rgb] = {
    "CLEAR": (46, 160, 67),
    "WARN": (240, 190, 20),
    "SLOW": (245, 130, 20),
    "STOP": (215, 38, 38),
    "UNKNOWN": (150, 60, 200),
    "FAULT": (150, 60, 200),
}
GREY: Rgb = (128, 128, 128)
"""Nothing is known: no node, no picture."""
_WORST = ("CLEAR", "WARN", "SLOW", "STOP", "UNKNOWN", "FAULT")


def colour(level: str) -> Rgb:
    """The colour of a level by its name; grey for what is none."""
    return COLOURS.get(level, GREY)


def worst(levels: Iterable[str]) -> str:
    """The level that asks most; UNKNOWN without any."""
    known = [level if level in _WORST else "UNKNOWN" for level in levels]
    return max(known, key=_WORST.index, default="UNKNOWN")


def css(rgb: Rgb) -> str:
    """A colour for a style sheet."""
    return f"rgb({rgb[0]},{rgb[1]},{rgb[2]})"
