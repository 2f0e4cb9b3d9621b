"""The fault table: each fault is injected alone while a person is near, and its effect is measured.

Faults of sources, links and the predictor run on the virtual clock; their results are exact and
repeatable. The node's death (``kill -9``) and a controller's restart run in real time in separate
processes: see ``node_death``. Node and controller share no clock, so a
step of either clock cannot disturb a link.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from importlib.util import find_spec
from math import inf
from typing import Any, Literal

import numpy as np

from hri_predict.contracts.predictor import Forecast
from hri_predict.node.listeners import Tick
from hri_predict.protocol.messages import Level, NodeState
from hri_predict.protocol.reasons import Reason
from hri_predict.run.config import Config
from hri_predict.run.session import Options, View, run
from hri_sim.baseline_demo import baseline_demo
from hri_sim.fault_table.incident import run_incident
from hri_sim.fault_table.incidents import INCIDENTS
from hri_sim.fault_table.link_cell import run_cases
from hri_sim.fault_table.live import run_live_faults
from hri_sim.fault_table.node_death import How, die, restart_controller
from hri_sim.fault_table.outcome import RECOVERY_S, Expected, FaultOutcome
from hri_sim.fault_table.polled_state import run_states
from hri_sim.fault_table.two_sensors import with_two_sensors

START_S, LENGTH_S, AFTER_S = 5.0, 2.0, 7.0


@dataclass(frozen=True)
class Case:
    """One fault and its expected effect.

    Attributes:
        name: name in the table.
        faults: faults as on the command line; ``{t}`` is replaced by the fault's time.
        expected: ``unknown`` (the node advises it), ``stop`` (the controller permits no motion),
            ``stays stopped`` (the same until the fault's end), ``may stop`` (the controller may
            stop, depending on the messages that the fault hits), ``not clear`` (the node does not
            advise *clear*), ``fault`` (the node advises it), ``degraded`` (the node reports it and
            continues with the physical limits), ``count only`` (only counters change).
        acts: the part that must act: node or controller.
        limit_ms: maximum time from the fault's start to the outcome.
        reasons: the node's advice must give one of them.
        people: number of people near.
        predictor: replaces the predictor's answer while the fault is active.
        length_s: duration of the fault.
        drain_s: time from the fault's end to the arrival of the last delayed message.
        sensor: which of two sensors has the faults; "": there is only one source.
    """

    name: str
    faults: tuple[str, ...]
    expected: Expected
    acts: Literal["node", "controller"]
    limit_ms: float | None
    reasons: tuple[Reason, ...] = ()
    people: int = 1
    predictor: Callable[[Forecast], Forecast] | None = None
    length_s: float = LENGTH_S
    drain_s: float = 0.0
    sensor: str = ""

    @property
    def end_s(self) -> float:
        """Time at which the fault is over and its delayed messages have arrived."""
        return START_S + self.length_s + self.drain_s


def _raises(_: Forecast) -> Forecast:
    raise RuntimeError("injected")


def _gives_nan(forecast: Forecast) -> Forecast:
    return Forecast(np.full_like(forecast.positions, np.nan), None)


# The source has 30 Hz: a period is 33 ms and input is stale at 2 x 33 + 10 = 77 ms. The node has
# 25 Hz: its advice on a scene follows one cycle (40 ms) later at most. The controller's silence
# time-out is 60 ms and its own cycle 8 ms; a message is due every 15 ms.
STALE = 77 + 40
SEEN = 34 + 40
# From the node's next tick: at most a cycle, the link's delay, the controller's reaction, and its
# own cycle.
TOLD = 40 + 5 + 20 + 8
NEXT = 15 + 8
"""Interval between two messages that the controller receives, plus its own cycle."""
SILENT = 60 + NEXT


def _both(fault: str) -> tuple[str, ...]:
    return f"drive:{fault}", f"monitor:{fault}"


CASES = (
    Case("source: scenes lost", ("drop@{t}",), "unknown", "node", STALE, (Reason.INPUT_STALE,)),
    Case("source: delayed 0.5 s", ("delay@{t}:delay_s=0.5",), "unknown", "node", STALE,
         (Reason.INPUT_STALE,)),
    Case("source: jitter up to 30 ms", ("jitter@{t}:max_s=0.03",), "count only", "node", None),
    Case("source: frozen, same scene", ("freeze@{t}",), "unknown", "node", STALE,
         (Reason.INPUT_FROZEN, Reason.INPUT_STALE)),
    Case("source: frozen, joints only", ("freeze@{t}:what=joints",), "unknown", "node", STALE,
         (Reason.INPUT_FROZEN, Reason.INPUT_STALE)),
    Case("source: every scene twice", ("duplicate@{t}",), "count only", "node", None),
    Case("source: scenes out of order", ("reorder@{t}",), "count only", "node", None),
    Case("source: all joints NaN", ("nan@{t}:fraction=1.0",), "unknown", "node", SEEN,
         (Reason.INPUT_IMPOSSIBLE,)),
    Case("source: a third of the joints NaN", ("nan@{t}",), "not clear", "node", SEEN),
    Case("source: person teleports 3 m", ("teleport@{t}:offset=[0,3,0]",), "unknown", "node", SEEN,
         (Reason.INPUT_IMPOSSIBLE,)),
    Case("source: two people swap ids", ("identity_swap@{t}",), "unknown", "node", SEEN,
         (Reason.INPUT_IMPOSSIBLE,), people=2),
    Case("source: person gets another id", ("identity_swap@{t}",), "not clear", "node", SEEN),
    Case("source: person vanishes", ("vanish@{t}",), "not clear", "node", STALE,
         (Reason.PERSON_LOST, Reason.PERSON_APPROACHING, Reason.PERSON_NEAR)),
    Case("source: does not see the room", ("blind@{t}",), "unknown", "node", SEEN,
         (Reason.SOURCE_BLIND,)),
    Case("source: clock jumps back 1 h", ("clock_jump@{t}:offset_s=-3600",), "unknown", "node",
         SEEN, (Reason.CLOCK_JUMP,)),
    Case("source: clock jumps on 1 h", ("clock_jump@{t}:offset_s=3600",), "unknown", "node", SEEN,
         (Reason.CLOCK_JUMP,)),
    Case("source: clock drifts 500 ppm", ("clock_drift@{t}:ppm=500",), "count only", "node", None),
    Case("predictor: fails", (), "degraded", "node", 40, predictor=_raises),
    Case("predictor: gives NaN", (), "degraded", "node", 40, predictor=_gives_nan),
    Case("both links: no RobotState",
         ("drive:freeze@{t}:direction=in", "monitor:freeze@{t}:direction=in"),
         "unknown", "node", 100 + 20 + 40, (Reason.ROBOT_STATE_STALE,)),
    *(
        Case(f"{link}: {what}", (f"{link}:{fault}",), "stop", "controller", limit)
        for link in ("drive", "monitor")
        for what, fault, limit in (
            ("silent", "freeze@{t}:direction=out", SILENT),
            ("unplugged", "unplug@{t}", SILENT),
            ("half of it lost", "drop@{t}:direction=out", SILENT),
            ("delayed 0.5 s", "delay@{t}:delay_s=0.5,direction=out", SILENT),
            ("1 bit in 1000 wrong", "bit_errors@{t}:direction=out", SILENT),
            ("half of it cut short", "truncate@{t}:direction=out", SILENT),
            ("everything twice", "duplicate@{t}:direction=out", NEXT),
            ("flooded, everything 10 times", "flood@{t}", NEXT),
        )
    ),
    # At 1 bit in 10000 a frame is damaged now and then. The controller tolerates no error, so it
    # stops at the first error in a message that it receives, at a random time. It believes no
    # damaged message.
    *(
        Case(f"{link}: 1 bit in 10000 wrong", (f"{link}:bit_errors@{{t}}:rate=0.0001",),
             "may stop", "controller", None, length_s=10.0)
        for link in ("drive", "monitor")
    ),
    # Repeats do not harm the node: the first message counts.
    Case("both links: RobotState 10 times", _both("flood@{t}:direction=in"), "count only", "node",
         None),
    # An 8-bit counter wraps after 5.12 s at 50 Hz: a message that is this late must not be taken
    # for a fresh one, nor one with any smaller delay while the delay grows.
    Case("both links: advice 5.2 s late", _both("delay@{t}:delay_s=5.2,direction=out"),
         "stays stopped", "controller", SILENT, length_s=8.0, drain_s=5.2),
    Case("both links: RobotState 5.2 s late", _both("delay@{t}:delay_s=5.2,direction=in"),
         "stays stopped", "controller", 100 + 20 + 40 + TOLD, length_s=8.0, drain_s=5.2),
    # A message sent at t arrives at 1.5 t. A message that arrives at 0.6 s was on the way for
    # 0.2 s, the controllers' max_age_s, whatever its age was before.
    Case("both links: advice ever later", _both("stretch@{t}:rate=0.5,direction=out"),
         "stays stopped", "controller", 600 + 8, length_s=12.0, drain_s=6.0),
    # A second node on the wire says clear: the controllers find its counters wrong in its first
    # cycle, whether or not the first node hears it; the first node stops them in its next.
    *(
        Case(f"{link}: second sender{what}", (f"{link}:second_sender@{{t}}{how}",), "stays stopped",
             "controller", 40 + 8)
        for link in ("drive", "monitor")
        for what, how in (("", ""), (", unheard by the node", ":direction=out"))
    ),
    *(
        Case(f"{link}: second sender, heard by the node alone",
             (f"{link}:second_sender@{{t}}:direction=in",), "fault", "node", SEEN,
             (Reason.SECOND_SENDER,))
        for link in ("drive", "monitor")
    ),
    Case("drive: out of order", ("drive:reorder@{t}:direction=out",), "stop", "controller",
         2 * 15 + 8),
    # Two adjacent CAN frames that change places belong to one message, whose parts may arrive in
    # any order, or to different messages: for the receiver nothing is out of order.
    Case("monitor: out of order", ("monitor:reorder@{t}:direction=out",), "count only",
         "controller", None),
)  # fmt: skip

# One of two sensors. The merge waits for it for as long as its input is not stale, and a scene of
# the other, which carries the doubt, comes within a period. A restart takes a second, and begins
# with lower numbers and stamps. A turn by 4 degrees puts the person 15 cm aside, and sensors
# disagree when they were apart in half of the last 10 s of common sight.
_SILENT = (Reason.SENSOR_SILENT,)
_OF_ONE: tuple[
    tuple[str, tuple[str, ...], Expected, float | None, tuple[Reason, ...], float], ...
] = (
    ("unplugged", ("drop@{t}",), "unknown", STALE + 34, _SILENT, LENGTH_S),
    ("delayed 0.5 s", ("delay@{t}:delay_s=0.5",), "unknown", STALE + 34, _SILENT, LENGTH_S),
    ("flooded, everything 8 times", 3 * ("duplicate@{t}",), "count only", None, (), LENGTH_S),
    ("restarted, its clock 1 h back",
     ("drop@{t}", f"clock_jump@{START_S}:offset_s=-3600,renumber=-100"),
     "unknown", STALE + 34, _SILENT, 1.0),
    ("clock jumps back 1 h", ("clock_jump@{t}:offset_s=-3600",), "unknown", SEEN + 34,
     (Reason.CLOCK_JUMP,), LENGTH_S),
    ("clock jumps on 1 h", ("clock_jump@{t}:offset_s=3600",), "unknown", SEEN + 34,
     (Reason.CLOCK_JUMP,), LENGTH_S),
    ("moved", ("rotate@{t}:quaternion_xyzw=[0,0,0.0349,0.9994]",), "unknown", 5_000 + SEEN,
     (Reason.SENSORS_DISAGREE,), 8.0),
    ("sees an empty room", ("vanish@{t}",), "not clear", SEEN, (), LENGTH_S),
)  # fmt: skip
SENSORS = tuple(
    Case(f"{sensor} of two sensors: {name}", faults, expected, "node", limit_ms, reasons,
         sensor=sensor, length_s=length_s)
    for sensor in ("back", "front")
    for name, faults, expected, limit_ms, reasons, length_s in _OF_ONE
)  # fmt: skip


DEATHS: tuple[tuple[str, How, float | None], ...] = (
    ("node: kill -9", "kill", None),  # the limit is the controllers' own
    ("node: SIGTERM", "terminate", TOLD),
)


RESTARTS = {f"{link}: controller restarted": link for link in ("drive", "monitor")}


def run_table(only: str | None = None) -> Iterator[FaultOutcome]:
    """Run every case whose name contains ``only``; yield each row as soon as it is done."""
    base = baseline_demo()
    for case in (*CASES, *SENSORS):
        if only is None or only in case.name:
            yield run_case(base, case)
    for incident in INCIDENTS:
        if only is None or only in incident.name:
            yield from run_incident(base, incident)
    for name, how, limit_ms in DEATHS:
        if only is None or only in name:
            yield die(name, how, _people(1), limit_ms)
    for name, link in RESTARTS.items():
        if only is None or only in name:
            yield restart_controller(name, link, _people(1))
    yield from run_live_faults(only)
    if find_spec("zenoh") is not None:
        from hri_sim.fault_table import zenoh_link

        yield from run_cases("zenoh", zenoh_link.ZenohCell, zenoh_link.CASES, only)
    yield from run_states(only)
    if find_spec("rclpy") is not None:
        from hri_sim.fault_table import ros2_link

        yield from run_cases("ros2", ros2_link.Ros2Cell, ros2_link.CASES, only)


def run_case(base: Config, case: Case) -> FaultOutcome:
    """Run one case on the virtual clock in the cell of ``base``."""
    watch = _Watch(case)
    time = f"{START_S}+{case.length_s}"
    config, faults = _scene(base, case.people), [f.replace("{t}", time) for f in case.faults]
    if case.sensor:
        config = with_two_sensors(config, case.sensor, faults)
    else:
        config = config.with_faults(faults)
    summary = run(config, Options(factor=None, duration_s=case.end_s + AFTER_S, view=watch))
    if case.acts == "controller":  # also of "count only": it must not stop
        measured, recovered, reason = _stop_of_all(case, summary.controllers)
    else:
        measured, recovered, reason = watch.reaction(case)
    acted = measured is not None
    fine = (
        watch.clear_while_near == 0
        and not summary.contacts
        and (case.expected == "may stop" or acted == (case.expected != "count only"))
        and (case.limit_ms is None or (measured is not None and measured <= case.limit_ms))
        and (recovered is not None) == acted
    )
    return FaultOutcome(
        fault=case.name,
        expected=case.expected,
        acts=case.acts,
        limit_ms=case.limit_ms,
        measured_ms=measured,
        reason=reason,
        clear_while_near=watch.clear_while_near,
        recovered_ms=recovered,
        fine=fine,
        counted=summary.counted,
    )


def _scene(base: Config, people: int) -> Config:
    """Return the demo's cell with people who stand near enough for the robot to slow down."""
    return base.with_source(base.source.model_dump() | {"people": _people(people)})


