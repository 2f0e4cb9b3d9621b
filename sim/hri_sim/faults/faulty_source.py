"""A source with faults."""

from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any, ClassVar

import numpy as np

from hri_predict.base.errors import ConfigError, nearest
from hri_predict.contracts.joint_map import JointMap
from hri_predict.contracts.scene import Person, Scene
from hri_predict.contracts.source import Source, live_part
from hri_sim.faults.made_up import MadeUp, MadeUpPeople
from hri_sim.faults.occlusion import Occlusion
from hri_sim.faults.settings import (
    Drop,
    Duplicate,
    FaultSettings,
    Jitter,
    Late,
    Reorder,
    Way,
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
