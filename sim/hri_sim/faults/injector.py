"""The fault injector: a source or a link with faults, and faults from the command line."""

from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any, ClassVar

import numpy as np

from hri_predict.base.arrays import Bools, Floats
from hri_predict.base.errors import ConfigError, nearest
from hri_predict.contracts.joint_map import JointMap
from hri_predict.contracts.scene import Person, Scene
from hri_predict.contracts.source import Source, live_part
from hri_sim.faults.link_faults import LINK_FAULTS, FaultyTransport
from hri_sim.faults.made_up import MadeUp, MadeUpPeople
from hri_sim.faults.settings import (
    Drop,
    Duplicate,
    FaultSettings,
    Jitter,
    Late,
    Reorder,
    Target,
    Way,
    fault_mapping,
    faults_from,
)
from hri_sim.faults.source_faults import (
    SOURCE_FAULTS,
    Alternate,
    Blind,
    ClockDrift,
    ClockJump,
    Freeze,
    Hide,
    IdentitySwap,
    Nan,
    Occlude,
    PeopleFault,
    Zero,
)

__all__ = ["LINK_FAULTS", "SOURCE_FAULTS", "FaultySource", "FaultyTransport", "parse_fault"]


def parse_fault(text: str, target: Target | None = None) -> dict[str, Any]:
    """Parse a fault as ``kind[@start[+duration]][:parameter=value,...]``.

    ``vanish@3+2`` begins 3 s after the start and lasts 2 s; without a duration it lasts to the end;
    ``teleport@3+2:person=1,offset=[0,3,0]`` sets parameters of the kind.

    Args:
        text: the fault.
        target: the fault's target; ``None`` accepts the kinds of both source and link.

    Returns:
        the fault as written under ``faults:`` in a configuration.

    Raises:
        ConfigError: wrong form, unknown kind (the error lists the known ones), or a parameter that
            this kind does not have.
    """
    source: dict[str, type[FaultSettings]] = dict(SOURCE_FAULTS)
    link: dict[str, type[FaultSettings]] = dict(LINK_FAULTS)
    if target is not None:
        return fault_mapping(text, source if target == "source" else link)
    kind = text.strip().partition("@")[0].partition(":")[0]
    if kind in source and kind in link:
        try:
            return fault_mapping(text, source)
        except ConfigError:
            return fault_mapping(text, link)
    return fault_mapping(text, link if kind in link else source | link)