def _people(count: int) -> list[dict[str, Any]]:
    places = [[2.1, 0.2], [0.4, 2.0]][:count]
    return [{"start": place, "script": [{"do": "wait", "seconds": 60.0}]} for place in places]


def _stop_of_all(
    case: Case, controllers: Sequence[dict[str, Any]]
) -> tuple[float | None, float | None, str]:
    """Return ``_stop_of`` for the slowest controller whose link has the fault."""
    faulty = {fault.partition(":")[0] for fault in case.faults}
    stops = [_stop_of(case, c["events"]) for c in controllers if c["name"] in faulty]
    return max(stops, key=lambda stop: inf if stop[0] is None else stop[0])


def _stop_of(case: Case, events: list[Any]) -> tuple[float | None, float | None, str]:
    """Return the ms from the fault's start to a controller's stop, and from its end to motion.

    A controller that must stay stopped but moves before the fault's end does not count as stopped.
    """
    stop = next(((t, c) for t, c, v in events if t >= START_S - 1e-9 and v == 0.0), None)
    if stop is None:
        return None, None, ""
    moved = [t for t, _, v in events if v > 0.0 and t >= stop[0]]
    if case.expected == "stays stopped" and moved and moved[0] < case.end_s - 1e-9:
        return None, None, f"moved {moved[0] - START_S:.3f} s after the start"
    again = [t for t in moved if t >= case.end_s] or moved[-1:]
    recovered = max(again[0] - case.end_s, 0.0) * 1e3 if again else None
    return (stop[0] - START_S) * 1e3, recovered, stop[1]


