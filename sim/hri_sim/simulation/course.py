"""True course of an episode: recorded tick by tick, and judged afterwards, many ticks at once.

Recorded people do not react, so their true positions do not depend on the robot and are computed
once for all episodes of a scenario. The referee does not act either, so it can judge afterwards, on
arrays long enough for numpy to be efficient.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np

from hri_predict.base.arrays import Bools, Floats
from hri_predict.base.geometry import Capsules, least_distance
from hri_predict.base.skeleton import CANONICAL
from hri_sim.referee import MOVING_M_S, Bodies, Joints, Referee, TruePeople, body_capsules

_MOST_TICKS = 12
"""Number of ticks judged at once; with more, the distances no longer fit into a core's cache."""


class SharedTruth:
    """The true positions of all people, kept for the next episode of the same scenario."""

    def __init__(self, truth: TruePeople) -> None:
        self._truth = truth
        self._known: dict[int, dict[int, tuple[Floats, Bools]]] = {}

    def open(self, start_ns: int) -> None:
        """Start; further calls do nothing."""
        if not self._known:
            self._truth.open(start_ns)

    def at(self, now_ns: int) -> dict[int, tuple[Floats, Bools]]:
        """See ``TruePeople.at``: new times must not decrease."""
        if now_ns not in self._known:
            self._known[now_ns] = self._truth.at(now_ns)
        return self._known[now_ns]


@dataclass(kw_only=True)
class Course:
    """The true state at each of K ticks.

    Attributes:
        stamps_ns: (K,).
        people, robots: (K,) see ``referee.Bodies`` and ``referee.Joints``.
        tools: (K,) robot name -> number of its tool; ``None``: all tools.
    """

    stamps_ns: list[int] = field(default_factory=list)
    people: list[Bodies] = field(default_factory=list)
    robots: list[Joints] = field(default_factory=list)
    tools: list[dict[str, int | None]] = field(default_factory=list)

    def runs(self) -> Iterator[range]:
        """Yield runs of ticks that can be judged at once, with the same people and tools."""
        k = 0
        while k < len(self.stamps_ns):
            end = k + 1
            if self._goes_on(k):
                step_ns = self.stamps_ns[k] - self.stamps_ns[k - 1]
                while (
                    end < min(len(self.stamps_ns), k + _MOST_TICKS)
                    and self._goes_on(end)
                    and self.stamps_ns[end] - self.stamps_ns[end - 1] == step_ns
                    and self.tools[end] == self.tools[k]
                ):
                    end += 1
            yield range(k, end)
            k = end

    def _goes_on(self, k: int) -> bool:
        return (
            k > 0
            and bool(self.people[k])
            and self.people[k].keys() == self.people[k - 1].keys()
            and self.robots[k].keys() == self.robots[k - 1].keys()
        )


class CourseReferee(Referee):
    """The referee of a finished course; its results equal those of judging tick by tick."""

    def judge(self, course: Course) -> None:
        """Judge the whole course."""
        for ticks in course.runs():
            self._tool_of = course.tools[ticks[0]].get
            if len(ticks) == 1 or not self._judge_at_once(course, ticks):
                for k in ticks:
                    self.observe(course.stamps_ns[k], course.people[k], course.robots[k])

    def _judge_at_once(self, course: Course, ticks: range) -> bool:
        """Judge a run; return false if its touches must be reported one by one."""
        assert self._last is not None
        times = self._instants(course.stamps_ns[ticks[0]])
        ids = sorted(course.people[ticks[0]])
        bodies, counts = _bodies(ids, course.people[ticks[0] - 1 : ticks[-1] + 1], times)
        ever = np.flatnonzero(counts.any(axis=(0, 1)))  # others would only cost time
        bodies = Capsules(bodies.a[:, :, ever], bodies.b[:, :, ever], bodies.radius[:, :, ever])
        found = {}
        for name in course.robots[ticks[0]]:
            states = [course.robots[k][name] for k in range(ticks[0] - 1, ticks[-1] + 1)]
            model = self._robots[name].counting(self._tool_of(name))
            q, qd = (_between(np.array([s[i] for s in states]), times) for i in (0, 1))
            robot, speed = model.moving(q, qd)
            gaps = least_distance(bodies, counts[:, :, ever], robot)
            if self._on_contact is not None and (gaps[:, speed > MOVING_M_S] <= 0).any():
                return False
            found[name] = gaps, np.asarray(speed)
        elapsed_s = (course.stamps_ns[ticks[0]] - self._last[0]) * 1e-9
        for tick in range(len(ticks)):
            part = slice(tick * len(times), (tick + 1) * len(times))
            near = np.zeros(len(times), dtype=bool)
            for name, (gaps, speed) in found.items():
                self._note(ids, name, gaps[:, part], speed[part])
                near |= self._too_near(gaps[:, part].min(axis=0), speed[part])
            self.violation_s += elapsed_s / len(times) * np.count_nonzero(near)
        last = ticks[-1]
        self._last = (course.stamps_ns[last], course.people[last], course.robots[last])
        self.observations += len(ticks) * len(times)
        return True


def _between(states: Floats, times: Floats) -> Floats:
    """Return (M * K, N) values at K fractions of each step between M + 1 states (M + 1, N)."""
    start, end = states[:-1, None], states[1:, None]
    result: Floats = start + (end - start) * times[:, None]
    return result.reshape(-1, states.shape[-1])


def _bodies(ids: Sequence[int], people: Sequence[Bodies], times: Floats) -> tuple[Capsules, Bools]:
    """Return capsules (P, M * K, B) at K fractions of each step between M + 1 observations."""
    joints = len(CANONICAL.joints)
    at = np.array([[seen[person][0] for seen in people] for person in ids])  # (P, M + 1, J, 3)
    known = np.array([[seen[person][1] for seen in people] for person in ids])
    start = np.where(known[:, :-1, :, None], at[:, :-1], at[:, 1:])
    end = np.where(known[:, 1:, :, None], at[:, 1:], at[:, :-1])
    moved = start[:, :, None] + (end - start)[:, :, None] * times[:, None, None]
    both = np.broadcast_to((known[:, :-1] | known[:, 1:])[:, :, None], (*moved.shape[:3], joints))
    count = moved.shape[1] * moved.shape[2]
    return body_capsules(
        moved.reshape(len(ids), count, joints, 3), both.reshape(len(ids), count, joints)
    )
