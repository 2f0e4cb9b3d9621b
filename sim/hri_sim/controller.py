"""What a careful robot controller does with the node's advice, without any input or output.

The rule: whatever is silent, stale, corrupt, out of order, of an unknown schema, or asks for
anything but *clear*, *warn* or *slow* means that the robot may not move. It trusts nothing that it
has not checked: counters and CRC of every message, the schema's hash before anything else counts,
and the age of every advice.

It shares no clock with the node. An advice carries the age that it had when it was encoded; the
time since its receipt is the controller's own; and what passed between is bounded by the echo: an
advice that repeats the counter of one of our RobotStates was encoded after we sent that one, so the
link took no longer than the time since. It is believed only if we sent that RobotState within the
last ``max_age_s`` and silence time-out: of older ones no time is kept, and whatever echoes them has
no age that could be bounded, so it is no permission. The counter's 65536 values last 22 min at
50 Hz (65 s at 1000 Hz); only an advice that is later than that could be taken for a fresh one.
"""

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, field
from math import ceil
from typing import Any, Generic, Literal, TypeVar

import numpy as np
from pydantic import Field

from hri_drivers.link_codec import Codec
from hri_predict.link import LinkCounters, LinkSettings
from hri_predict.protocol.messages import (
    Acknowledge,
    Advice,
    Level,
    Message,
    RobotMode,
    RobotState,
    Schema,
)
from hri_predict.protocol.reception import FORGET_S, SchemaGate
from hri_predict.scene import Floats
from hri_predict.settings import Settings

U = TypeVar("U")

COUNTERS = 1 << 16  # values of RobotState's counter
_MOVING_LEVELS = (Level.CLEAR, Level.WARN, Level.SLOW)
_FULL_SPEED_TOLERANCE = 0.01  # m/s: the wire's resolution is no slowdown
_MAX_EVENTS = 1000
_MAX_ROUND_TRIPS = 10_000


class ControllerSettings(Settings):
    """A link's ``simulate:`` block: the mock controller at its other end."""

    role: Literal["drive", "monitor"] = Field(
        "drive", description="drive moves the arm; monitor is an independent second channel"
    )
    robot: str | None = Field(None, description="default: the only robot there is")
    trajectory: str | None = Field(
        None, description="shipped name or YAML file; default that of the robot's motion"
    )
    reaction_s: float | None = Field(
        None, ge=0, le=2, description="from receipt until an advice acts; default the link's"
    )
    silence_timeout_s: float | None = Field(
        None, gt=0, le=2, description="silence until it stops by itself; default the link's"
    )
    deceleration: float | None = Field(
        None, gt=0, le=100, description="m/s^2 of the fastest point; default from stopping table"
    )
    acceleration: float = Field(1.0, gt=0, le=100, description="m/s^2 of the fastest point")
    max_age_s: float = Field(
        0.4, gt=0, le=5, description="age of an advice, link delay included, that it still obeys"
    )
    tolerated_errors: int = Field(
        0, ge=0, description="bad or missing messages within error_window_s that do not stop it"
    )
    error_window_s: float = Field(0.5, gt=0, le=10)
    state_rate_hz: float | None = Field(
        None, gt=0, le=1000, description="of RobotState; default the link's robot_state_rate_hz"
    )
    period_s: float = Field(0.008, gt=0, le=0.1, description="of its own cycle")
    start_s: float = Field(0.0, ge=0, description="where in its cycle the arm stands at the start")
    faults: list[dict[str, Any]] = Field(
        [], description="faults at its end of the wire; out is from the controller"
    )
    fault_seed: int = Field(0, ge=0, description="of what is random in them")
    acknowledge_after_s: float | None = Field(
        None, gt=0, description="press the button so long after a stop has latched; default never"
    )

    def resolved(self, link: LinkSettings) -> "ControllerSettings":
        """Fill what is not said from the link's own settings."""
        values = {
            "reaction_s": link.reaction_s,
            "silence_timeout_s": link.silence_timeout_s,
            "state_rate_hz": getattr(link, "robot_state_rate_hz", None) or 50.0,
        }
        missing = {k: v for k, v in values.items() if getattr(self, k) is None}
        return self.model_copy(update=missing)


