"""Demand of a named zone on a robot."""

from hri_predict.protocol.messages import Level
from hri_predict.protocol.reasons import Reason
from hri_predict.risk.areas import NamedZoneSettings
from hri_predict.risk.levels.demand import Demand
from hri_predict.risk.types import NamedZoneState

_LEVELS = {"warn": Level.WARN, "slow": Level.SLOW, "stop": Level.STOP}


def zone_demand(
    zone: NamedZoneSettings, state: NamedZoneState, robot: str, max_speed_m_s: float
) -> Demand:
    """Return the demand of ``zone`` on ``robot`` in this state."""
    asked = not zone.robots or robot in zone.robots
    soon = state.entry_s is not None and state.entry_s <= zone.entry_warning_s
    entering = soon and zone.entry_warning_s > 0
    if zone.level == "none" or not asked or not (state.occupied or entering):
        return Demand.nothing(max_speed_m_s)
    level = _LEVELS[zone.level]
    limit = {
        Level.WARN: max_speed_m_s,
        Level.SLOW: min(zone.speed_limit_m_s, max_speed_m_s),
    }.get(level, 0.0)
    reason = Reason.ZONE_OCCUPIED if state.occupied else Reason.ZONE_ENTRY_PREDICTED
    return Demand(
        level=level, release=level, limit_m_s=limit, release_limit_m_s=limit, reason=reason
    )
