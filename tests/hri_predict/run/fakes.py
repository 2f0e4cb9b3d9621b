"""A source and a node that note what the loop does with them."""

import time
from pathlib import Path
from types import SimpleNamespace
from typing import Any

from hri_predict.base.clock import MonotonicClock, VirtualClock
from hri_predict.base.machine.realtime import RealtimeSettings
from hri_predict.node.repeats import Repeats
from hri_predict.node.shedding import Shedding

MS = 1_000_000


class Source:
    """A scene every 10 ms, or what the test asks for."""

    def __init__(self, period_ns=10 * MS, count=None):
        self.period_ns, self.count = period_ns, count
        self.k, self.start_ns, self.polls, self.closed = 0, 0, 0, False
        self.rate_hz = 1e9 / (period_ns or 10 * MS)
        self.fails: list[BaseException] = []  # what to raise, one per poll

    def open(self, start_ns):
        self.start_ns = start_ns

    def next_ns(self):
        if self.count is not None and self.k >= self.count:
            return None
        return self.start_ns + self.k * self.period_ns

    def poll(self, now_ns):
        self.polls += 1
        assert not self.closed
        if self.fails:
            raise self.fails.pop()
        due_ns = self.next_ns()
        if due_ns is None or due_ns > now_ns:
            return None
        self.k += 1
        return self.k

    def close(self):
        self.closed = True


class Node:
    def __init__(self, clock):
        self.clock = clock
        self.ticks, self.scenes, self.said = [], [], []
        self.slow: dict[int, float] = {}  # tick -> seconds that it takes
        self.shedding = Shedding()
        self.repeats = Repeats([])
        self.publish_phase = None
        self.warm = False

    def warm_up(self):
        assert not self.said, "it is warm before anybody hears of it"
        self.warm = True

    def tick(self, now_ns):
        self.ticks.append(now_ns)
        time.sleep(self.slow.get(len(self.ticks), 0.0))

    def receive(self, scene, receipt_ns):
        self.scenes.append((scene, receipt_ns))

    def announce(self, now_ns, state, reason):
        self.said.append(state)


def make(rate_hz=50.0, source=None, links=(), virtual=False) -> Any:
    clock: Any = VirtualClock(1_000 * MS) if virtual else MonotonicClock()
    prediction = SimpleNamespace(start=lambda: None, stop=lambda: None, counters={})
    return SimpleNamespace(
        clock=clock,
        node=Node(clock),
        source=source or Source(),
        links=tuple(links),
        prediction=prediction,
        config=SimpleNamespace(
            node=SimpleNamespace(rate_hz=rate_hz, ticks="fixed", realtime=RealtimeSettings()),
            source=SimpleNamespace(kind="own"),
            predictor=SimpleNamespace(name="average"),
            path=Path("cell.yaml"),
        ),
    )