@dataclass(slots=True)
class ControllerReport:
    """What a controller met. Times in seconds, of its own clock.

    Attributes:
        name, role, robot: of the link, the controller and the robot.
        ended: how: ``ok``, or ``killed`` (then nothing below was told).
        messages, bytes: received and good; received at all.
        crc_errors, counter_errors, malformed, incomplete: as the receiver counts them.
        schema_mismatches: Schema messages of another version or hash.
        schema_trouble: which one it heard last, and which it was built for.
        timeouts: times that the node fell silent.
        stale: times that the newest advice was or grew too old.
        max_age_s: greatest age of an advice at its receipt, as carried.
        max_gap_s: longest time between two good advices.
        round_trip_p50_s, round_trip_max_s: from sending a RobotState to an advice that echoes it.
        slowdowns: times that it went from full speed to a lower limit.
        stops: times that it had to stop while it was allowed to move.
        states_sent, acknowledges_sent, write_errors: what it sent, and what did not go out.
        stop_causes: cause -> how many of the stops.
        events: [seconds, cause, limit] of each change between running, slow and stopped (at most
            1000), seconds since its start, the limit in m/s.
    """

    name: str
    role: str
    robot: str
    ended: str = "ok"
    messages: int = 0
    bytes: int = 0
    crc_errors: int = 0
    counter_errors: int = 0
    malformed: int = 0
    incomplete: int = 0
    schema_mismatches: int = 0
    schema_trouble: str = ""
    timeouts: int = 0
    stale: int = 0
    max_age_s: float = 0.0
    max_gap_s: float = 0.0
    round_trip_p50_s: float | None = None
    round_trip_max_s: float | None = None
    slowdowns: int = 0
    stops: int = 0
    states_sent: int = 0
    acknowledges_sent: int = 0
    write_errors: int = 0
    stop_causes: dict[str, int] = field(default_factory=dict)
    events: list[tuple[float, str, float]] = field(default_factory=list)


@dataclass(frozen=True, slots=True)
class Permit:
    """What a controller allows: a speed in m/s, and what decides it."""

    speed_m_s: float
    cause: str


@dataclass(frozen=True, slots=True)
class _Heard:
    """The newest advice: when it came, and what its age was then at most (``None``: unbounded)."""

    at_ns: int
    age_bound_s: float | None
    limit_m_s: float
    level: Level