class FaultySource:
    """A source with faults, itself a ``Source``; a pure function of its seed and its input.

    Attributes:
        on_truth: called with every scene of the inner source, before any fault, at its due time;
            used by a referee.
        injected: number of scenes that each kind of fault has changed, delayed or lost.
    """

    kinds: ClassVar[Mapping[str, type[FaultSettings]]] = SOURCE_FAULTS

    def __init__(
        self, inner: Source, faults: Sequence[dict[str, Any]], seed: int, where: str = "source"
    ) -> None:
        """Wrap ``inner``; ``faults`` are applied in the order in which they are listed.

        Raises:
            ConfigError: a fault of unknown kind, with a wrong key, or with a joint that the source
                does not have; the message names ``where``.
        """
        self._inner = inner
        self._faults = faults_from(faults, SOURCE_FAULTS, f"{where}.faults")
        for fault in self._faults:
            if isinstance(fault, Hide | Zero):
                _check_joints(fault, inner.joint_map.source_joints, f"{where}.faults")
        self._rng = np.random.default_rng(seed)
        self._occlusions = {
            id(fault): Occlusion(fault.cameras, fault.boxes, fault.rename, self._rng)
            for fault in self._faults
            if isinstance(fault, Occlude)
        }
        self._made_up = {
            id(f): MadeUpPeople(f, self._rng) for f in self._faults if isinstance(f, MadeUp)
        }
        self._start_ns = 0
        self._way: Way[Scene] = Way(self._rng)
        self._last: Scene | None = None
        self.joint_map: JointMap = inner.joint_map
        self.rate_hz = inner.rate_hz
        self.declares_noise = inner.declares_noise
        self.live = live_part(inner)
        self.on_truth: Callable[[Scene], None] | None = None
        self.injected: dict[str, int] = {}

    def open(self, start_ns: int) -> None:
        """Open the inner source; times of the faults are relative to ``start_ns``."""
        self._start_ns = start_ns
        self._inner.open(start_ns)

    def next_ns(self) -> int | None:
        """Return the earlier of the inner source's next time and the next delayed scene's time."""
        inner_ns = self._inner.next_ns()
        if not self._way.late:
            return inner_ns
        held_ns = self._way.late[0][0]
        return held_ns if inner_ns is None else min(inner_ns, held_ns)

    def poll(self, now_ns: int) -> Scene | None:
        """Return the oldest scene that has arrived, with its faults."""
        while (scene := self._inner.poll(now_ns)) is not None:
            if self.on_truth is not None:
                self.on_truth(scene)
            self._inject(scene, now_ns)
        late = self._way.late
        return late.popleft()[1] if late and late[0][0] <= now_ns else None

    def close(self) -> None:
        """Close the inner source."""
        self._inner.close()

    def _inject(self, scene: Scene, now_ns: int) -> None:
        # Every scene passes through the list of faults; each may change, lose or delay it.
        elapsed_ns = now_ns - self._start_ns
        scenes, arrival_ns = [scene], now_ns
        for fault in self._faults:
            if isinstance(fault, ClockDrift):  # its offset outlasts its window
                scenes = [_shifted(s, self._drift_ns(fault, elapsed_ns)) for s in scenes]
            if not fault.active(elapsed_ns):
                if isinstance(fault, MadeUp):
                    self._made_up[id(fault)].see(scene)
                continue
            self.injected[fault.kind] = self.injected.get(fault.kind, 0) + 1
            if isinstance(fault, Late):
                arrival_ns += fault.late_ns(elapsed_ns, self._rng)
                if isinstance(fault, Jitter) and self._way.late:
                    arrival_ns = max(arrival_ns, self._way.late[-1][0])
            else:
                scenes = [out for s in scenes for out in self._altered(fault, s)]
        scenes += self._way.let_go([f for f in self._faults if f.active(elapsed_ns)])
        if self._last is None or not self._is_frozen(elapsed_ns):
            self._last = scene
        under_way = [*self._way.late, *((arrival_ns, out) for out in scenes)]
        self._way.late = deque(sorted(under_way, key=lambda item: item[0]))

    def _altered(self, fault: FaultSettings, scene: Scene) -> list[Scene]:
        if isinstance(fault, Drop | Duplicate | Reorder):
            return self._way.altered(fault, scene)
        if isinstance(fault, Freeze):
            frozen = self._last or scene
            if fault.what == "sequence":
                return [frozen]
            return [replace(scene, people=frozen.people, sees_room=frozen.sees_room)]
        if isinstance(fault, MadeUp):
            return [self._made_up[id(fault)].made_up(scene)]
        if isinstance(fault, ClockJump):
            jumped = _shifted(scene, int(fault.offset_s * 1e9))
            return [replace(jumped, sequence=scene.sequence + fault.renumber)]
        if isinstance(fault, Blind):
            return [replace(scene, sees_room=False, people=())]
        if isinstance(fault, Occlude):
            seen = self._occlusions[id(fault)].seen(scene.people, scene.stamp_ns)
            return [replace(scene, people=seen)]
        return [replace(scene, people=self._people(fault, scene.people))]

    def _people(self, fault: FaultSettings, people: tuple[Person, ...]) -> tuple[Person, ...]:
        if isinstance(fault, PeopleFault):
            shown = (fault.changed(p, self.joint_map.source_joints) for p in people)
            return tuple(p for p in shown if p is not None)
        if isinstance(fault, Alternate):
            is_other = (self.injected[fault.kind] - 1) // fault.captures % 2 == 1
            missing = fault.person if is_other else fault.other
            seen = tuple(p for p in people if p.id != missing)
            return tuple(replace(p, id=fault.person) if p.id == fault.other else p for p in seen)
        if isinstance(fault, IdentitySwap):
            ids = [p.id for p in people]
            ids = [*ids[1:], ids[0]] if len(ids) > 1 else [(i + 1000) % 65536 for i in ids]
            return tuple(replace(p, id=i) for p, i in zip(people, ids, strict=True))
        if isinstance(fault, Nan):
            return tuple(self._with_nan(p, fault.fraction) for p in people)
        return people

    def _with_nan(self, person: Person, fraction: float) -> Person:
        hit = self._rng.random(len(person.positions)) < fraction
        hit[self._rng.integers(len(hit))] = True  # at least one, or it would be no fault
        positions = np.where(hit[:, None], np.nan, person.positions)
        return replace(person, positions=positions, observed=person.observed | hit)

    def _drift_ns(self, fault: ClockDrift, elapsed_ns: int) -> int:
        drifted_s = max(0.0, elapsed_ns * 1e-9 - fault.start_s)
        if fault.duration_s is not None:
            drifted_s = min(drifted_s, fault.duration_s)
        return int(drifted_s * fault.ppm * 1e3)

    def _is_frozen(self, elapsed_ns: int) -> bool:
        return any(isinstance(f, Freeze) and f.active(elapsed_ns) for f in self._faults)


