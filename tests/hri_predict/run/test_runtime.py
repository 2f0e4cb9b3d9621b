"""The loop that calls the node: absolute deadlines, sources that fail, clean ends.

Nothing here asserts that anything is fast: slow ticks are made, and what must follow is counted.
"""

import itertools
import sys
import threading
import time
from asyncio import CancelledError
from types import SimpleNamespace

import pytest

from hri_predict.base.errors import LinkError, LinkErrors, MachineError
from hri_predict.base.machine import asleep
from hri_predict.contracts.source import NOT_KNOWN_NS
from hri_predict.node.publish_phase import PublishPhase
from hri_predict.protocol.messages import NodeState
from hri_predict.run import starting
from hri_predict.run.runtime import run_real_time, run_virtual
from tests.hri_predict.run.fakes import MS, Source, make


class Link:
    def __init__(self, name, absent=False):
        self.name, self.absent, self.log = name, absent, []
        self.connected = not absent

    def start(self):
        if self.absent:
            raise LinkError(f"{self.name}: not there")
        self.log.append("start")

    def service(self, now_ns):
        self.log.append("service")

    def stop(self):
        self.log.append("stop")


# -- real time


@pytest.fixture(autouse=True)
def garbage_stays(monkeypatch):
    """The loop collects garbage at its start, which takes long among all the tests' own objects."""
    monkeypatch.setattr("hri_predict.run.runtime.gc.collect", lambda: 0)


