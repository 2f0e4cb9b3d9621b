"""Which levels a calibration guarantees, in words."""

from hri_predict.zones.calibration import Calibration, needed
from hri_predict.zones.motion_class import SPEED_CLASSES
from hri_predict.zones.settings import LEVELS

_DO = {"still": "stand still", "slow": "move slowly", "brisk": "move briskly"}


def levels_text(calibration: Calibration) -> list[str]:
    """One line per level: guaranteed, or estimated and how many recordings are missing."""
    lines = []
    for level in LEVELS:
        lacks = {
            name: needed(level) - calibration.independent(index)
            for index, name in enumerate(SPEED_CLASSES)
        }
        short = [f"{n} of people who {_DO[name]}" for name, n in lacks.items() if n > 0]
        if short:
            first, *others = short
            listed = ", ".join([first.replace(" of ", " more recordings of ", 1), *others])
            said = f"estimated; a guarantee needs {listed}"
        else:
            said = "guaranteed"
        lines.append(f"{100 * level:g} %: {said}")
    return lines
