"""Runs an assembled node: in real time, or stepped on the virtual clock.

Both run the same ``Node`` with the same codecs, and ``Ticks`` determines when it ticks. In real
time late ticks are counted. On the virtual clock everything, including the mock controllers, runs
in one thread in a fixed order, so that two runs give the same bytes.
"""

import contextlib
import gc
import logging
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Protocol

from hri_predict.base.clock import VirtualClock
from hri_predict.base.errors import MachineError, failure
from hri_predict.base.machine.asleep import Asleep
from hri_predict.base.machine.realtime import settle, steady
from hri_predict.contracts import registry
from hri_predict.contracts.scene import Scene
from hri_predict.contracts.source import NOT_KNOWN_NS, live_part, wait_for
from hri_predict.node.repeats import NEVER_NS
from hri_predict.operation.monitoring.pace import Pace
from hri_predict.protocol.messages import NodeState
from hri_predict.protocol.reasons import Reason
from hri_predict.run.assemble import Assembly
from hri_predict.run.starting import Starting, ended_by_signals
from hri_predict.run.ticks import Ticks, ticks_of
from hri_predict.run.too_slow import TooSlow

log = logging.getLogger(__name__)

SOURCE_RETRY_NS = 100_000_000
SOURCE_IDLE_NS = 1_000_000  # pause before polling again a source that was due but had nothing
SOURCE_WAIT_NS = 100_000_000  # how long a stop may wait for a live source that receives nothing
REPEATS_END_S = 1.0  # posting does not block
SOURCE_END_S = 1.0  # poll must not block; if a source blocks nevertheless, its thread is abandoned
SWITCH_INTERVAL_S = 0.0005  # how long a busy Python thread may hold up the loop


class Stepped(Protocol):
    """A simulation stepped with the node on the virtual clock (the simulated cell)."""

    def next_ns(self) -> int | None:
        """Return the time of the next step."""

    def step(self, now_ns: int) -> None:
        """Perform all steps due at ``now_ns``."""


def run_real_time(
    *,
    assembly: Assembly,
    stop: threading.Event,
    duration_s: float | None = None,
    until_exhausted: bool = False,
    each_tick: Callable[[int], None] | None = None,
    pace: Pace | None = None,
) -> Pace:
    """Run until ``stop`` is set, ``duration_s`` has passed, or the source is exhausted.

    ``pace`` is updated and returned; pass one to read it during the run.

    Raises:
        LinkError: a link's device is absent at start.
        MachineError: the machine was suspended during the run; the controllers get *unknown*.
    """
    clock, node = assembly.clock, assembly.node
    pace = pace or Pace()
    starting = Starting(assembly.links)
    with ended_by_signals(stop):
        node.warm_up()  # before anybody hears of the node: it may take long
        starting.start()
    started = starting.started
    feeder: threading.Thread | None = None
    repeater: threading.Thread | None = None
    try:
        assembly.prediction.start()
        node.announce(clock.now_ns(), NodeState.STARTING, Reason.STARTING)
        # before the first deadline, because a collection takes long
        with _quiet_collector(), contextlib.ExitStack() as last:
            start_ns = clock.now_ns()
            with ended_by_signals(stop), _source_named(assembly):
                assembly.source.open(start_ns)
            slow = _too_slow(assembly, pace)
            run = _RealTime(assembly, pace, _ticks(assembly, start_ns), stop, slow)
            feeder = threading.Thread(target=run.feed, name="source", daemon=True)
            feeder.start()
            repeater = threading.Thread(target=run.repeat, name="repeats", daemon=True)
            repeater.start()
            last.enter_context(steady(assembly.config.node.realtime))  # no thread inherits it
            end_ns = None if duration_s is None else start_ns + round(duration_s * 1e9)
            run.loop(end_ns, until_exhausted, each_tick)
            pace.too_slow = run.slow.of_run()
    finally:
        stop.set()
        if repeater is not None:
            repeater.join(REPEATS_END_S)
        with contextlib.suppress(Exception):
            node.announce(clock.now_ns(), NodeState.STOPPING, Reason.STOPPING)
        pace.connected = {link.name: link.connected for link in started}
        for link in started:
            link.stop()
        assembly.prediction.stop()
        if feeder is not None:  # never close a source while its thread still polls it
            feeder.join(SOURCE_END_S)
        assembly.source.close()
    return pace


def _ticks(assembly: Assembly, start_ns: int) -> Ticks:
    return ticks_of(assembly.config.node, assembly.source.rate_hz, start_ns)


def _too_slow(assembly: Assembly, pace: Pace) -> TooSlow:
    config, source, prediction = assembly.config, assembly.source, assembly.prediction
    return TooSlow(config, source.rate_hz, pace, lambda: prediction.counters)