class ControllerCore(Generic[U]):
    """Receives, checks, decides, answers; whoever owns it brings the units and the time.

    An advice takes effect ``reaction_s`` after its receipt. The watchdogs (silence, age, errors,
    schema) act at once: their times are those until the robot begins to brake. Once one has acted,
    nothing that was heard before counts any more.
    """

    def __init__(
        self,
        name: str,
        settings: ControllerSettings,
        robot: int,
        codec: Codec[U],
        full_speed_m_s: float,
    ) -> None:
        """``settings`` are ``resolved``; ``robot`` is the index that an Advice carries."""
        if None in (settings.reaction_s, settings.silence_timeout_s, settings.state_rate_hz):
            raise ValueError("the settings must be resolved first")
        self._settings = settings
        self._reaction_ns = int((settings.reaction_s or 0.0) * 1e9)
        # it looks once a cycle, and must have stopped when the time is over
        silence_s = (settings.silence_timeout_s or 0.0) - settings.period_s
        self._silence_ns = int(max(silence_s, 0.0) * 1e9)
        self._state_ns = int(1e9 / (settings.state_rate_hz or 50.0))
        self._robot = robot
        self._codec = codec
        self._full_speed = full_speed_m_s
        self._counters = LinkCounters()
        self._errors: deque[int] = deque()  # when each happened
        self._schema = SchemaGate()
        self._heard: _Heard | None = None
        self._last_advice_ns: int | None = None
        self._pending: deque[tuple[int, Permit]] = deque()  # effective from, what
        self._in_effect: Permit | None = None
        self._watchdog = ""
        self._counter = 0  # of the newest RobotState
        kept_s = settings.max_age_s + (settings.silence_timeout_s or 0.0)
        # when each of the newest RobotStates went out, the newest last
        self._sent_ns: deque[int] = deque(maxlen=ceil(kept_s * 1e9 / self._state_ns) + 1)
        self._next_state_ns: int | None = None
        self._round_trips: deque[int] = deque(maxlen=_MAX_ROUND_TRIPS)
        self._latch: tuple[int, int] | None = None  # id, when to press the button
        self._obeyed = "stop"
        self._start_ns: int | None = None
        self._report = ControllerReport(name, settings.role, settings.robot or "")

    def receive(self, units: Sequence[U], now_ns: int) -> None:
        """Take what has come from the link by ``now_ns``."""
        self._watch(now_ns)
        before = self._error_count()
        for unit in units:
            self._report.bytes += self._codec.size(unit)
            for message in self._codec.decode(unit):
                self._report.messages += 1
                self._take(message, now_ns)
        self._codec.count(self._counters)
        # more than tolerated within the window is enough to know; no need to keep them all
        new = min(self._error_count() - before, self._settings.tolerated_errors + 1)
        self._errors.extend([now_ns] * new)

    def permit(self, now_ns: int) -> Permit:
        """Return what this controller allows now."""
        if watchdog := self._watch(now_ns):
            return Permit(0.0, watchdog)
        while self._pending and self._pending[0][0] <= now_ns:
            self._in_effect = self._pending.popleft()[1]
        return self._in_effect or Permit(0.0, "starting")

    def obey(self, permit: Permit, now_ns: int) -> None:
        """Note what is obeyed in the end: this controller's permit, or a lower one of another's."""
        if self._start_ns is None:
            self._start_ns = now_ns
        limit = permit.speed_m_s
        full = limit >= self._full_speed - _FULL_SPEED_TOLERANCE
        obeyed = "stop" if limit <= 0 else "run" if full else "slow"
        if obeyed == self._obeyed:
            return
        report = self._report
        report.slowdowns += (self._obeyed, obeyed) == ("run", "slow")
        if obeyed == "stop":
            report.stops += 1
            report.stop_causes[permit.cause] = report.stop_causes.get(permit.cause, 0) + 1
        self._obeyed = obeyed
        if len(report.events) < _MAX_EVENTS:
            since_s = round((now_ns - self._start_ns) * 1e-9, 6)
            report.events.append((since_s, permit.cause, round(limit, 4)))

    def outgoing(
        self, now_ns: int, q: Floats | None, qd: Floats | None, mode: RobotMode
    ) -> list[U]:
        """Return what to send now: RobotState when due, Acknowledge if the button is pressed.

        Args:
            now_ns: controller's clock.
            q, qd: (N,) rad and rad/s; ``None`` while they are not known: nothing is sent then.
            mode: operating mode to report.
        """
        units: list[U] = []
        if self._next_state_ns is None:
            self._next_state_ns = now_ns
            # by the clock: what answers a life before this one is as old here as it was there
            self._counter = now_ns // self._state_ns % COUNTERS
        if now_ns >= self._next_state_ns and q is not None and qd is not None:
            behind = (now_ns - self._next_state_ns) // self._state_ns
            self._next_state_ns += (1 + behind) * self._state_ns
            self._counter = (self._counter + 1) % COUNTERS
            self._sent_ns.append(now_ns)
            joints = tuple(q.tolist()), tuple(qd.tolist())
            state = RobotState(self._robot, mode, self._counter, *joints)
            units += self._codec.encode(state)
            self._report.states_sent += 1
        if self._latch is not None and now_ns >= self._latch[1]:
            self._report.acknowledges_sent += 1
            press = 1 + (self._report.acknowledges_sent - 1) % 255  # never 0
            units += self._codec.encode(Acknowledge(self._latch[0], press))
            self._arm_button(self._latch[0], now_ns)
        return units

    def write_failed(self) -> None:
        """Count a unit that the link did not take."""
        self._report.write_errors += 1

    def report(self) -> ControllerReport:
        """Return what this controller met so far."""
        report, counters = self._report, self._counters
        report.crc_errors = counters.crc_errors
        report.counter_errors = counters.counter_errors
        report.malformed = counters.malformed
        report.incomplete = counters.incomplete
        if self._round_trips:
            report.round_trip_p50_s = float(np.median(self._round_trips)) * 1e-9
            report.round_trip_max_s = max(self._round_trips) * 1e-9
        return report

    # -- what is heard ----------------------------------------------------------------------------

    def _take(self, message: Message, now_ns: int) -> None:
        if isinstance(message, Schema):
            self._schema.take(message)
            if not self._schema.open:
                self._report.schema_mismatches += 1
                self._report.schema_trouble = self._schema.why
        elif isinstance(message, Advice) and message.robot == self._robot:
            self._take_advice(message, now_ns)

    def _take_advice(self, advice: Advice, now_ns: int) -> None:
        if not self._schema.open:
            return
        if self._last_advice_ns is not None:
            gap_s = (now_ns - self._last_advice_ns) * 1e-9
            self._report.max_gap_s = max(self._report.max_gap_s, gap_s)
        self._last_advice_ns = now_ns
        limit = 0.0
        if advice.level in _MOVING_LEVELS and advice.speed_limit_m_s is not None:
            limit = max(0.0, advice.speed_limit_m_s)
        self._heard = _Heard(now_ns, self._age_bound(advice, now_ns), limit, advice.level)
        permit = Permit(limit, advice.level.name.lower())
        self._pending.append((now_ns + self._reaction_ns, permit))
        if advice.latch_id == 0:
            self._latch = None
        elif self._latch is None or self._latch[0] != advice.latch_id:
            self._arm_button(advice.latch_id, now_ns)

    def _age_bound(self, advice: Advice, now_ns: int) -> float | None:
        """Age of what the advice rests on, at most, at its receipt; ``None`` without a bound."""
        if advice.age_s is None or advice.echo is None:
            return None
        self._report.max_age_s = max(self._report.max_age_s, advice.age_s)
        behind = (self._counter - advice.echo) % COUNTERS
        if behind >= len(self._sent_ns):
            return None
        sent_ns = self._sent_ns[-1 - behind]
        self._round_trips.append(now_ns - sent_ns)
        return advice.age_s + (now_ns - sent_ns) * 1e-9

    def _arm_button(self, latch_id: int, now_ns: int) -> None:
        after_s = self._settings.acknowledge_after_s
        self._latch = None if after_s is None else (latch_id, now_ns + int(after_s * 1e9))

    # -- the watchdogs ----------------------------------------------------------------------------

    def _watch(self, now_ns: int) -> str:
        """Name the watchdog that forbids motion, or ""; forget what was heard if one does."""
        watchdog = self._condition(now_ns)
        if watchdog:
            self._pending.clear()
            self._in_effect = None
        if watchdog != self._watchdog:
            self._report.timeouts += watchdog == "silent"
            self._report.stale += watchdog == "stale"
            self._watchdog = watchdog
        return watchdog

    def _condition(self, now_ns: int) -> str:
        silent_ns = now_ns - self._last_advice_ns if self._last_advice_ns is not None else 0
        if silent_ns > FORGET_S * 1e9 and self._heard is not None:
            self._heard = None
            self._schema.reset()
            self._codec.reset()
        window_ns = int(self._settings.error_window_s * 1e9)
        while self._errors and self._errors[0] <= now_ns - window_ns:
            self._errors.popleft()
        if silent_ns > self._silence_ns:
            return "silent"
        if not self._schema.open:
            return "schema"
        if self._heard is None:
            return "starting"
        if len(self._errors) > self._settings.tolerated_errors:
            return "errors"
        if self._heard.level not in _MOVING_LEVELS:
            return ""  # a stop is a stop at any age
        if self._heard.age_bound_s is None:
            return "no age"
        age_s = self._heard.age_bound_s + (now_ns - self._heard.at_ns) * 1e-9
        return "stale" if age_s > self._settings.max_age_s else ""

    def _error_count(self) -> int:
        c = self._counters
        return c.crc_errors + c.counter_errors + c.malformed + c.incomplete
