"""Appearance of levels: the only table, used by pages, terminal, 3D view, plots and recordings."""

import importlib
from dataclasses import dataclass

from hri_predict.base.errors import ConfigError

Rgb = tuple[int, int, int]

PALETTE = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#8C564B", "#000000")
"""Colours of lines in plots, distinguishable for colour-blind readers: M. Okabe and K. Ito, "Color
universal design" (2008).
"""


@dataclass(frozen=True, slots=True)
class Look:
    """Appearance of a level. Its word, and its sign within the shape, identify it without colour.

    Attributes:
        colour: in reports, plots, the 3D view and recordings.
        field: background on the operator's pages, dark enough for the white symbol.
        ink: colour of text on that background.
        shape: symbol on the operator's pages: "circle", or corners in a 100 x 100 field.
        sign: character inside the symbol.
        word: name on the operator's pages.
        terminal: style in a terminal, as rich has it.
    """

    colour: str
    field: str
    ink: str
    shape: str
    sign: str
    word: str
    terminal: str

    @property
    def rgb(self) -> Rgb:
        """The colour as red, green and blue, 0 to 255."""
        red, green, blue = (int(self.colour[k : k + 2], 16) for k in (1, 3, 5))
        return red, green, blue

    def rgba(self, opacity: float) -> tuple[float, float, float, float]:
        """Return the colour as red, green, blue and opacity, 0 to 1."""
        red, green, blue = self.rgb
        return red / 255, green / 255, blue / 255, opacity


_WHITE, _BLACK = "#fff", "#111"
_TRIANGLE, _DIAMOND = "50,6 96,90 4,90", "50,2 98,50 50,98 2,50"
_OCTAGON = "30,2 70,2 98,30 98,70 70,98 30,98 2,70 2,30"
_SQUARE = "8,8 92,8 92,92 8,92"

LOOKS = {
    "CLEAR": Look("#2ea043", "#1f7a34", _WHITE, "circle", "✓", "CLEAR", "green"),
    "WARN": Look("#f0be14", "#f2c200", _BLACK, _TRIANGLE, "!", "WARN", "yellow"),
    "SLOW": Look("#f58214", "#e8730c", _BLACK, _DIAMOND, "▼", "SLOW", "dark_orange"),
    "STOP": Look("#d72626", "#c81e1e", _WHITE, _OCTAGON, "■", "STOP", "red"),
    "UNKNOWN": Look("#963cc8", "#7a2fb0", _WHITE, _SQUARE, "?", "UNKNOWN", "magenta"),
    "FAULT": Look("#5a1e87", "#7a2fb0", _WHITE, _SQUARE, "×", "FAULT", "white on red"),
    "GONE": Look("#808080", "#777", _WHITE, _SQUARE, "–", "NO CONTACT", "magenta"),
}
"""By name of the level. GONE is not a level of advice: without messages, the level is unknown."""

LEVEL_COLOURS = {name: look.colour for name, look in LOOKS.items() if name != "GONE"}


def can_plot() -> bool:
    """Whether matplotlib, which an extra brings, is installed."""
    try:
        importlib.import_module("hri_predict.base.figures")
    except ConfigError:
        return False
    return True