class _Watch(View):
    """Records each tick's advice, and injects the predictor's fault."""

    def __init__(self, case: Case) -> None:
        self._case = case
        self._ticks: list[tuple[float, Level, Reason, NodeState]] = []
        self._start_ns: int | None = None
        self._now_s = 0.0

    def bind(self, assembly: Any) -> None:
        """Inject the case's fault into the predictor, if it has one."""
        self._start_ns = assembly.clock.now_ns()
        if self._case.predictor is None:
            return
        predictor, answer = assembly.prediction.predictor, self._case.predictor
        predict = predictor.predict

        def faulty(*arguments: Any) -> Forecast:
            forecast: Forecast = predict(*arguments)
            now_s = (assembly.clock.now_ns() - self._start_ns) * 1e-9
            return answer(forecast) if START_S <= now_s < self._case.end_s else forecast

        predictor.predict = faulty

    def on_tick(self, tick: Tick) -> None:
        """Record the advice for the first robot."""
        assert self._start_ns is not None
        advice = tick.advices[0]
        seconds = (tick.now_ns - self._start_ns) * 1e-9
        self._ticks.append((seconds, advice.level, advice.reason, tick.status.node_state))

    @property
    def clear_while_near(self) -> int:
        """Return the number of ticks since the fault's start with *clear* (a person is near)."""
        return sum(level is Level.CLEAR for t, level, *_ in self._ticks if t >= START_S)

    def reaction(self, case: Case) -> tuple[float | None, float | None, str]:
        """Return ms to the expected outcome, ms from the end to recovery, and the reason."""
        for t, level, reason, state in self._ticks:
            if t < START_S - 1e-9 or t > case.end_s + 1.0:
                continue
            if self._is_outcome(case, level, reason, state):
                return (t - START_S) * 1e3, self._recovery(case), reason.name
        return None, None, ""

    def _is_outcome(self, case: Case, level: Level, reason: Reason, state: NodeState) -> bool:
        if case.expected == "unknown":
            return level is Level.UNKNOWN and (not case.reasons or reason in case.reasons)
        if case.expected == "fault":
            return level is Level.FAULT and reason in case.reasons and state is NodeState.FAULT
        if case.expected == "degraded":
            return state is NodeState.DEGRADED and level is not Level.CLEAR
        if case.expected == "not clear":
            return level is not Level.CLEAR and (not case.reasons or reason in case.reasons)
        return not level.may_move or state is not NodeState.RUNNING  # of "count only": must not be

    def _recovery(self, case: Case) -> float | None:
        """Return the time after the fault's end at which the node runs and permits motion again."""
        end = case.end_s
        for t, level, _, state in self._ticks:
            if t >= end and level.may_move and state is NodeState.RUNNING:
                return (t - end) * 1e3 if t - end <= RECOVERY_S else None
        return None
