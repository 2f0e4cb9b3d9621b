"""The table of looks, as a script and a style sheet of the operator's pages."""

import json

from hri_predict.base.looks import LOOKS
from hri_predict.operation.monitoring.fleet_levels import WORST_FIRST
from hri_predict.protocol.messages import LEVELS, Level

_SLOWED = {level.name for level in LEVELS if level.rank >= Level.SLOW.rank}


def script() -> str:
    """``LOOKS``: symbol, word, and whether the robot slows, by level, most urgent first."""
    looks = {
        name: {
            "shape": LOOKS[name].shape,
            "sign": LOOKS[name].sign,
            "word": LOOKS[name].word,
            "slows": name in _SLOWED,
        }
        for name in WORST_FIRST
    }
    return f'"use strict";\nconst LOOKS = {json.dumps(looks)};\n'


def style() -> str:
    """Return the colours of each level, for elements of its class."""
    colours = ((name, LOOKS[name]) for name in WORST_FIRST)
    return "".join(
        f".{name} {{ --field: {look.field}; --ink: {look.ink}; }}\n" for name, look in colours
    )
