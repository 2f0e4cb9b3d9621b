"""Faults of live senders, in real time, over the real sockets of every kind of live source.

A node runs with the source under test and a robot at rest; a person stands near it. When the node
has run for a second, the fault starts, at the sender or on the wire.
"""

import tempfile
import threading
import time
from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np

from hri_predict.base.skeleton import JOINTS
from hri_predict.contracts.scene import Person, Scene
from hri_predict.node.listeners import Tick
from hri_predict.protocol.messages import Level, NodeState
from hri_predict.protocol.reasons import Reason
from hri_predict.run import config as configuration
from hri_predict.run.config import Config
from hri_predict.run.session import Options, View, run
from hri_sim.fault_table.outcome import RECOVERY_S, Expected, FaultOutcome
from hri_sim.people.body import Body
from hri_sim.senders.live_ends import LIVE_ENDS
from hri_sim.senders.stream_ends import LiveEnd

RATE_HZ = 30.0
SETTLED_S = 1.0  # the node permits motion for this long before the fault begins
PATIENCE_S = 60.0  # time limit for that, including the node's start
PLACE, NOISE_M = (1.4, 0.2), 0.004  # near enough that CLEAR would be wrong at any level of noise
_PREDICTOR = "constant_velocity"  # never late: the outcome of a fault is that of the input alone
FALSE_M = 0.1  # a joint further than this from its true place is false

Kind = Literal["unplugged", "restarted", "delayed", "flooded", "corrupted", "clock"]


@dataclass(frozen=True)
class LiveCase:
    """One fault of a sender; see ``fault_table.Case``.

    Attributes:
        kind: ``unplugged`` (the sender continues, nothing arrives), ``restarted`` (its program
            exits and starts again after the fault), ``delayed``, ``flooded`` (more scenes per
            second), ``corrupted`` (wrong bits), ``clock`` (wrong stamps).
        amount: seconds of delay, factor of the rate, error probability of a bit, or seconds of the
            clock's step.
    """

    name: str
    kind: Kind
    amount: float
    expected: Expected
    limit_ms: float | None
    reasons: tuple[Reason, ...] = ()
    length_s: float = 2.0

    @property
    def drain_s(self) -> float:
        """Return the seconds from the fault's end until the last delayed unit arrives."""
        return self.amount if self.kind == "delayed" else 0.0


# The source has 30 Hz, so input is stale at 3 x 33 + 20 = 120 ms. The node has 25 Hz, so its advice
# follows 40 ms later at most. In real time a tick may be late, by one more cycle at most.
STALE = 120 + 40 + 40
SEEN = 34 + 40 + 40
SILENT = (Reason.INPUT_STALE,)

CASES = (
    LiveCase("unplugged", "unplugged", 0, "unknown", STALE, SILENT),
    LiveCase("delayed 0.5 s", "delayed", 0.5, "unknown", STALE, SILENT),
    LiveCase("flooded, 10 times the rate", "flooded", 10, "count only", None),
    LiveCase("1 bit in 10000 wrong", "corrupted", 1e-4, "not clear", None),
    LiveCase("restarted", "restarted", 0, "unknown", STALE, SILENT, length_s=1.0),
    LiveCase("clock steps back 1 h", "clock", -3600, "unknown", SEEN, (Reason.CLOCK_JUMP,)),
    LiveCase("clock steps on 1 h", "clock", 3600, "unknown", SEEN, (Reason.CLOCK_JUMP,)),
)


def run_live_faults(only: str | None = None) -> Iterator[FaultOutcome]:
    """Run every case of every kind of source whose name contains ``only``."""
    for kind in LIVE_ENDS:
        for case in CASES:
            if only is None or only in f"{kind}: {case.name}":
                yield run_live_case(kind, case)