@dataclass(frozen=True, slots=True)
class _RealTime:
    """State shared by the threads of one run."""

    assembly: Assembly
    pace: Pace
    ticks: Ticks
    stop: threading.Event
    slow: TooSlow
    exhausted: threading.Event = field(default_factory=threading.Event)

    def loop(
        self, end_ns: int | None, until_exhausted: bool, each_tick: Callable[[int], None] | None
    ) -> None:
        """Tick until the end of the run."""
        ticks, stop, pace = self.ticks, self.stop, self.pace
        clock, node, asleep = self.assembly.clock, self.assembly.node, Asleep()
        phase = node.publish_phase
        while not stop.is_set():
            ticks.wait(clock, stop)
            if slept_s := asleep.since_last_s():  # a capture of before would pass for one of now
                raise MachineError(
                    f"the machine was suspended for {slept_s:.1f} s: the node's state is out of "
                    "date; restart it, and disable suspend (systemctl mask sleep.target)"
                )
            now_ns = clock.now_ns()
            if now_ns < ticks.due_ns:
                continue  # woken to stop, or by a capture that has to wait
            if end_ns is not None and now_ns >= end_ns:
                return
            if until_exhausted and self.exhausted.is_set():
                return
            if phase is not None:
                phase.begin(ticks.due_ns)
            ticks.begin(now_ns)
            began = time.perf_counter()
            node.tick(now_ns)
            node.repeats.posted(clock.now_ns())
            held_s, held_share = (0.0, 0.0) if phase is None else (phase.held_s, phase.held_share)
            pace.note(time.perf_counter() - began - held_s)  # waiting is not work
            if each_tick is not None:
                each_tick(now_ns)
            ended = ticks.end(clock.now_ns())
            pace.late_ticks += ended.is_late
            pace.missed_ticks += ended.missed
            node.shedding.note(ended.used - held_share, now_ns)
            self.slow.note(now_ns)

    def repeat(self) -> None:
        """Run the thread that repeats Status and Advice, independently of the loop.

        Repeats do not prove that the loop is alive: a tick's messages are repeated for at most 1.5
        cycles.
        """
        clock, repeats, asleep = self.assembly.clock, self.assembly.node.repeats, Asleep()
        stop = self.stop
        interval_ns = repeats.interval_ns
        while interval_ns != NEVER_NS and not stop.is_set():
            clock.wait_until(min(repeats.due_ns, clock.now_ns() + interval_ns), stop)
            if asleep.since_last_s():  # what was fresh is old, and its age does not say so
                return  # the loop ends, too
            repeats.repeat(clock.now_ns())

    def feed(self) -> None:
        """Run the source's thread: deliver scenes as they arrive, and keep polling a failing
        source.
        """
        source, clock, stop, pace = self.assembly.source, self.assembly.clock, self.stop, self.pace
        longest_ns = NOT_KNOWN_NS if live_part(source) is None else SOURCE_WAIT_NS
        while not stop.is_set():
            try:
                due_ns = source.next_ns()
                if due_ns is None:
                    self.exhausted.set()
                    return
                wait_for(source, min(due_ns, clock.now_ns() + longest_ns), clock, stop)
                delivered = False
                while not stop.is_set() and (scene := source.poll(clock.now_ns())) is not None:
                    self.assembly.node.receive(scene, clock.now_ns())
                    delivered = True
                if delivered:  # all that are in give one tick
                    self.ticks.captured()
                if not delivered and due_ns <= clock.now_ns():
                    clock.wait_until(clock.now_ns() + SOURCE_IDLE_NS, stop)
            except BaseException as error:
                failure(error)
                if pace.source_failures == 0:
                    log.exception("the source failed; polling it again")
                pace.source_failures += 1
                clock.wait_until(clock.now_ns() + SOURCE_RETRY_NS, stop)


def _source_named(assembly: Assembly) -> contextlib.AbstractContextManager[None]:
    """Report in one line that the source failed, and what it said."""
    kind = assembly.config.source.kind
    return registry.calling(f"source '{kind}' failed", "correct it, its settings or its input")


@dataclass(frozen=True, slots=True)
class _OneThread:
    """The source on the virtual clock. Its failure ends the run: unlike a live source, it would
    fail again in the same place.

    Raises:
        ConfigError: any method; names the source and what it said.
    """

    assembly: Assembly

    def open(self, start_ns: int) -> None:
        with _source_named(self.assembly):
            self.assembly.source.open(start_ns)

    def next_ns(self) -> int | None:
        with _source_named(self.assembly):
            return self.assembly.source.next_ns()

    def poll(self, now_ns: int) -> Scene | None:
        with _source_named(self.assembly):
            return self.assembly.source.poll(now_ns)


