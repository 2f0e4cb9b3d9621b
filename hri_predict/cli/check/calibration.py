"""``check``: how old the zones' calibration is, and what it guarantees."""

from datetime import date
from typing import Any

import numpy as np

from hri_predict.lab.calibration.levels import levels_text
from hri_predict.run import assemble
from hri_predict.run.config import Config
from hri_predict.zones.calibration import Calibration
from hri_predict.zones.motion_class import SPEED_CLASSES

OLD_DAYS = 365
"""After a year most cells have other people, other work or another tracker."""


def calibration_facts(config: Config, today: date) -> dict[str, Any] | None:
    """Age, recordings and levels of the calibration; ``None`` where zones have none."""
    if not config.node.risk.uses_forecasts:
        return None
    calibration = assemble.build_calibration(config)
    return None if calibration is None else facts_of(calibration, today)


def facts_of(calibration: Calibration, today: date) -> dict[str, Any]:
    """See ``calibration_facts``."""
    made, site = calibration.made, calibration.site
    return {
        "made": None if made is None else made.isoformat(),
        "age_days": None if made is None else (today - made).days,
        "recordings": len(calibration.recordings),
        "site_parts": 0 if site is None else len(site.recordings),
        "levels": levels_text(calibration),
        "uncalibrated": [
            name
            for name, factors in zip(
                SPEED_CLASSES, calibration.estimated["joint"].swapaxes(0, 1), strict=True
            )
            if not np.isfinite(factors).any()
        ],
    }


def calibration_lines(facts: dict[str, Any] | None) -> list[str]:
    """The same for a person."""
    if facts is None:
        return []
    days = facts["age_days"]
    if days is None:
        age = "it does not say when it was made"
    elif days < 0:
        age = f"made on {facts['made']}, which is in the future: check this computer's date"
    else:
        age = f"made on {facts['made']}, {days} day{'' if days == 1 else 's'} ago"
        if days > OLD_DAYS:
            age += "; is it still true of these people and this tracker? See hri-predict calibrate"
    site = f", moved by {facts['site_parts']} parts of a site's" if facts["site_parts"] else ""
    return [
        f"calibration: {age}; from {facts['recordings']} recordings{site}",
        *(f"  {line}" for line in facts["levels"]),
    ]


def calibration_notes(facts: dict[str, Any] | None) -> list[str]:
    """Return the gaps of a thin calibration: speed classes that too few recordings show."""
    if facts is None or not facts["uncalibrated"]:
        return []
    return [
        f"the calibration has too few recordings of people who are "
        f"{' or '.join(facts['uncalibrated'])}; physical limits are used for them instead"
    ]