def run_live_case(kind: str, case: LiveCase) -> FaultOutcome:
    """Run one case."""
    with tempfile.TemporaryDirectory(prefix="hri-live-") as folder:
        end = LIVE_ENDS[kind](Path(folder))
        stop = threading.Event()
        watch = _Watch()
        sending = _Sending(end, case, watch, stop)
        sending.start()
        try:
            summary = run(_config(end), Options(view=watch), stop)
        finally:
            stop.set()
            sending.join()
    live = {k: v for k, v in summary.source["live"].items() if isinstance(v, int) and v}
    measured, reason, recovered, clear = watch.reaction(case, sending.fault_ns, sending.end_ns)
    in_time = case.limit_ms is None or (measured is not None and measured <= case.limit_ms)
    acted = (measured is None) if case.expected == "count only" else (measured is not None)
    if case.expected == "not clear":
        acted = True  # chance decides if the loss is noticed; never advising clear is required
    return FaultOutcome(
        fault=f"{kind}: {case.name}",
        expected=case.expected,
        acts="node",
        limit_ms=case.limit_ms,
        measured_ms=measured,
        reason=reason,
        clear_while_near=clear,
        recovered_ms=None if case.expected == "count only" else recovered,
        fine=acted
        and in_time
        and clear == 0
        and recovered is not None
        and not (end.checked and watch.false_scenes),
        counted=live | ({"false_scenes": watch.false_scenes} if watch.false_scenes else {}),
    )


def _config(end: LiveEnd) -> Config:
    pose = {"xyz": [0, 0, 0], "quaternion_xyzw": [0, 0, 0, 1]}
    base = configuration.load(configuration.shipped("live_udp.yaml")).quiet()
    base = base.with_predictor(_PREDICTOR)
    return base.with_source({"room_from_source": pose, "rate_hz": RATE_HZ} | end.source)


class _Watch(View):
    """Records each tick's advice, and compares each scene with the one sent."""

    def __init__(self) -> None:
        self.false_scenes = 0
        self.well_since_ns: int | None = None
        self._ticks: list[tuple[int, Level, Reason, NodeState]] = []
        self._joint_map: Any = None

    def bind(self, assembly: Any) -> None:
        """Read the source's joint map."""
        self._joint_map = assembly.source.joint_map

    def on_scene(self, scene: Scene, _receipt_ns: int) -> None:
        """Count scenes that differ from the person who was sent."""
        mapped = [self._joint_map.map(p.positions, p.observed) for p in scene.people]
        right = len(mapped) == 1 and all(
            np.all(np.abs(joints - _STANDING)[observed] < FALSE_M) for joints, observed in mapped
        )
        self.false_scenes += not right

    def on_tick(self, tick: Tick) -> None:
        """Record the advice for the robot."""
        advice, state = tick.advices[0], tick.status.node_state
        if state is NodeState.STOPPING:  # the node's last message
            return
        if tick.status.reason is Reason.LOAD_SHED:  # the machine's load, not the fault's outcome
            state = NodeState.RUNNING
        self._ticks.append((tick.now_ns, advice.level, advice.reason, state))
        if not _well(advice.level, state):
            self.well_since_ns = None
        elif self.well_since_ns is None:
            self.well_since_ns = tick.now_ns

    def reaction(
        self, case: LiveCase, start_ns: int | None, end_ns: int | None
    ) -> tuple[float | None, str, float | None, int]:
        """Return ms to the outcome, its reason, ms to recovery, and the ticks of *clear*."""
        if start_ns is None or end_ns is None:
            return None, "the node never settled before the fault", None, 0
        ticks = [tick for tick in self._ticks if tick[0] >= start_ns]
        clear = sum(level is Level.CLEAR for _, level, *_ in ticks)
        outcome = next((t for t in ticks if _is_outcome(case, *t[1:])), None)
        back_ns = self.well_since_ns
        recovered = None if back_ns is None else max(0.0, (back_ns - end_ns) * 1e-6)
        if outcome is None:
            return None, "", recovered, clear
        return (outcome[0] - start_ns) * 1e-6, outcome[2].name, recovered, clear


def _well(level: Level, state: NodeState) -> bool:
    return level.may_move and state is NodeState.RUNNING


def _is_outcome(case: LiveCase, level: Level, reason: Reason, state: NodeState) -> bool:
    if case.expected == "unknown":
        return level is Level.UNKNOWN and (not case.reasons or reason in case.reasons)
    return not _well(level, state)


