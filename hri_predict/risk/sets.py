"""Configuration sets (``risk.sets``): what a PLC may change by a number, while the node runs."""

import hashlib
import json
from collections.abc import Sequence
from typing import ClassVar

from pydantic import Field

from hri_predict.base.errors import ConfigError, nearest
from hri_predict.base.quantities.safe_side import LessSafe, Safety, harmless
from hri_predict.base.settings import MIN_SPEED_M_S, Name, Settings
from hri_predict.risk.areas import NamedZoneSettings


class SetSettings(Settings):
    """One set: an entry of ``risk.sets``. Everything else stays as configured."""

    number: int = Field(ge=1, le=65_535, description="the number by which a PLC chooses it")
    name: Name = Field(description="its own name, for people")
    zones: list[str] | None = Field(
        None, max_length=32, description="named zones that ask anything of robots; default: all"
    )
    max_speed_m_s: float | None = Field(
        None,
        ge=MIN_SPEED_M_S,
        le=100,
        description="no robot is advised more than this; default: each robot's own max_speed_m_s",
    )

    safety: ClassVar[Safety] = harmless("number") | {
        "max_speed_m_s": LessSafe(above="robots may move at up to {value:g} m/s"),
        "zones": LessSafe(other="people in the other zones change nothing"),
    }


def set_hash(chosen: SetSettings, zones: Sequence[NamedZoneSettings]) -> int:
    """Return 32 bits, never 0, that change with anything that the set puts in force."""
    asking = [z for z in zones if chosen.zones is None or z.name in chosen.zones]
    whole = [chosen.model_dump(mode="json"), *(zone.model_dump(mode="json") for zone in asking)]
    text = json.dumps(whole, sort_keys=True)
    return int.from_bytes(hashlib.sha256(text.encode()).digest()[:4], "big") or 1


def check_sets(sets: Sequence[SetSettings], zones: Sequence[NamedZoneSettings]) -> None:
    """Refuse two sets of one number or name, and zones that there are not.

    Raises:
        ConfigError: one line with the remedy.
    """
    for key in ("number", "name"):
        given = [getattr(each, key) for each in sets]
        for value in given:
            if given.count(value) > 1:
                raise ConfigError(f"risk.sets: two sets have the {key} {value}; give each its own")
    known = [zone.name for zone in zones]
    for each in sets:
        for name in each.zones or ():
            if name not in known:
                raise ConfigError(
                    f"risk.sets: set {each.number} names the unknown zone '{name}'"
                    f"{nearest(name, known)} (known: {', '.join(known) or 'none'})"
                )
