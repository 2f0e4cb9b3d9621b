"""Operating modes: teach, recovery and muting, if allowed, requested and safe.

A mode replaces the demand of people and zones on a robot, but never *unknown* or a fault. ``Modes``
decides in each tick. It remembers the mode in force, for the log, and whether muting may start: the
request must have been released before, and the muted time must not be used up (``MutedTime``).
"""

import logging
from collections import Counter
from dataclasses import dataclass

from hri_predict.protocol.messages import Level, OperatingMode, RobotMode
from hri_predict.protocol.reasons import Reason
from hri_predict.risk.levels.demand import Demand
from hri_predict.risk.levels.muted_time import MutedTime
from hri_predict.robots.mode_request import ModeRequest
from hri_predict.robots.modes import ModeSettings
from hri_predict.robots.tracker import RobotNow

log = logging.getLogger(__name__)

REFUSED_EVERY_NS = 1_000_000_000
SETTLED_NS = 200_000_000
"""Minimum duration of a reason before it is logged; two controllers never switch simultaneously."""
"""Minimum interval between logged refusals, so that a controller cannot fill the log."""
_KEYS = {
    OperatingMode.TEACH: "teach",
    OperatingMode.RECOVERY: "recovery",
    OperatingMode.MUTED: "muting",
}
REASONS = {
    OperatingMode.TEACH: Reason.TEACH,
    OperatingMode.RECOVERY: Reason.RECOVERY,
    OperatingMode.MUTED: Reason.MUTED,
}
_NOT_BY_PEOPLE = "people do not stop the robot"
_WITHIN_BAND = (
    "people are not near enough to stop the robot again; a stop that holds clears when they "
    "are farther away by risk.band_m"
)
_NOT_RELEASED = "the request was already active; release it first"


@dataclass(frozen=True, slots=True, kw_only=True)
class Situation:
    """Inputs of the decision.

    Attributes:
        asked: requests of the robot's controllers.
        demand: demand of people, zones and unseen space, or *unknown*.
        is_known: whether the scene, the robot and the configuration set are all known reliably.
        beside_unseen: whether unseen space stops the robot.
        not_backing_out: why the robot would not recede from every person while backing out; "" if
            it would.
    """

    asked: ModeRequest
    demand: Demand
    is_known: bool
    beside_unseen: bool = False
    not_backing_out: str = ""


@dataclass(frozen=True, slots=True)
class Decision:
    """The mode in force, its demand, and a note for people ("" without a request)."""

    mode: OperatingMode
    demand: Demand
    note: str = ""


def why_no_teaching(settings: ModeSettings, asked: ModeRequest) -> str:
    """Return why teaching is not permitted now; "" if it is."""
    if settings.teach is None:
        return _not_allowed(OperatingMode.TEACH)
    if not asked.agreed or asked.request is not OperatingMode.TEACH:
        return "not all of its controllers request it"
    if asked.mode is not RobotMode.MANUAL:
        return "the controller is not in manual mode"
    return "" if asked.enabling else "the enabling device is not held"


def admitted(now: RobotNow, settings: ModeSettings) -> RobotNow:
    """Return the robot's state; without ``ROBOT_NOT_AUTOMATIC`` while teaching is permitted."""
    if Reason.ROBOT_NOT_AUTOMATIC in now.reasons and not why_no_teaching(settings, now.asked):
        return now.without(Reason.ROBOT_NOT_AUTOMATIC)
    return now


