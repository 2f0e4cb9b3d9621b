"""Demands by hand."""

from hri_predict.protocol.messages import Level
from hri_predict.protocol.reasons import Reason
from hri_predict.risk.levels.demand import Demand


def asks(
    level: Level,
    limit_m_s: float,
    reason: Reason = Reason.PERSON_APPROACHING,
    release: Level | None = None,
    release_limit_m_s: float | None = None,
) -> Demand:
    """A release may go as far as the demand itself, unless told otherwise."""
    return Demand(
        level=level,
        release=level if release is None else release,
        limit_m_s=limit_m_s,
        release_limit_m_s=limit_m_s if release_limit_m_s is None else release_limit_m_s,
        reason=reason,
    )
