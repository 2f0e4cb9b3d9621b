"""One sensor of a merged source: its captures on the node's clock, and their faults.

After the merge, ``People`` can no longer make the checks of a single source: whether scenes
advance, whether a clock jumped, and whether a body is frozen, is not a real body, or is at the
sensor's origin. So these checks are made here for each sensor, with the same code.
"""

from collections import Counter, deque
from collections.abc import Iterator
from dataclasses import dataclass, field, replace

import numpy as np

from hri_predict.base.arrays import Floats
from hri_predict.base.skeleton import JOINTS
from hri_predict.contracts.scene import Doubt, Person, Scene
from hri_predict.contracts.source import Source, SourceSettings
from hri_predict.people.body.canonical import Mapped, canonical_bodies, canonical_body
from hri_predict.people.body.floor_watch import FloorWatch
from hri_predict.people.body.made_up import MadeUpWatch, Sign
from hri_predict.people.clock.scene_gate import SceneGate
from hri_predict.people.ring_buffer import NEVER
from hri_predict.people.settings import PeopleSettings
from hri_predict.people.track import Body
from hri_predict.protocol.reasons import Reason

Key = tuple[int, int]
"""Key of a body of one sensor: its id, and the number of earlier bodies with this id in the
scene."""

KEPT = 1024
"""Maximum number of captures kept: two seconds, the longest wait for another sensor, at 500 Hz."""
REFUSED_NS = 1_000_000_000
"""Time for which a body in a scene that does not advance is kept."""
ELSEWHERE_M = 2.5
"""In a scene that does not advance, a body farther than this from its id's newest body is
another."""
STEP_M_S = 4.0
"""Maximum speed of a body between two captures: a faster one may be another body with the same id,
as ids can swap. A faster runner is shown at the position of the later capture."""
_NOWHERE = np.zeros(len(JOINTS), np.bool_)


@dataclass(frozen=True, slots=True, eq=False)
class Capture:
    """All bodies of one capture of a sensor; a body without a joint has none observed.

    Attributes:
        capture_ns: capture time, node's clock.
        sees_room: see ``Scene``.
        bodies: bodies by key, canonical joints.
        doubts: reasons why the capture proves nothing.
    """

    capture_ns: int
    sees_room: bool
    bodies: dict[Key, Body]
    doubts: tuple[Doubt, ...]


@dataclass(slots=True)
class View:
    """A sensor's view at one time between its captures; see ``Sensor.at``."""

    sees_room: bool = True
    bodies: dict[Key, Body] = field(default_factory=dict)
    doubts: list[Doubt] = field(default_factory=list)