def run_virtual(
    assembly: Assembly,
    beside: Stepped | None = None,
    duration_s: float | None = None,
    each_tick: Callable[[int], None] | None = None,
) -> Pace:
    """Step everything on the virtual clock until the source is exhausted or ``duration_s`` has
    passed.

    Raises:
        ConfigError: the source failed; one line with what it said.
    """
    pace = Pace()
    with _quiet_collector(first=False):  # nothing is late on a virtual clock
        step_all(assembly, pace, beside, duration_s, each_tick=each_tick)
    return pace


def step_all(
    assembly: Assembly,
    pace: Pace,
    beside: Stepped | None = None,
    duration_s: float | None = None,
    *,
    each_tick: Callable[[int], None] | None = None,
) -> None:
    """Like ``run_virtual``, for callers that run many simulations and manage the garbage collector
    themselves.
    """
    clock, node = assembly.clock, assembly.node
    assert isinstance(clock, VirtualClock)
    start_ns = clock.now_ns()
    source = _OneThread(assembly)
    source.open(start_ns)
    end_ns = None if duration_s is None else start_ns + round(duration_s * 1e9)
    ticks = _ticks(assembly, start_ns)
    node.announce(start_ns, NodeState.STARTING, Reason.STARTING)
    while True:
        source_ns = source.next_ns()
        if source_ns is None and duration_s is None:
            break
        beside_ns = beside.next_ns() if beside is not None else None
        repeat_ns = node.repeats.due_ns
        times_ns = (source_ns, beside_ns, ticks.due_ns, repeat_ns)
        now_ns = min(t for t in times_ns if t is not None)
        now_ns = max(now_ns, clock.now_ns())
        if end_ns is not None and now_ns >= end_ns:
            break
        clock.advance_to(now_ns)
        if source_ns is not None and source_ns <= now_ns:
            while (scene := source.poll(now_ns)) is not None:
                node.receive(scene, now_ns)
                ticks.captured()
            if source.next_ns() == source_ns:  # no scene: poll again at the next tick
                due_ns = ticks.due_ns
                clock.advance_to(min(due_ns, repeat_ns, due_ns if beside_ns is None else beside_ns))
        if beside is not None and beside_ns is not None and beside_ns <= now_ns:
            beside.step(now_ns)
        if ticks.due_ns <= now_ns:
            ticks.begin(now_ns)
            for link in assembly.links:
                link.service(now_ns)
            began = time.perf_counter()
            node.tick(now_ns)
            node.repeats.posted(now_ns)
            pace.note(time.perf_counter() - began)
            for link in assembly.links:
                link.service(now_ns)
            if each_tick is not None:
                each_tick(now_ns)
        elif repeat_ns <= now_ns:
            node.repeats.repeat(now_ns)
            for link in assembly.links:
                link.service(now_ns)
    node.announce(clock.now_ns(), NodeState.STOPPING, Reason.STOPPING)
    pace.connected = {link.name: link.connected for link in assembly.links}
    for link in assembly.links:
        link.stop()
    assembly.source.close()


@contextlib.contextmanager
def _quiet_collector(first: bool = True) -> Iterator[None]:
    """Exclude objects built at start from garbage collection, and keep busy threads from delaying
    the loop.

    ``first`` collects existing garbage, which takes 0.1 s and would slow down many short runs.
    """
    interval = sys.getswitchinterval()
    sys.setswitchinterval(SWITCH_INTERVAL_S)
    if first:
        settle()
    else:
        gc.freeze()
    try:
        yield
    finally:
        gc.unfreeze()
        sys.setswitchinterval(interval)


@contextlib.contextmanager
def stop_on_signals(
    stop: threading.Event, hangup: Callable[[], None] | None = None
) -> Iterator[None]:
    """Let SIGINT, SIGTERM and SIGHUP set ``stop``: the node notifies the controllers and exits.

    A command that runs one node after another has a ``stop`` of its own around theirs, which is set
    too.
    With ``hangup``, SIGHUP calls that function instead: without a controlling terminal, the signal
    comes from a service manager. SIGHUP (the terminal was closed) remains ignored if it was ignored
    before, as under ``nohup``.
    """

    def handler(number: int, _frame: object) -> None:
        if number == signal.SIGHUP and hangup is not None:
            hangup()
        else:
            for each in _stops:
                each.set()

    numbers = [signal.SIGINT, signal.SIGTERM, signal.SIGHUP]
    if hangup is None and signal.getsignal(signal.SIGHUP) == signal.SIG_IGN:
        numbers.remove(signal.SIGHUP)
    _stops.append(stop)
    before = {s: signal.signal(s, handler) for s in numbers}
    try:
        yield
    finally:
        for number, old in before.items():
            signal.signal(number, old)
        _stops.remove(stop)


_stops: list[threading.Event] = []
"""The ``stop`` of each ``stop_on_signals`` that is active, the outermost first."""