class _Sending(threading.Thread):
    """The sender: a standing person, captured at a steady rate, and the fault.

    Attributes:
        fault_ns: start of the fault; ``None`` before.
        end_ns: end of the fault and its delayed units; ``None`` before.
    """

    def __init__(self, end: LiveEnd, case: LiveCase, watch: _Watch, stop: threading.Event) -> None:
        super().__init__(name="sender", daemon=True)
        self.fault_ns: int | None = None
        self.end_ns: int | None = None
        self._end, self._case, self._watch, self._stopping = end, case, watch, stop
        self._rng = np.random.default_rng(0)
        self._sequence = 0
        self._sends = False
        self._utc_ns = time.time_ns() - time.monotonic_ns()
        self._line: deque[tuple[int, bytes]] = deque()  # units on the way, with their arrival times

    def run(self) -> None:
        """Send until the node has recovered or the time is up."""
        began_ns = due_ns = time.monotonic_ns()
        try:
            while not self._stopping.is_set():
                now_ns = time.monotonic_ns()
                fault = self._fault(now_ns, began_ns)
                self._capture(fault, due_ns, now_ns)
                self._deliver(now_ns)
                due_ns += round(1e9 / RATE_HZ / (self._case.amount if fault == "flooded" else 1))
                due_ns = max(due_ns, now_ns - 100_000_000)  # after starvation, skip missed captures
                self._stopping.wait(max(0.0, (due_ns - time.monotonic_ns()) * 1e-9))
        finally:
            self._stopping.set()
            self._end.stop()

    def _fault(self, now_ns: int, began_ns: int) -> Kind | None:
        """Return the fault while it is active; start it and end the run when due."""
        well_ns = self._watch.well_since_ns
        if self.fault_ns is None:
            if well_ns is not None and now_ns - well_ns > SETTLED_S * 1e9:
                self.fault_ns = now_ns
            elif now_ns - began_ns > PATIENCE_S * 1e9:
                self._stopping.set()
            return None
        since_s = (now_ns - self.fault_ns) * 1e-9
        if since_s < self._case.length_s:
            return self._case.kind
        self.end_ns = self.fault_ns + round((self._case.length_s + self._case.drain_s) * 1e9)
        after_s = (now_ns - self.end_ns) * 1e-9
        if after_s > RECOVERY_S or (after_s > SETTLED_S and well_ns is not None):
            self._stopping.set()
        return None

    def _capture(self, fault: Kind | None, due_ns: int, now_ns: int) -> None:
        """Send the capture of ``due_ns``; if the sender runs late, its stamps stay correct."""
        if fault == "restarted":
            self._end.stop()
            self._sends = False
            return
        if not self._sends:
            self._end.start()
            self._sends, self._sequence = True, 0
        units = self._end.encode(self._scene(fault, due_ns + self._utc_ns))
        self._sequence += 1
        if fault == "unplugged":
            return
        delay_ns = round(self._case.amount * 1e9) if fault == "delayed" else 0
        last_ns = self._line[-1][0] if self._line else 0
        for unit in units:
            damaged = self._damaged(unit) if fault == "corrupted" else unit
            self._line.append((max(now_ns + delay_ns, last_ns), damaged))

    def _scene(self, fault: Kind | None, stamp_ns: int) -> Scene:
        if fault == "clock":
            stamp_ns += round(self._case.amount * 1e9)
        noise = self._rng.normal(0.0, NOISE_M, _STANDING.shape)
        person = Person(1, _STANDING + noise, np.ones(len(JOINTS), np.bool_))
        return Scene(stamp_ns, self._sequence, True, (person,))

    def _damaged(self, unit: bytes) -> bytes:
        wrong = np.packbits(self._rng.random(8 * len(unit)) < self._case.amount)
        return (np.frombuffer(unit, np.uint8) ^ wrong).tobytes()

    def _deliver(self, now_ns: int) -> None:
        while self._line and self._line[0][0] <= now_ns:
            self._end.write(self._line.popleft()[1])


def _standing() -> Any:
    body = Body(1.75)
    return body.joints(body.standing(np.array(PLACE), np.pi))


_STANDING = _standing()