def paced(tick_ms, duration_s=0.24, phase_s=0.0, after_ms=0):
    """The real-time loop at 50 Hz on a clock of the test's; tick k takes ``tick_ms[k]``."""
    assembly = make(source=Source(count=0), virtual=True)
    clock, node = assembly.clock, assembly.node
    node.publish_phase = PublishPhase(clock, phase_s, 0.01, 50.0)

    def tick(now_ns):
        took = tick_ms.get(len(node.ticks), 1)
        node.ticks.append((now_ns - 1_000 * MS) // MS)
        clock.advance_to(clock.now_ns() + took * MS)
        node.publish_phase.hold(learn=True, urgent=False)
        clock.advance_to(clock.now_ns() + after_ms * MS)

    node.tick = tick
    pace = run_real_time(assembly=assembly, stop=threading.Event(), duration_s=duration_s)
    return node.ticks, pace, node.shedding


def test_deadlines_are_absolute():
    ticks, pace, _ = paced({k: k % 20 for k in range(12)})  # work that varies moves no deadline
    assert ticks == list(range(0, 240, 20))
    assert (pace.ticks, pace.late_ticks, pace.missed_ticks) == (12, 0, 0)
    assert len(pace.tick_ms) == 12


def test_messages_held_until_the_phase_are_no_work():
    held = paced(dict.fromkeys(range(99), 15), phase_s=0.018)
    assert held[2].sheds == 0  # a tick of 18 of 20 ms would shed load
    assert held[:1] == paced(dict.fromkeys(range(99), 15))[:1]


def test_a_tick_that_is_late_because_its_messages_waited_is_late():
    _, pace, _ = paced(dict.fromkeys(range(99), 2), phase_s=0.018, after_ms=5)
    assert pace.late_ticks == pace.ticks > 0


def test_a_late_tick_is_counted_and_pushes_nothing_back():
    ticks, pace, _ = paced({2: 25})
    assert ticks == [0, 20, 40, 65, 80, 100, 120, 140, 160, 180, 200, 220]
    assert (pace.late_ticks, pace.missed_ticks) == (1, 0)


def test_late_ticks_do_not_accumulate():
    ticks, pace, _ = paced({2: 110})  # until 150: the deadlines 60, 80, 100, 120 have passed by
    assert ticks == [0, 20, 40, 150, 160, 180, 200, 220]
    assert (pace.ticks, pace.late_ticks, pace.missed_ticks) == (8, 1, 4)


def test_a_loop_that_is_always_too_slow_is_late_each_time_and_keeps_its_phase():
    ticks, pace, _ = paced(dict.fromkeys(range(99), 30))
    assert pace.late_ticks == pace.ticks
    assert all(b - a == 30 for a, b in itertools.pairwise(ticks))
    assert pace.missed_ticks == pytest.approx(240 / 20 - pace.ticks, abs=1)


def test_ticks_that_take_nearly_their_whole_period_shed_load():
    _, pace, shedding = paced(dict.fromkeys(range(99), 18))
    assert (pace.late_ticks, shedding.sheds) == (0, 2)


def test_ticks_with_room_shed_nothing():
    _, _, shedding = paced(dict.fromkeys(range(99), 15))
    assert shedding.sheds == 0


def test_a_really_slow_tick_is_counted():
    assembly = make(rate_hz=50.0)
    assembly.node.slow = {3: 0.11}
    pace = run_real_time(assembly=assembly, stop=threading.Event(), duration_s=0.5)
    start, period = assembly.source.start_ns, 20 * MS
    assert pace.late_ticks >= 1
    assert pace.missed_ticks >= 4
    assert pace.ticks + pace.missed_ticks <= 25  # nothing was done twice: 0.5 s hold 25 periods
    assert all(t >= start + k * period for k, t in enumerate(assembly.node.ticks))
    assert max(pace.tick_ms) >= 110


def test_no_tick_follows_the_sleep_of_the_machine(monkeypatch):
    """The node's clock stood still meanwhile: a capture of an hour ago would be of now."""
    ahead_ns = 0
    monkeypatch.setattr(asleep, "_clocks", lambda: (1, 1 + ahead_ns, 1))
    assembly = make(links=[Link("plc")])

    def sleep(_now_ns):
        nonlocal ahead_ns
        if len(assembly.node.ticks) == 3:
            ahead_ns = 3600 * 1000 * MS

    with pytest.raises(MachineError, match=r"was suspended for 3600\.0 s: .*restart it"):
        run_real_time(assembly=assembly, stop=threading.Event(), duration_s=5.0, each_tick=sleep)
    assert len(assembly.node.ticks) == 3
    assert assembly.node.said[-1] is NodeState.STOPPING
    assert assembly.links[0].log == ["start", "stop"]


def test_a_source_that_raises_is_asked_again_and_counted(caplog):
    source = Source()
    source.fails = [OSError("cable"), CancelledError()]
    assembly = make(source=source)
    pace = run_real_time(assembly=assembly, stop=threading.Event(), duration_s=0.5)
    assert pace.source_failures == 2
    assert assembly.node.scenes[0][0] == 1  # and nothing of it was lost
    assert len(assembly.node.scenes) > 3
    assert pace.ticks > 5  # the loop never waited for it
    assert caplog.text.count("Traceback") == 1


def test_a_source_that_has_nothing_yet_does_not_keep_a_core_busy():
    """``next_ns`` says when it is *worth asking*: a live sender may well have nothing by then."""
    source = Source(period_ns=0)
    source.poll = count_polls(source)  # type: ignore[method-assign]
    run_real_time(assembly=make(source=source), stop=threading.Event(), duration_s=0.3)
    assert 1 < source.polls < 1000


class LiveSource(Source):
    """Has a scene when the test says so, and then says so itself."""

    def __init__(self):
        super().__init__(count=10**6)
        self.live = SimpleNamespace(arrived=threading.Event())
        self.waiting = 0

    def next_ns(self):
        return 0 if self.waiting else NOT_KNOWN_NS

    def poll(self, now_ns):
        self.polls += 1
        if not self.waiting:
            return None
        self.waiting -= 1
        self.k += 1
        return self.k

    def give(self, count):
        self.waiting = count
        self.live.arrived.set()


def test_a_live_source_wakes_the_node_and_is_hardly_asked_otherwise():
    source = LiveSource()
    assembly = make(source=source)
    stop = threading.Event()
    loop = threading.Thread(target=run_real_time, kwargs={"assembly": assembly, "stop": stop})
    loop.start()
    time.sleep(0.5)
    silent = source.polls
    assert silent < 50  # a poll each 0.1 s; one each millisecond would be 500
    for seen in (3, 5):
        source.give(seen - len(assembly.node.scenes))
        deadline = time.monotonic() + 20
        while len(assembly.node.scenes) < seen:
            assert time.monotonic() < deadline
            time.sleep(0.001)
    stop.set()
    loop.join()
    assert [scene for scene, _ in assembly.node.scenes] == [1, 2, 3, 4, 5]


def test_on_the_virtual_clock_a_live_source_holds_nothing_up():
    assembly = make(source=LiveSource(), virtual=True)
    pace = run_virtual(assembly, duration_s=1.0)
    assert pace.ticks == 50


def count_polls(source):
    def poll(now_ns):
        source.polls += 1

    return poll


def test_a_source_is_not_closed_while_it_is_asked():
    source, entered = Source(), threading.Event()
    inside = []

    def poll(now_ns):
        entered.set()
        inside.append(True)
        time.sleep(0.1)
        assert not source.closed
        inside.pop()

    source.poll = poll  # type: ignore[method-assign]
    source.close = lambda: closed.append(bool(inside))  # type: ignore[method-assign]
    closed: list[bool] = []
    run_real_time(assembly=make(source=source), stop=threading.Event(), duration_s=0.15)
    assert entered.is_set()
    assert closed == [False]


def test_scenes_are_delivered_when_they_are_due():
    assembly = make()
    run_real_time(assembly=assembly, stop=threading.Event(), duration_s=0.3)
    source = assembly.source
    scenes = assembly.node.scenes
    assert [k for k, _ in scenes] == list(range(1, len(scenes) + 1))
    assert all(ns >= source.start_ns + (k - 1) * source.period_ns for k, ns in scenes)
    assert source.closed


def test_it_ends_when_the_source_has_no_more():
    assembly = make(source=Source(count=10))
    run_real_time(assembly=assembly, stop=threading.Event(), until_exhausted=True)
    assert len(assembly.node.scenes) == 10
    assert assembly.node.warm
    assert assembly.node.said == [NodeState.STARTING, NodeState.STOPPING]


def test_without_being_asked_to_it_goes_on_when_the_source_has_no_more():
    assembly = make(source=Source(count=1))
    pace = run_real_time(assembly=assembly, stop=threading.Event(), duration_s=0.3)
    assert pace.ticks + pace.missed_ticks > 10


def test_the_stop_event_ends_it_and_the_controllers_are_told():
    link = Link("a")
    assembly = make(rate_hz=0.1, links=[link])  # a tick in ten seconds: the event must wake it
    stop = threading.Event()
    threading.Timer(0.2, stop.set).start()
    run_real_time(assembly=assembly, stop=stop)
    assert assembly.node.said == [NodeState.STARTING, NodeState.STOPPING]
    assert link.log == ["start", "stop"]
    assert assembly.source.closed


def test_an_absent_device_is_an_error_and_what_was_opened_is_closed():
    there, absent = Link("a"), Link("b", absent=True)
    assembly = make(links=[there, absent])
    with pytest.raises(LinkError, match="b: not there"):
        run_real_time(assembly=assembly, stop=threading.Event(), duration_s=1)
    assert there.log == ["start", "stop"]
    assert assembly.node.said == []


def test_all_absent_devices_are_named_together_in_the_order_of_the_links():
    links = [Link("a", absent=True), Link("b"), Link("c", absent=True)]
    with pytest.raises(LinkErrors) as caught:
        run_real_time(assembly=make(links=links), stop=threading.Event(), duration_s=1)
    assert caught.value.lines == ("a: not there", "c: not there")
    assert links[1].log == ["start", "stop"]


def test_a_link_that_hangs_does_not_hide_one_that_is_absent(monkeypatch):
    monkeypatch.setattr(starting, "OTHERS_S", 0.01)
    opened = threading.Event()
    hangs = Link("a")
    monkeypatch.setattr(hangs, "start", opened.wait)
    with pytest.raises(LinkError, match=r"^b: not there$"):
        run_real_time(
            assembly=make(links=[hangs, Link("b", absent=True)]),
            stop=threading.Event(),
            duration_s=1,
        )
    opened.set()


def test_a_tick_that_raises_ends_it_with_the_controllers_told(monkeypatch):
    def raises(now_ns):
        raise ZeroDivisionError

    link = Link("a")
    assembly = make(links=[link])
    assembly.node.tick = raises
    with pytest.raises(ZeroDivisionError):
        run_real_time(assembly=assembly, stop=threading.Event(), duration_s=1)
    assert assembly.node.said[-1] is NodeState.STOPPING
    assert link.log == ["start", "stop"]


def test_the_interpreter_is_left_as_it_was():
    before = sys.getswitchinterval()
    run_real_time(assembly=make(), stop=threading.Event(), duration_s=0.05)
    assert sys.getswitchinterval() == before


# -- virtual time


def test_virtual_ticks_are_exact_and_links_are_served_around_each():
    link = Link("a")
    assembly = make(rate_hz=25.0, links=[link], virtual=True)
    pace = run_virtual(assembly, duration_s=1.0)
    assert assembly.node.ticks == [1_000 * MS + k * 40 * MS for k in range(25)]
    assert pace.late_ticks == pace.missed_ticks == 0
    assert link.log == ["service"] * 50 + ["stop"]
    assert assembly.node.said == [NodeState.STARTING, NodeState.STOPPING]


def test_virtual_scenes_come_at_their_time():
    assembly = make(source=Source(count=7), virtual=True)
    run_virtual(assembly)
    assert [ns for _, ns in assembly.node.scenes] == [1_000 * MS + k * 10 * MS for k in range(7)]


def test_virtual_with_a_source_whose_poll_has_nothing_comes_to_its_end():
    source = Source(period_ns=0)
    source.poll = count_polls(source)  # type: ignore[method-assign]
    beside = Beside()
    assembly = make(rate_hz=25.0, source=source, virtual=True)
    run_virtual(assembly, beside, duration_s=1.0)
    assert assembly.node.ticks == [1_000 * MS + k * 40 * MS for k in range(25)]
    assert beside.steps == [1_000 * MS + k * 7 * MS for k in range(143)]
    assert source.polls < 1000


class Beside:
    def __init__(self):
        self.due, self.steps = 1_000 * MS, []

    def next_ns(self):
        return self.due

    def step(self, now_ns):
        self.steps.append(now_ns)
        self.due += 7 * MS


def test_virtual_steps_what_lives_beside_at_its_own_times():
    beside = Beside()
    run_virtual(make(rate_hz=25.0, virtual=True), beside, duration_s=0.5)
    assert beside.steps == [1_000 * MS + k * 7 * MS for k in range(72)]
