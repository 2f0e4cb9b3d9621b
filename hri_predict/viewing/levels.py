"""Appearance of levels, people and rooms on all screens: colours, and which level is the worst."""

from collections.abc import Iterable
from operator import attrgetter

from hri_predict.base.looks import LOOKS, Rgb
from hri_predict.protocol.messages import Level

COLOURS: dict[str, Rgb] = {level: look.rgb for level, look in LOOKS.items()}
GREY: Rgb = (128, 128, 128)
"""Nothing is known: no node, no picture."""
PERSON: Rgb = (30, 105, 230)
LOST: Rgb = COLOURS["UNKNOWN"]
"""Also of shadows and of unseen floor: a person may be there."""
FORECAST: Rgb = (90, 190, 255)
VIEW: Rgb = (80, 170, 190)
GRID: Rgb = (95, 103, 112)


def colour(level: str) -> Rgb:
    """The colour of a level by its name; grey for what is none."""
    return COLOURS.get(level, GREY)


def worst(levels: Iterable[str]) -> str:
    """The most urgent level; UNKNOWN without any, and for a name that is not a level."""
    known = [Level.__members__.get(level, Level.UNKNOWN) for level in levels]
    return max(known, key=attrgetter("urgency"), default=Level.UNKNOWN).name


def css(rgb: Rgb) -> str:
    """A colour for a style sheet."""
    return f"rgb({rgb[0]},{rgb[1]},{rgb[2]})"