class Sensor:
    """One sensor. One thread only.

    Args:
        name: configured name.
        source: source of its scenes.
        settings: validated settings of its kind.

    Attributes:
        name, source: the arguments.
        counters: number of scenes and bodies by fault.
        stale_ns: age of the newest capture at which the sensor counts as silent.
    """

    def __init__(self, name: str, source: Source, settings: SourceSettings) -> None:
        period_ns = round(1e9 / source.rate_hz)
        self.name, self.source = name, source
        self.counters: Counter[str] = Counter()
        self.stale_ns = round(settings.stale_after_s(source.rate_hz) * 1e9)
        self._origin: Floats = np.asarray(settings.room_from_source.xyz, np.float64)
        self._gate = SceneGate(
            period_ns,
            round(settings.min_latency_s * 1e9),
            clock_wander_ns=round(settings.clock_wander_s * 1e9),
            even_captures=settings.even_captures,
        )
        self._period_ns = period_ns
        self._captures: deque[Capture] = deque(maxlen=KEPT)
        self._shown: dict[Key, tuple[int, int]] = {}  # fingerprint, and how often it came again
        self._refused_ns = NEVER
        self.judge_by(PeopleSettings())

    def judge_by(self, people: PeopleSettings) -> None:
        """Set the settings for judging its bodies; call this before its first scene."""
        self._frozen_scenes = people.frozen_scenes
        self._made_up = MadeUpWatch(people, self._origin, self._period_ns)
        self._floor = FloorWatch(people)

    def counts(self) -> dict[str, int]:
        """Return the counters of its scenes and bodies, and of its clock."""
        return {**self._gate.counts(), **self.counters}

    @property
    def newest_ns(self) -> int:
        """Time of the newest capture (node's clock); ``NEVER`` before the first."""
        return self._gate.capture_ns

    def is_silent(self, now_ns: int) -> bool:
        """Return whether its newest capture is too old, or it has none."""
        return now_ns - self.newest_ns > self.stale_ns

    def take(self, now_ns: int) -> None:
        """Process all scenes that have arrived by now."""
        while (scene := self.source.poll(now_ns)) is not None:
            capture_ns = self._gate.admit(scene, now_ns)
            if capture_ns is not None:
                self._captures.append(self._capture(scene, capture_ns, now_ns))
            else:
                self._look_at_refused(scene, now_ns)

    def times_after(self, since_ns: int) -> Iterator[int]:
        """Return its captures after ``since_ns``, oldest first."""
        return (c.capture_ns for c in self._captures if c.capture_ns > since_ns)

    def at(self, time_ns: int, since_ns: int) -> View:
        """Return its bodies at ``time_ns``: as captured, or interpolated between neighbouring
        captures.

        A joint seen in both neighbouring captures is interpolated linearly. Joints seen only in
        other captures since ``since_ns`` keep their newest position, so that no observation is
        lost: the error is at most the distance moved in one period.

        Args:
            time_ns: the node's clock.
            since_ns: time of the previous call; captures up to then have been used.
        """
        before = after = None
        new: list[Capture] = []
        for capture in self._captures:
            if capture.capture_ns <= time_ns:
                before = capture
            if capture.capture_ns > since_ns:
                new.append(capture)
            if capture.capture_ns >= time_ns:
                after = capture
                break
        view = View()
        newest = after or before
        if newest is None:
            return View(sees_room=False)
        for capture in (*new, newest):
            view.sees_room &= capture.sees_room
            view.doubts += [doubt for doubt in capture.doubts if doubt not in view.doubts]
        for capture in reversed(new):
            for key, body in capture.bodies.items():
                known = view.bodies.get(key)
                view.bodies[key] = body if known is None else _filled(known, body)
        if after is None or before is None or after is before:
            return view
        span_ns = after.capture_ns - before.capture_ns
        part, most_m = (time_ns - before.capture_ns) / span_ns, STEP_M_S * span_ns * 1e-9
        for key in before.bodies.keys() & after.bodies.keys():
            between = _between(before.bodies[key], after.bodies[key], part, most_m)
            if between is not None:
                view.bodies[key] = _filled(between, view.bodies.get(key, between))
        return view

    def forget_before(self, time_ns: int) -> None:
        """Drop captures not needed for any time from ``time_ns`` on."""
        while len(self._captures) > 1 and self._captures[1].capture_ns <= time_ns:
            self._captures.popleft()

    # -- one scene --------------------------------------------------------------------------------

    def _capture(self, scene: Scene, capture_ns: int, now_ns: int) -> Capture:
        bodies: dict[Key, Body] = {}
        wrong: set[Reason] = set()
        times: Counter[int] = Counter()
        people = self._made_up.known_first(scene.people)
        mapped = canonical_bodies(people, self.source.joint_map, self._origin)
        for person, of_person in zip(people, mapped, strict=True):
            key = (person.id, times[person.id])
            times[person.id] += 1
            body = self._body(person, of_person, wrong)
            bodies[key] = body
            if key[1] > 0:
                self._note("duplicate_ids", Reason.INPUT_IMPOSSIBLE, wrong)
            elif body.observed.any():
                wrong.update(self._made_up_reasons(body, capture_ns))
                self._floor.note(body, capture_ns)
        if self._is_frozen(bodies):
            self._note("frozen_captures", Reason.INPUT_FROZEN, wrong)
        if self._gate.alignment.jumped:
            wrong.add(Reason.CLOCK_JUMP)
        if now_ns - self._refused_ns < REFUSED_NS:
            wrong.add(Reason.INPUT_IMPOSSIBLE)
        if not scene.sees_room:
            wrong.add(Reason.SOURCE_BLIND)
        doubts = [Doubt(reason, f"sensor {self.name}: {reason.text}") for reason in sorted(wrong)]
        doubts += [replace(d, text=f"sensor {self.name}: {d.text}") for d in self._floor.doubts()]
        return Capture(capture_ns, scene.sees_room, bodies, (*doubts, *scene.doubts))

    def _body(self, person: Person, mapped: Mapped, wrong: set[Reason]) -> Body:
        """Return the canonical body; without joints if none is usable."""
        self.counters.update(mapped.counts)
        if mapped.trouble is not None:
            self._note(mapped.trouble, Reason.INPUT_IMPOSSIBLE, wrong)
        if mapped.hip_centred:
            self._note("hip_centred_bodies", Reason.INPUT_RELATIVE, wrong)
        return mapped.body or Body(person.id, np.zeros((len(JOINTS), 3)), _NOWHERE)

    def _made_up_reasons(self, body: Body, capture_ns: int) -> Iterator[Reason]:
        sign = self._made_up.judge(body, capture_ns)
        if sign is not None:
            self.counters[sign.value] += 1
            yield Reason.INPUT_RELATIVE if sign is Sign.RELATIVE else Reason.INPUT_REPEATS

    def _note(self, counter: str, reason: Reason, wrong: set[Reason]) -> None:
        self.counters[counter] += 1
        wrong.add(reason)

    def _is_frozen(self, bodies: dict[Key, Body]) -> bool:
        """Return whether a body was repeated bit for bit too often, given declared noise."""
        shown: dict[Key, tuple[int, int]] = {}
        for key, body in bodies.items():
            if body.observed.any():
                print_, again = body.fingerprint, 0
                if key in self._shown and self._shown[key][0] == print_:
                    again = self._shown[key][1] + 1
                shown[key] = print_, again
        self._shown = shown
        most = max((again for _, again in shown.values()), default=0)
        return self.source.declares_noise and most >= self._frozen_scenes

    def _look_at_refused(self, scene: Scene, now_ns: int) -> None:
        """Record a body with an unknown id in a scene that does not advance: perhaps of a second
        sender.

        A body with a known id far from its position in the newest capture is treated likewise.
        """
        self.counters["refused_scenes"] += 1
        newest = self._captures[-1].bodies if self._captures else {}
        if any(self._is_elsewhere(person, newest.get((person.id, 0))) for person in scene.people):
            self.counters["people_in_refused_scenes"] += 1
            self._refused_ns = now_ns

    def _is_elsewhere(self, person: Person, newest: Body | None) -> bool:
        if newest is None:
            return True
        body = canonical_body(person, self.source.joint_map, self._origin).body
        if body is None or not newest.observed.any():
            return False
        return float(np.linalg.norm(body.centroid - newest.centroid)) > ELSEWHERE_M


def _between(before: Body, after: Body, part: float, most_m: float) -> Body | None:
    """Return a body interpolated linearly between two captures, with the joints seen in both.

    ``None``: its centre moved by more than ``most_m``, or no joint is in both.
    """
    observed = before.observed & after.observed
    steps = (after.positions - before.positions)[observed]
    if not len(steps) or float(np.linalg.norm(steps.mean(axis=0))) > most_m:
        return None
    line = before.positions + part * (after.positions - before.positions)
    error_m = max(before.error_m, after.error_m)
    return Body(after.id, np.where(observed[:, None], line, 0.0), observed, error_m)


def _filled(body: Body, other: Body) -> Body:
    """Return a body completed with joints of ``other`` that it lacks."""
    missing = other.observed & ~body.observed
    if not missing.any():
        return body
    positions = np.where(missing[:, None], other.positions, body.positions)
    error_m = max(body.error_m, other.error_m)
    return Body(body.id, positions, body.observed | missing, error_m)
