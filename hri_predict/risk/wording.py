"""Texts for advice and node states, shared by all screens."""

from collections.abc import Sequence

from hri_predict.protocol.messages import Advice, Level, NodeState
from hri_predict.protocol.reasons import CLEARED, RISING, Reason
from hri_predict.risk.types import Grounds

STANDS_M_S = 0.01
"""Speed below which texts describe a robot as stopped."""
NOTE = "no person is too close; note: "
NO_LINK = "a link to a controller is not connected"
"""The only cause that degrades a node without a reason (``Node.state``)."""
_RELEASED = "new captures confirm that its cause has cleared, and the speed limit has risen"
_MORE = {
    Level.WARN: "the warning comes earlier",
    Level.SLOW: "more is needed for full speed",
}


def reason_beside(advice: Advice) -> str:
    """Return the reason for display with its level; at *clear* it is only a note."""
    is_note = advice.level is Level.CLEAR and advice.reason is not Reason.NONE
    return f"{NOTE if is_note else ''}{advice.reason.text}"


def clears_beside(advice: Advice, band_m: float | None) -> str:
    """Return the condition that clears the advice; "" at *clear*.

    Args:
        advice: after the cause has cleared, the reason remains until the release; the detail shows
            this.
        band_m: the configured ``risk.band_m``; ``None``: not known.
    """
    if advice.level is Level.CLEAR:
        return ""
    if CLEARED in advice.detail or RISING in advice.detail:
        return _RELEASED
    clears = advice.reason.clears_when
    if band_m is None:
        return clears
    return clears.replace("by risk.band_m", f"by {band_m:g} m (risk.band_m)")


def off_text(error_m: float) -> str:
    """Return the stated position error of a person as a clause; "" if the position is exact."""
    return f", whose place may be off by {error_m:.2f} m" if error_m > 0 else ""


def apart_text(advice: Advice, why: Grounds) -> str:
    """Return the distance of the deciding pair, and the remainder for the present motion.

    A distance that suffices at the present speed may not suffice for a higher speed; the text adds
    this, so that it does not contradict the level.
    """
    pair_m, needed_m, speed_m_s = why.pair_m, why.pair_needed_m, why.speed_m_s
    if pair_m is None:
        return "?"
    apart = f"{max(0.0, pair_m):.2f} m"
    if needed_m is None or speed_m_s is None:
        return apart
    slack_m, stands = pair_m - needed_m, speed_m_s < STANDS_M_S
    if slack_m < 0:
        at = "to start" if stands else f"at {speed_m_s:.2f} m/s"
        return f"{apart}, {-slack_m:.2f} m too near {at}"
    more = _MORE.get(advice.level, "")
    if advice.level is Level.STOP:
        more = f"more is needed to {'start' if stands else 'move on'}"
    if CLEARED in advice.detail:
        more = "new captures must confirm it"
    elif RISING in advice.detail:
        more = "the speed limit rises"
    more = f"; {more}" if more and advice.reason.row.by_distance else ""
    return f"{apart}, to spare {slack_m:.2f} m at {speed_m_s:.2f} m/s{more}"


def troubles(
    state: NodeState, reasons: Sequence[Reason], not_connected: Sequence[str] = ()
) -> list[str]:
    """Return, as text, why a node is in this state: its reasons, and unconnected links by name."""
    said = [reason.text for reason in dict.fromkeys(reasons) if reason is not Reason.NONE]
    said += [f"link {name} is not connected" for name in not_connected]
    return said or ([NO_LINK] if state is NodeState.DEGRADED else [])
