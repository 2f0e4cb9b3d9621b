"""Requirements of the contract on a source; see ``hri_predict.contracts.source``.

A source that predicts its scenes (a recording, a simulator) is polled for one after the other. A
source that receives from a sender is observed for a while, during which a sender must send.
"""

import math
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import cached_property
from itertools import pairwise
from pathlib import Path

import numpy as np

from hri_predict.base.arrays import Floats
from hri_predict.base.clock import MonotonicClock
from hri_predict.base.geometry import transform
from hri_predict.base.settings import MAX_COORDINATE_M, MAX_RATE_HZ, MIN_RATE_HZ, Pose
from hri_predict.contracts import registry
from hri_predict.contracts.joint_map import JointMap
from hri_predict.contracts.scene import MAX_ERROR_M, Scene, sound_error_m
from hri_predict.contracts.source import (
    NOT_KNOWN_NS,
    AnySourceClass,
    Source,
    SourceSettings,
    live_part,
    wait_for,
)
from hri_predict.library.conformance.checks import (
    NOTHING_CAME,
    Broken,
    CheckResult,
    Skipped,
    demand,
    demand_soon,
    refuses_nonsense,
    run_checks,
)

MAX_SCENES = 200
MAX_BODY_M = 3.5  # from the first joint seen of a person to any other: nobody is so long
CLOSE_S = 2.0  # a thread may have to end
START_NS = 1_000_000_000
ELSEWHERE = Pose(xyz=[1.0, -2.0, 0.5], quaternion_xyzw=[0.0, 0.0, 0.7071068, 0.7071068])
NOISE_M = 0.2  # of a joint, with noise; the other pose is metres away
SAME_M = 1e-9  # two rotations of coordinates below 1000 m: 10 roundings of 2**-52 each


@dataclass
class Heard:
    """Result of listening to a source once."""

    scenes: list[Scene] = field(default_factory=list)
    poll_s: list[float] = field(default_factory=list)
    next_s: list[float] = field(default_factory=list)
    early: int = 0  # scenes that came before ``next_ns`` had said

    def next_ns(self, source: Source) -> int | None:
        """Return the source's ``next_ns``."""
        began = time.perf_counter()
        due_ns = source.next_ns()
        self.next_s.append(time.perf_counter() - began)
        return due_ns

    def poll(self, source: Source, now_ns: int) -> Scene | None:
        """Poll the source."""
        began = time.perf_counter()
        scene = source.poll(now_ns)
        self.poll_s.append(time.perf_counter() - began)
        if scene is not None:
            self.scenes.append(scene)
        return scene


@dataclass
class SourcePart:
    """A source to check, and its settings.

    Attributes:
        seconds: time to listen if it receives from a sender.
    """

    cls: AnySourceClass
    settings: SourceSettings
    base_dir: Path
    seconds: float

    def make(self, settings: SourceSettings | None = None) -> Source:
        """Return a new source."""
        return self.cls(settings or self.settings, self.base_dir)

    @cached_property
    def live(self) -> bool:
        """Whether it receives from a sender."""
        return live_part(self.make()) is not None

    @cached_property
    def heard(self) -> Heard:
        """Return the source's scenes, received once for all checks.

        Raises:
            Skipped: it gave nothing.
            Broken: a sender was sending, but the source produced no scene.
        """
        if not self.live:
            return _not_empty(self.foreseen(), "give a longer one")
        source = self.make()
        found, live = _listened(source, self.seconds), live_part(source)
        if not found.scenes and live is not None and live.counters.packets:
            why = live.counters.last_error or "its counters do not show the reason"
            raise Broken(f"made no scene of {live.counters.packets} packets: {why}")
        return _not_empty(found, "send to it meanwhile")

    def foreseen(self, settings: SourceSettings | None = None) -> Heard:
        """Return the scenes of a source that predicts them, as fast as possible."""
        source, found = self.make(settings), Heard()
        with _opened(source, START_NS):
            while len(found.scenes) < MAX_SCENES and (due_ns := found.next_ns(source)) is not None:
                found.early += found.poll(source, due_ns - 1) is not None
                if found.poll(source, due_ns) is None:
                    raise Broken("next_ns names a time at which poll has no scene")
        return found


def check_source(
    name: str, settings: SourceSettings, base_dir: Path, seconds: float
) -> list[CheckResult]:
    """Run all checks on the source registered as ``name``; ``seconds`` as in ``SourcePart``.

    Raises:
        HriPredictError: it cannot be made.
    """
    part = SourcePart(registry.load("sources", name), settings, base_dir, seconds)
    with registry.building(f"source '{name}'"):
        part.make()
    return run_checks(CHECKS, part)


def refuses_settings_that_make_no_sense(part: SourcePart) -> str:
    """Unknown keys and impossible values are refused by a ``ConfigError`` of one line."""
    wrong = (
        {"min_latency_s": "soon"},
        {"stale_s": -1.0},
        {"room_from_source": {"quaternion_xyzw": [0, 0, 0, 0]}},
        {"room_from_source": {"xyz": [0, 0, float("nan")]}},
        {"field_of_view": {"polygon": [[0, 0]]}},
    )
    data = part.settings.model_dump(exclude_unset=True)
    return refuses_nonsense(part.cls.settings_model, data, wrong)


