"""Appearance of levels, people and rooms on all screens: colours, and the order of levels."""

from collections.abc import Iterable
from operator import attrgetter

from hri_predict.base.looks import LOOKS, Rgb
from hri_predict.protocol.messages import Level

COLOURS: dict[str, Rgb] = {level: look.rgb for level, look in LOOKS.items()}
GREY: Rgb = (128, 128, 128)
"""Colour without a node or picture: nothing is known."""
PERSON: Rgb = (30, 105, 230)
LOST: Rgb = COLOURS["UNKNOWN"]
"""Colour of lost people, and of shadows and unseen floor, where a person may be."""
FORECAST: Rgb = (90, 190, 255)
VIEW: Rgb = (80, 170, 190)
GRID: Rgb = (95, 103, 112)


def colour(level: str) -> Rgb:
    """Return the colour of a level by name; grey for an unknown name."""
    return COLOURS.get(level, GREY)


def worst(levels: Iterable[str]) -> str:
    """Return the most urgent level; UNKNOWN without levels, and for a name that is not a level."""
    known = [Level.__members__.get(level, Level.UNKNOWN) for level in levels]
    return max(known, key=attrgetter("urgency"), default=Level.UNKNOWN).name


def css(rgb: Rgb) -> str:
    """Return a colour for a style sheet."""
    return f"rgb({rgb[0]},{rgb[1]},{rgb[2]})"
