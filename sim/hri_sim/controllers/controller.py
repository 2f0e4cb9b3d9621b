"""The logic of a cautious robot controller that obeys the node's advice; no input or output.

The rule: the robot may not move if the link is silent or the advice is stale, corrupt, out of
order, of an unknown schema, or has any level other than *clear*, *warn* or *slow*. The controller
checks all input before use: counter and CRC of every message, the hash of the schema before it
accepts other messages, and the age of every advice.

The controller shares no clock with the node. An advice carries its age at encoding, and the
controller measures the time since receipt. The echo bounds the time on the link: an advice that
repeats the counter of one of our RobotStates was encoded after we sent that RobotState, so the
delay on the link is at most the time since then. The controller accepts an advice only if it sent
that RobotState within the last ``max_age_s`` plus the silence time-out. It does not store the times
of older ones, so the age of an advice that echoes one of them is unbounded, and such an advice
gives no permission. The counter's 65536 values last 22 min at 50 Hz (65 s at 1000 Hz); only an
advice that is delayed longer could be mistaken for a fresh one.
"""

import math
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Generic, Literal, TypeVar

import numpy as np
from pydantic import Field

from hri_drivers.links.codec import Codec
from hri_predict.base.arrays import Floats
from hri_predict.base.settings import Settings
from hri_predict.contracts.cell import ControllerReport
from hri_predict.contracts.link import LinkCounters, LinkSettings
from hri_predict.protocol.messages import (
    Advice,
    Level,
    Message,
    OperatingMode,
    RobotState,
    Schema,
)
from hri_predict.protocol.reception import FORGET_S, SchemaGate
from hri_predict.robots.mobile_base import COORDINATES
from hri_sim.controllers.arm import base_of
from hri_sim.controllers.button import Button
from hri_sim.controllers.lies import AUTOMATIC, LieSettings, RequestSettings, Said
from hri_sim.controllers.tools import NOTHING, Mounted, ToolChange

U = TypeVar("U")

Watchdog = Literal["", "silent", "schema", "starting", "errors", "no age", "stale"]
"""A watchdog that forbids motion; "": none."""
COUNTERS = 1 << 16  # values of RobotState's counter
_FULL_SPEED_TOLERANCE = 0.01  # m/s: rounding on the wire does not count as a slowdown
_MAX_EVENTS = 1000
_MAX_ROUND_TRIPS = 10_000


class ControllerSettings(Settings):
    """A link's ``simulate:`` block: the mock controller at its other end."""

    role: Literal["drive", "monitor"] = Field(
        "drive", description="drive moves the arm; monitor is an independent second channel"
    )
    robot: str | None = Field(None, description="default: the only robot of the configuration")
    trajectory: str | None = Field(
        None, description="shipped name or YAML file; default: that of the robot's motion"
    )
    reaction_s: float | None = Field(
        None,
        ge=0,
        le=2,
        description="time from receipt until an advice takes effect; default: the link's",
    )
    silence_timeout_s: float | None = Field(
        None, gt=0, le=2, description="silence after which it stops on its own; default: the link's"
    )
    deceleration: float | None = Field(
        None,
        gt=0,
        le=100,
        description="m/s^2 of the fastest point; default: from the stopping table",
    )
    acceleration: float = Field(1.0, gt=0, le=100, description="m/s^2 of the fastest point")
    max_age_s: float = Field(
        0.4,
        gt=0,
        le=5,
        description="maximum age of an advice that it obeys, including the link delay",
    )
    tolerated_errors: int = Field(
        0, ge=0, description="more bad or missing messages than this stop the robot"
    )
    error_window_s: float = Field(
        0.5,
        gt=0,
        le=10,
        description="after such errors it stays stopped until none occurs for this time",
    )
    state_rate_hz: float | None = Field(
        None,
        gt=0,
        le=1000,
        description="rate of RobotState; default: the link's robot_state_rate_hz",
    )
    period_s: float = Field(0.008, gt=0, le=0.1, description="time of its own cycle")
    start_s: float = Field(0.0, ge=0, description="time in its cycle at which the arm starts")
    faults: list[dict[str, Any]] = Field(
        [], description="faults at its end of the wire; direction out: from the controller"
    )
    fault_seed: int = Field(0, ge=0, description="random seed of these faults")
    lies: list[LieSettings] = Field(
        [], description="deliberate misbehaviour, to test whether the node detects it"
    )
    tools: list[ToolChange] = Field([], description="tools that it carries, and when")
    keep_round_trips: bool = Field(False, description="include each round trip in its report")
    requests: list[RequestSettings] = Field(
        [], description="operating modes that its operator requests, and when"
    )
    acknowledge_after_s: float | None = Field(
        None,
        gt=0,
        description="press the button this long after something can be acknowledged, but not in "
        "the node's first 13 s, when presses are ignored; repeat after 15 s; "
        "default: never",
    )

    def resolved(self, link: LinkSettings) -> "ControllerSettings":
        """Fill missing settings from the link's settings."""
        values = {
            "reaction_s": link.reaction_s,
            "silence_timeout_s": link.silence_timeout_s,
            "state_rate_hz": getattr(link, "robot_state_rate_hz", None) or 50.0,
        }
        missing = {k: v for k, v in values.items() if getattr(self, k) is None}
        return self.model_copy(update=missing)