def says_what_it_gives(part: SourcePart) -> str:
    """Joint map, rate, and whether it declares noise are attributes."""
    source = part.make()
    demand(isinstance(source.joint_map, JointMap), "joint_map: must be a JointMap")
    demand(isinstance(source.declares_noise, bool), "declares_noise: must be true or false")
    rate_hz = source.rate_hz
    demand(MIN_RATE_HZ <= rate_hz <= MAX_RATE_HZ, f"rate_hz is {rate_hz!r}: not a rate")
    mapped = int(source.joint_map.mapped.sum())
    return (
        f"{len(source.joint_map.source_joints)} joints, {mapped} canonical ones; {rate_hz:g} Hz; "
        f"{'hears a sender' if part.live else 'foresees its scenes'}"
    )


def is_quiet_until_opened(part: SourcePart) -> str:
    """Creating a source opens nothing: it has no scene, and two can exist at the same time."""
    first, second = part.make(), part.make()
    for source in (first, second):
        demand(source.next_ns() in (None, NOT_KNOWN_NS), "it names a time before it is opened")
        demand(source.poll(2**60) is None, "it gives a scene before it is opened")
        source.close()
    return "no scene before open; close without open is harmless"


def never_blocks(part: SourcePart) -> str:
    """``next_ns`` and ``poll`` return immediately, with or without a scene."""
    if part.live:
        source, idle = part.make(), Heard()
        with _opened(source, time.monotonic_ns()):
            for _ in range(20):  # most find nothing
                idle.next_ns(source)
                idle.poll(source, time.monotonic_ns())
        said = demand_soon(idle.poll_s, "poll") + ", " + demand_soon(idle.next_s, "next_ns")
        return f"without input: {said}"
    return demand_soon(part.heard.poll_s, "poll") + ", " + demand_soon(part.heard.next_s, "next_ns")


def comes_when_it_said(part: SourcePart) -> str:
    """A scene arrives at the time given by ``next_ns``, not before."""
    if part.live:
        raise Skipped("a source that receives from a sender cannot predict scenes")
    demand(part.heard.early == 0, f"{part.heard.early} scenes came before next_ns")
    return f"{len(part.heard.scenes)} scenes, none early"


def gives_sound_scenes(part: SourcePart) -> str:
    """Stamp and sequence are integers, ids are unique, and arrays match the source's joints."""
    joints = len(part.make().joint_map.source_joints)
    for scene in part.heard.scenes:
        for name, value in (("stamp_ns", scene.stamp_ns), ("sequence", scene.sequence)):
            demand(isinstance(value, int), f"{name} is {value!r}: must be an int")
        demand(isinstance(scene.sees_room, bool), "sees_room: must be true or false")
        ids = [person.id for person in scene.people]
        demand(len(set(ids)) == len(ids), f"two people of one scene share an id: {ids}")
        for person in scene.people:
            demand(0 <= person.id <= 65_535, f"id {person.id}: must be 0 to 65535")
            shapes = person.positions.shape, person.observed.shape
            demand(shapes == ((joints, 3), (joints,)), f"shapes {shapes}; joints: {joints}")
            demand(person.positions.dtype == np.float64, "positions: must be float64")
            demand(person.observed.dtype == np.bool_, "observed: must be bool")
            sound = math.isfinite(sound_error_m(person.error_m))
            demand(sound, f"error_m is {person.error_m!r}: must be 0 to {MAX_ERROR_M:g} m")
    people = sum(len(scene.people) for scene in part.heard.scenes)
    return f"{len(part.heard.scenes)} scenes, {people} bodies"


def marks_what_it_did_not_see(part: SourcePart) -> str:
    """Positions are NaN exactly where a joint was not observed."""
    seen = total = 0
    for scene in part.heard.scenes:
        for person in scene.people:
            finite = np.asarray(np.isfinite(person.positions).all(axis=1))
            missing = np.asarray(np.isnan(person.positions).all(axis=1))
            demand(bool(finite[person.observed].all()), "an observed joint is not finite")
            demand(bool(missing[~person.observed].all()), "an unobserved joint is not NaN")
            seen, total = seen + int(person.observed.sum()), total + person.observed.size
    if total == 0:
        raise Skipped("no person came into view; give a source with people")
    return f"{seen} of {total} joints observed"


def gives_metres(part: SourcePart) -> str:
    """All people have human size and are in the cell."""
    longest = 0.0
    for scene in part.heard.scenes:
        for person in scene.people:
            body = person.positions[person.observed]
            if len(body) == 0:
                continue
            far = float(np.abs(body).max())
            demand(far <= MAX_COORDINATE_M, f"a joint is {far:.3g} m from the origin; which units?")
            longest = max(longest, float(np.linalg.norm(body - body[0], axis=1).max()))
    if longest == 0.0:
        raise Skipped("no person came into view; give a source with people")
    demand(longest <= MAX_BODY_M, f"a body's joints are {longest:.3g} m apart; which units?")
    return f"joints of a body up to {longest:.2f} m from its first one"