class Modes:
    """The operating modes of one robot.

    Args:
        settings: the allowed modes.
        name: the robot's name.
        max_speed_m_s: the robot's highest speed.

    Attributes:
        mode: the mode in force.
        muted_time: remaining time for muting; ``None``: muting is not allowed.
        counters: number of times that each mode started (``teach``, ``recovery``, ``muted``) and
            that a request was ``refused``.
    """

    def __init__(self, settings: ModeSettings, name: str, max_speed_m_s: float) -> None:
        self._settings = settings
        self._name = name
        self._max_speed = max_speed_m_s
        self.mode = OperatingMode.AUTOMATIC
        self.counters: Counter[str] = Counter()
        self._barred = _NOT_RELEASED  # why the request for muting does not count; "" if it does
        self.muted_time = None if settings.muting is None else MutedTime(settings.muting)
        self._refused: tuple[OperatingMode, str] | None = None
        self._refused_ns, self._is_news = 0, False
        self._told_ns: int | None = None

    def decide(self, situation: Situation, now_ns: int) -> Decision:
        """Return the mode for this tick.

        Args:
            situation: the situation at this tick.
            now_ns: time of the tick.
        """
        asked, before = situation.asked, self.mode
        released = asked.heard and asked.agreed and asked.request is not OperatingMode.MUTED
        if released:
            self._barred = ""
        if self.muted_time is not None:
            was_muted = before is OperatingMode.MUTED
            self.muted_time.count(now_ns, muted=was_muted, released=released)
        why = "" if asked.request is OperatingMode.AUTOMATIC else self._why_not(situation, now_ns)
        mode = asked.request if not why else OperatingMode.AUTOMATIC
        self._change(mode, why or _ended(situation))
        if OperatingMode.MUTED is before is not mode and not released:
            over = self.muted_time is not None and not self.muted_time.may_begin
            self._barred = why if over else _NOT_RELEASED
        self._refuse(asked.request, why, now_ns)
        demand = situation.demand
        if mode is not OperatingMode.AUTOMATIC:
            demand = self._demand(mode)
        elif situation.is_known and asked.mode is not RobotMode.AUTOMATIC:
            demand = Demand.unknown(Reason.ROBOT_NOT_AUTOMATIC)
        return Decision(mode, demand, self._note(mode, asked.request, why))

    def reset(self) -> None:
        """End the mode after a failed tick."""
        self._change(OperatingMode.AUTOMATIC, "the tick failed")
        self._barred = _NOT_RELEASED

    def _why_not(self, situation: Situation, now_ns: int) -> str:
        """Return why the request is refused; "" if it is granted."""
        asked, settings = situation.asked, self._settings
        if asked.request is OperatingMode.TEACH:
            why = why_no_teaching(settings, asked)
        elif getattr(settings, _KEYS[asked.request]) is None:
            why = _not_allowed(asked.request)
        elif not asked.agreed:
            why = "not all of its controllers request it"
        elif asked.mode is not RobotMode.AUTOMATIC:
            why = "the controller is not in automatic mode"
        elif asked.request is OperatingMode.MUTED:
            why = self._why_not_muted()
        else:
            why = self._why_no_recovery(situation)
        return why or ("" if situation.is_known else "the situation is unknown")

    def _why_not_muted(self) -> str:
        muting, time = self._settings.muting, self.muted_time
        assert muting is not None  # or it were not allowed
        assert time is not None
        if self._barred or time.may_begin:
            return self._barred
        if self.mode is OperatingMode.MUTED:
            return f"its {muting.max_s:g} s are over; release the request"
        return (
            f"its {muting.max_s:g} s are used up; it counts again after {muting.recovery_s:g} s "
            "without a request"
        )

    def _why_no_recovery(self, situation: Situation) -> str:
        """Recovery starts when people stop the robot, and continues until they would release it."""
        demand = situation.demand
        goes_on = self.mode is OperatingMode.RECOVERY
        level = demand.release if goes_on else demand.level
        if demand.level is Level.FAULT:
            return _NOT_BY_PEOPLE
        if level.may_move:
            within = not demand.release.may_move
            return _WITHIN_BAND if within else _NOT_BY_PEOPLE
        if not situation.is_known:
            return ""  # said by the caller
        if situation.beside_unseen or not demand.reason.row.in_view:
            return "something other than people in view stops the robot"
        return situation.not_backing_out

    def _demand(self, mode: OperatingMode) -> Demand:
        teach, recovery, muting = (
            self._settings.teach,
            self._settings.recovery,
            self._settings.muting,
        )
        limit = self._max_speed
        if mode is OperatingMode.TEACH and teach is not None:
            limit = min(limit, teach.speed_m_s)
        elif mode is OperatingMode.RECOVERY and recovery is not None:
            limit = min(limit, recovery.speed_m_s)
        elif muting is not None and muting.speed_m_s is not None:
            limit = min(limit, muting.speed_m_s)
        slow = mode is not OperatingMode.MUTED or limit < self._max_speed
        level = Level.SLOW if slow else Level.WARN
        return Demand(
            level=level,
            release=level,
            limit_m_s=limit,
            release_limit_m_s=limit,
            reason=REASONS[mode],
        )

    def _change(self, mode: OperatingMode, ended: str) -> None:
        """Record and log a change of mode."""
        before, self.mode = self.mode, mode
        if mode is before:
            return
        if before is not OperatingMode.AUTOMATIC:
            log.warning("robot %s: %s ends: %s", self._name, _word(before), ended)
        if mode is not OperatingMode.AUTOMATIC:
            self.counters[_word(mode)] += 1
            log.warning("robot %s: %s begins: %s", self._name, _word(mode), REASONS[mode].text)

    def _refuse(self, request: OperatingMode, why: str, now_ns: int) -> None:
        """Count a refusal, and log it if it is new."""
        refused = (request, why) if why else None
        if refused != self._refused:
            self._refused, self._refused_ns = refused, now_ns
            self._is_news = refused is not None
            self.counters["refused"] += self._is_news
        lasts = now_ns - self._refused_ns >= SETTLED_NS
        due = self._told_ns is None or now_ns - self._told_ns >= REFUSED_EVERY_NS
        if self._is_news and lasts and due:
            self._is_news, self._told_ns = False, now_ns
            log.warning("robot %s: %s refused: %s", self._name, _word(request), why)

    def _note(self, mode: OperatingMode, request: OperatingMode, why: str) -> str:
        if why:
            return f"{self._name}: {_word(request)} refused: {why}"
        if mode is OperatingMode.MUTED and self.muted_time is not None:
            left_s = self.muted_time.left_s
            return f"{self._name}: MUTED, people do not stop it for another {left_s:.1f} s"
        return "" if mode is OperatingMode.AUTOMATIC else f"{self._name}: mode {_word(mode)}"


def _ended(situation: Situation) -> str:
    if not situation.is_known or not situation.asked.heard:
        return "the situation is unknown"
    return "the request was released"


def _not_allowed(mode: OperatingMode) -> str:
    return f"modes.{_KEYS[mode]} is not configured for this robot"


def _word(mode: OperatingMode) -> str:
    return mode.name.lower()