def _check_joints(fault: Hide | Zero, joints: Sequence[str], where: str) -> None:
    for name in fault.joints:
        if name not in joints:
            raise ConfigError(
                f"{where} ({fault.kind}): unknown joint '{name}'{nearest(name, joints)}; "
                f"the source has: {', '.join(joints)}"
            )


def _shifted(scene: Scene, by_ns: int) -> Scene:
    return replace(scene, stamp_ns=scene.stamp_ns + by_ns)


SEEN_SHARE = 0.3
"""A tracker follows a person with at least this share of the joints visible."""
FORGETS_S = 0.2
"""Absence after which a tracker treats a person as new."""
_HALF_BODY_M = 0.2
_FIRST_NEW_ID = 1000


class Occlusion:
    """Hides people from cameras, and keeps the id that the tracker gave to each person.

    A joint is seen if a straight line to it from one of the cameras misses every box and every
    other body. A tracker loses a person with too few visible joints; when it finds that person
    again, it may give another id.

    Args:
        cameras: (C, 3) positions in the source's frame.
        boxes: (B, 5) x and y of two opposite corners on the floor, and the height.
        rename: probability that a person who is found again gets another id.
        rng: generator of the random choices.
    """

    def __init__(
        self,
        cameras: Sequence[Sequence[float]],
        boxes: Sequence[Sequence[float]],
        rename: float,
        rng: np.random.Generator,
    ) -> None:
        self._cameras = np.asarray(cameras, dtype=np.float64)
        corners = np.asarray(boxes, dtype=np.float64).reshape(-1, 5)
        floor = np.zeros((len(corners), 1))
        first = np.concatenate([corners[:, :2], floor], axis=1)
        second = np.concatenate([corners[:, 2:4], corners[:, 4:]], axis=1)
        self._low, self._high = np.minimum(first, second), np.maximum(first, second)
        self._rename, self._rng = rename, rng
        self._ids: dict[int, int] = {}
        self._last_ns: dict[int, int] = {}
        self._next_id = _FIRST_NEW_ID

    def seen(self, people: Sequence[Person], now_ns: int) -> tuple[Person, ...]:
        """Return the people that the tracker reports, with the joints that it sees."""
        bodies = [_box_of(person) for person in people]
        found = []
        for i, person in enumerate(people):
            others = [body for k, body in enumerate(bodies) if k != i and body is not None]
            observed = person.observed & self._visible(person.positions, others)
            if observed.mean() < SEEN_SHARE:
                continue
            positions = np.where(observed[:, None], person.positions, np.nan)
            number = self._id(person.id, now_ns)
            found.append(replace(person, id=number, positions=positions, observed=observed))
        return tuple(found)

    def _visible(self, joints: Floats, others: Sequence[tuple[Floats, Floats]]) -> Bools:
        low = np.concatenate([self._low, *[body[0][None] for body in others]])
        high = np.concatenate([self._high, *[body[1][None] for body in others]])
        visible = np.zeros(len(joints), np.bool_)
        points = np.nan_to_num(joints)
        for camera in self._cameras:
            visible |= ~_crosses(camera, points, low, high).any(1)
        return visible

    def _id(self, number: int, now_ns: int) -> int:
        last_ns = self._last_ns.get(number)
        self._last_ns[number] = now_ns
        is_new = last_ns is not None and now_ns - last_ns > FORGETS_S * 1e9
        if is_new and self._rng.random() < self._rename:
            self._ids[number] = self._next_id
            self._next_id += 1
        return self._ids.get(number, number)


def _box_of(person: Person) -> tuple[Floats, Floats] | None:
    """Return the upright box by which a body hides others; ``None`` if no joint is known."""
    known = person.positions[person.observed]
    if not len(known):
        return None
    middle = known.mean(axis=0)
    low = np.array([*(middle[:2] - _HALF_BODY_M), 0.0])
    return low, np.array([*(middle[:2] + _HALF_BODY_M), known[:, 2].max()])


def _crosses(camera: Floats, points: Floats, low: Floats, high: Floats) -> Bools:
    """Return (J, B) whether the line from the camera to a point passes through a box (slabs)."""
    way = points - camera
    way = np.where(np.abs(way) < 1e-9, 1e-9, way)[:, None]
    first, second = (low - camera) / way, (high - camera) / way
    enters = np.minimum(first, second).max(-1)
    leaves = np.maximum(first, second).min(-1)
    return (enters <= leaves) & (leaves > 0) & (enters < 1 - 1e-6)