def stands_in_the_room(part: SourcePart) -> str:
    """``room_from_source`` transforms the source's positions as a rigid pose."""
    if part.live:
        raise Skipped("needs the same scenes twice, which a sender cannot provide")
    moved = part.settings.model_copy(update={"room_from_source": ELSEWHERE})
    here, there = part.settings.room_from_source.matrix(), ELSEWHERE.matrix()
    step = there @ np.linalg.inv(here)
    apart = [
        _apart(transform(step, a.positions), b.positions)
        for first, second in zip(part.heard.scenes, part.foreseen(moved).scenes, strict=True)
        for a, b in zip(first.people, second.people, strict=True)
    ]
    if not apart:
        raise Skipped("no person came into view; give a source with people")
    noisy = part.make().declares_noise  # which need not turn with the pose
    off_m = float(np.median(apart)) if noisy else max(apart)
    demand(off_m <= (NOISE_M if noisy else SAME_M), f"with another pose {off_m:.2g} m off")
    return f"{len(apart)} bodies moved by a pose"


def counts_up(part: SourcePart) -> str:
    """The sequence increases from scene to scene, and stamps do not go back."""
    scenes = part.heard.scenes
    for before, after in pairwise(scenes):
        demand(
            after.sequence > before.sequence,
            f"sequence {after.sequence} comes after {before.sequence}",
        )
        back_ns = before.stamp_ns - after.stamp_ns
        demand(back_ns <= 0, f"a stamp goes back by {back_ns * 1e-6:.3f} ms")
    return f"sequence {scenes[0].sequence} to {scenes[-1].sequence}"


def gives_the_same_again(part: SourcePart) -> str:
    """A second instance of a source that predicts its scenes gives the same ones, so replays are
    exact.
    """
    if part.live:
        raise Skipped("a sender's values are not controlled by the source")
    scenes, again = part.heard.scenes, part.foreseen().scenes
    demand(len(scenes) == len(again), f"{len(scenes)} scenes, then {len(again)}")
    demand(all(map(_equal, scenes, again)), "made a second time, it gives other scenes")
    return f"{len(scenes)} scenes"


def closes_twice(part: SourcePart) -> str:
    """``close`` returns within two seconds, releases all resources, and may be called twice."""
    taken = []
    for _ in range(2):  # the second finds everything free again
        source = part.make()
        source.open(time.monotonic_ns())
        began = time.perf_counter()
        source.close()
        taken.append(time.perf_counter() - began)
        source.close()
    demand(max(taken) <= CLOSE_S, f"close took {max(taken):.1f} s")
    return f"in {1e3 * max(taken):.0f} ms, twice, and opened again between"


CHECKS: tuple[Callable[[SourcePart], str], ...] = (
    refuses_settings_that_make_no_sense,
    says_what_it_gives,
    is_quiet_until_opened,
    never_blocks,
    comes_when_it_said,
    gives_sound_scenes,
    marks_what_it_did_not_see,
    gives_metres,
    stands_in_the_room,
    counts_up,
    gives_the_same_again,
    closes_twice,
)


@contextmanager
def _opened(source: Source, start_ns: int) -> Iterator[None]:
    source.open(start_ns)
    try:
        yield
    finally:
        source.close()


def _listened(source: Source, seconds: float) -> Heard:
    """Return the scenes that a source receives within some time, polled as in the node's own
    thread.
    """
    clock, found = MonotonicClock(), Heard()
    end_ns = clock.now_ns() + round(seconds * 1e9)
    with _opened(source, clock.now_ns()):
        while clock.now_ns() < end_ns and len(found.scenes) < MAX_SCENES:
            due_ns = found.next_ns(source)
            if due_ns is None:
                break
            wait_for(source, min(due_ns, clock.now_ns() + 10_000_000), clock)
            while found.poll(source, clock.now_ns()) is not None:
                pass
    return found


def _not_empty(found: Heard, hint: str) -> Heard:
    if not found.scenes:
        raise Skipped(f"{NOTHING_CAME}; {hint}")
    return found


def _apart(first: Floats, second: Floats) -> float:
    """Return the maximum difference of two bodies; infinite if only one of two values is NaN."""
    both = np.isfinite(first) & np.isfinite(second)
    if (np.isfinite(first) != np.isfinite(second)).any():
        return float("inf")
    return float(np.abs(first - second)[both].max(initial=0.0))


def _equal(a: Scene, b: Scene) -> bool:
    head = (a.stamp_ns, a.sequence, a.sees_room, len(a.people))
    return head == (b.stamp_ns, b.sequence, b.sees_room, len(b.people)) and all(
        p.id == q.id
        and p.positions.tobytes() == q.positions.tobytes()
        and p.observed.tobytes() == q.observed.tobytes()
        for p, q in zip(a.people, b.people, strict=True)
    )
