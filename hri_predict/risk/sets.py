"""Configuration sets (``risk.sets``), which a PLC may choose by number while the node runs."""

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
    """One set: an entry of ``risk.sets``. All other settings stay as configured."""

    number: int = Field(ge=1, le=65_535, description="number with which a PLC chooses the set")
    name: Name = Field(description="unique name of the set, for people")
    zones: list[str] | None = Field(
        None, max_length=32, description="active named zones; default: all"
    )
    max_speed_m_s: float | None = Field(
        None,
        ge=MIN_SPEED_M_S,
        le=100,
        description="maximum speed advised to any robot; default: each robot's own max_speed_m_s",
    )

    safety: ClassVar[Safety] = harmless("number") | {
        "max_speed_m_s": LessSafe(above="robots may move at up to {value:g} m/s"),
        "zones": LessSafe(other="people in the other zones have no effect"),
    }


def set_hash(chosen: SetSettings, zones: Sequence[NamedZoneSettings]) -> int:
    """Return a 32-bit hash, never 0, of everything that the set puts in force."""
    asking = [z for z in zones if chosen.zones is None or z.name in chosen.zones]
    whole = [chosen.model_dump(mode="json"), *(zone.model_dump(mode="json") for zone in asking)]
    text = json.dumps(whole, sort_keys=True)
    return int.from_bytes(hashlib.sha256(text.encode()).digest()[:4], "big") or 1


def check_sets(
    sets: Sequence[SetSettings],
    zones: Sequence[NamedZoneSettings],
    *,
    min_speed_m_s: float,
    max_speeds_m_s: Sequence[float],
) -> None:
    """Refuse duplicate numbers or names, unknown zones, and implausible speeds.

    Args:
        sets, zones: as configured.
        min_speed_m_s: limits below this are advised as a stop.
        max_speeds_m_s: maximum speed of each robot.

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
            if each.zones and each.zones.count(name) > 1:
                raise ConfigError(
                    f"risk.sets: set {each.number} names zone '{name}' twice; remove one"
                )
        _check_speed(each, min_speed_m_s, max_speeds_m_s)


def _check_speed(
    chosen: SetSettings, min_speed_m_s: float, max_speeds_m_s: Sequence[float]
) -> None:
    """Refuse a speed at which no robot could move, or that limits no robot."""
    speed_m_s, which = chosen.max_speed_m_s, f"risk.sets: set {chosen.number} ({chosen.name})"
    if speed_m_s is None:
        return
    if speed_m_s < min_speed_m_s:
        raise ConfigError(
            f"{which}: max_speed_m_s {speed_m_s:g} is below risk.min_speed_m_s {min_speed_m_s:g}, "
            "which means stop; raise the speed, or lower risk.min_speed_m_s"
        )
    if max_speeds_m_s and speed_m_s > max(max_speeds_m_s):
        raise ConfigError(
            f"{which}: max_speed_m_s {speed_m_s:g} limits no robot, as none is faster than "
            f"{max(max_speeds_m_s):g} m/s; lower it, or leave it out"
        )