@dataclass(frozen=True, slots=True)
class Permit:
    """A controller's permission: a speed in m/s, its cause, and the operating mode in force."""

    speed_m_s: float
    cause: str
    mode: OperatingMode = OperatingMode.AUTOMATIC


@dataclass(frozen=True, slots=True)
class _Heard:
    """The newest advice, its time of receipt and its maximum age then (``None``: unbounded)."""

    at_ns: int
    age_bound_s: float | None
    limit_m_s: float
    level: Level


class ControllerCore(Generic[U]):
    """Receives, checks, decides and answers; its owner passes in received units and the time.

    An advice takes effect ``reaction_s`` after its receipt. The watchdogs (silence, age, errors,
    schema) act immediately: their limits include the time until braking starts. After a watchdog
    has acted, all earlier advice is void.
    """

    def __init__(
        self,
        *,
        name: str,
        settings: ControllerSettings,
        robot: int,
        codec: Codec[U],
        full_speed_m_s: float,
        base_moves: bool = False,
    ) -> None:
        """``settings`` must be ``resolved``; ``robot`` is the robot's index in an Advice."""
        if None in (settings.reaction_s, settings.silence_timeout_s, settings.state_rate_hz):
            raise ValueError("the settings must be resolved first")
        self._settings = settings
        self._reaction_ns = int((settings.reaction_s or 0.0) * 1e9)
        # the watchdogs run once per cycle, and the robot must brake before the time is up
        silence_s = (settings.silence_timeout_s or 0.0) - settings.period_s
        self._silence_ns = int(max(silence_s, 0.0) * 1e9)
        self._state_ns = int(1e9 / (settings.state_rate_hz or 50.0))
        self._robot = robot
        self._codec = codec
        self._full_speed = full_speed_m_s
        self._lead = len(COORDINATES) if base_moves else 0
        self._counters = LinkCounters()
        self._errors = 0  # since the last window without any
        self._error_ns = 0  # time of the last
        self._schema = SchemaGate()
        self._heard: _Heard | None = None
        self._last_advice_ns: int | None = None
        self._node_ns = 0  # time of the newest schema or advice, also of an unknown schema
        self._pending: deque[tuple[int, Permit]] = deque()  # time of effect, permit
        self._in_effect: Permit | None = None
        self._watchdog: Watchdog = ""
        self._counter = 0  # of the newest RobotState
        kept_s = settings.max_age_s + (settings.silence_timeout_s or 0.0)
        # times of sending the newest RobotStates, the newest last
        self._sent_ns: deque[int] = deque(maxlen=math.ceil(kept_s * 1e9 / self._state_ns) + 1)
        self._next_state_ns: int | None = None
        # of the newest echoes: the counter, and nanoseconds since that state was sent
        self._round_trips: deque[tuple[int, int]] = deque(maxlen=_MAX_ROUND_TRIPS)
        self._button = Button(settings.acknowledge_after_s, settings.lies)
        self._obeyed = "stop"
        self._start_ns: int | None = None
        self._report = ControllerReport(name=name, role=settings.role, robot=settings.robot or "")

    def receive(self, units: Sequence[U], now_ns: int) -> None:
        """Process the units that the link has delivered by ``now_ns``."""
        self._watch(now_ns)
        before = self._error_count()
        for unit in units:
            self._report.bytes += self._codec.size(unit)
            for message in self._codec.decode(unit):
                self._report.messages += 1
                self._take(message, now_ns)
        self._codec.count(self._counters)
        if (new := self._error_count() - before) > 0:
            self._errors += new
            self._error_ns = now_ns

    def permit(self, now_ns: int) -> Permit:
        """Return what this controller allows now."""
        if watchdog := self._watch(now_ns):
            return Permit(0.0, watchdog)
        while self._pending and self._pending[0][0] <= now_ns:
            self._in_effect = self._pending.popleft()[1]
        return self._in_effect or Permit(0.0, "starting")

    def obey(self, permit: Permit, now_ns: int) -> None:
        """Record the permit that the robot obeys: this controller's, or a lower one."""
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
        self,
        now_ns: int,
        q: Floats | None,
        qd: Floats | None,
        said: Said = AUTOMATIC,
        *,
        mounted: Mounted = NOTHING,
    ) -> list[U]:
        """Return what to send now: RobotState when due, Acknowledge if the button is pressed.

        Args:
            now_ns: controller's clock.
            q, qd: (N,) rad and rad/s, m and m/s, the coordinates of a moving base first; ``None``
                while unknown: then nothing is sent.
            said: further content of RobotState.
            mounted: the tool.
        """
        units: list[U] = []
        if self._next_state_ns is None:
            self._next_state_ns = now_ns
            # counted by the clock: an echo of a state from before a restart has its true age
            self._counter = now_ns // self._state_ns % COUNTERS
        if now_ns >= self._next_state_ns and q is not None and qd is not None:
            behind = (now_ns - self._next_state_ns) // self._state_ns
            self._next_state_ns += (1 + behind) * self._state_ns
            self._counter = (self._counter + 1) % COUNTERS
            self._sent_ns.append(now_ns)
            state = RobotState(
                robot=self._robot,
                mode=said.mode,
                counter=self._counter,
                positions=tuple(q[self._lead :].tolist()),
                velocities=tuple(qd[self._lead :].tolist()),
                tool=mounted.number,
                tool_confirmed=mounted.confirmed,
                base=base_of(q, qd) if self._lead else None,
                request=said.request,
                enabling=said.enabling,
            )
            units += self._codec.encode(state)
            self._report.states_sent += 1
        for press in self._button.press(now_ns):
            units += self._codec.encode(press)
        return units

    def write_failed(self) -> None:
        """Count a unit that the link failed to send."""
        self._report.write_errors += 1

    def report(self) -> ControllerReport:
        """Return this controller's report up to now."""
        report, counters = self._report, self._counters
        report.crc_errors = counters.crc_errors
        report.counter_errors = counters.counter_errors
        report.malformed = counters.malformed
        report.incomplete = counters.incomplete
        report.acknowledges_sent = self._button.presses
        if self._round_trips:
            times_ns = [time_ns for _, time_ns in self._round_trips]
            report.round_trip_p50_s = float(np.median(times_ns)) * 1e-9
            report.round_trip_max_s = max(times_ns) * 1e-9
        if self._settings.keep_round_trips:
            report.round_trips = [(n, round(t * 1e-9, 6)) for n, t in self._round_trips]
        return report

    # -- received messages ------------------------------------------------------------------------

    def _take(self, message: Message, now_ns: int) -> None:
        if isinstance(message, Schema):
            self._node_ns = now_ns
            self._schema.take(message)
            if not self._schema.open:
                self._report.schema_mismatches += 1
                self._report.schema_trouble = self._schema.why
        elif isinstance(message, Advice) and message.robot == self._robot:
            self._node_ns = now_ns
            self._take_advice(message, now_ns)

    def _take_advice(self, advice: Advice, now_ns: int) -> None:
        if not self._schema.open:
            return
        if self._last_advice_ns is not None:
            gap_s = (now_ns - self._last_advice_ns) * 1e-9
            self._report.max_gap_s = max(self._report.max_gap_s, gap_s)
        self._last_advice_ns = now_ns
        limit = 0.0
        if advice.level.may_move and advice.speed_limit_m_s is not None:
            limit = max(0.0, advice.speed_limit_m_s)
        self._heard = _Heard(now_ns, self._age_bound(advice, now_ns), limit, advice.level)
        permit = Permit(limit, advice.level.name.lower(), advice.mode)
        self._pending.append((now_ns + self._reaction_ns, permit))
        self._button.show(advice.latch_id, now_ns)

    def _age_bound(self, advice: Advice, now_ns: int) -> float | None:
        """Return the maximum age of the advice's input at receipt; ``None`` if unbounded."""
        if advice.age_s is not None:
            self._report.max_age_s = max(self._report.max_age_s, advice.age_s)
        if advice.echo is None:
            return None
        behind = (self._counter - advice.echo) % COUNTERS
        if behind >= len(self._sent_ns):
            return None
        link_ns = now_ns - self._sent_ns[-1 - behind]
        self._round_trips.append((advice.echo, link_ns))
        return None if advice.age_s is None else advice.age_s + link_ns * 1e-9

    # -- the watchdogs ----------------------------------------------------------------------------

    def _watch(self, now_ns: int) -> Watchdog:
        """Return the watchdog that forbids motion, or ""; if one does, forget earlier advice."""
        watchdog = self._condition(now_ns)
        if watchdog:
            self._pending.clear()
            self._in_effect = None
        if watchdog != self._watchdog:
            self._report.timeouts += watchdog == "silent"
            self._report.stale += watchdog == "stale"
            self._watchdog = watchdog
        return watchdog

    def _condition(self, now_ns: int) -> Watchdog:
        silent_ns = now_ns - self._last_advice_ns if self._last_advice_ns is not None else 0
        if self._schema.heard is not None and now_ns - self._node_ns > FORGET_S * 1e9:
            self._heard = None
            self._schema.reset()
            self._codec.reset()
        if now_ns - self._error_ns >= self._settings.error_window_s * 1e9:
            self._errors = 0
        if silent_ns > self._silence_ns:
            return "silent"
        if not self._schema.open:
            return "schema"
        if self._heard is None:
            return "starting"
        if self._errors > self._settings.tolerated_errors:
            return "errors"
        if not self._heard.level.may_move:
            return ""  # a stop is a stop at any age
        if self._heard.age_bound_s is None:
            return "no age"
        age_s = self._heard.age_bound_s + (now_ns - self._heard.at_ns) * 1e-9
        return "stale" if age_s > self._settings.max_age_s else ""

    def _error_count(self) -> int:
        c = self._counters
        return c.crc_errors + c.counter_errors + c.malformed + c.incomplete
