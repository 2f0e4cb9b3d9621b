"""Faults of a source of scenes, injected between it and the node."""

from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Annotated, Any, ClassVar, Literal

import numpy as np
from pydantic import Field

from hri_predict.base.errors import ConfigError, nearest
from hri_predict.base.settings import Metres, Pose, Quaternion, Vector3
from hri_predict.contracts.joint_map import JointMap
from hri_predict.contracts.scene import Person, Scene
from hri_predict.contracts.source import Source, live_part
from hri_sim.faults.made_up import MadeUp, MadeUpPeople
from hri_sim.faults.occlusion import Occlusion
from hri_sim.faults.settings import (
    Delay,
    Drop,
    Duplicate,
    FaultSettings,
    Jitter,
    Late,
    Reorder,
    Way,
    faults_from,
)

SIN_45 = 0.5**0.5


class GrowingDelay(Delay):
    """Scenes arrive late, by ``growth`` more for each second; their capture stamps are true."""

    growth: float = Field(0.0, ge=0, le=0.5, description="growth of the delay, seconds per second")

    def late_ns(self, elapsed_ns: int, rng: np.random.Generator) -> int:
        """Return the delay, as it has grown since the start."""
        grown_s = self.growth * (elapsed_ns * 1e-9 - self.start_s)
        return int((self.delay_s + grown_s) * 1e9)


class PeopleFault(FaultSettings):
    """A fault that changes people alone, each by itself."""

    def changed(self, person: Person, joints: Sequence[str]) -> Person | None:
        """Return a person as the source shows them; ``None``: it does not.

        Args:
            person: as they are.
            joints: names of the source's joints.
        """
        raise NotImplementedError


class NamedPeopleFault(PeopleFault):
    """A fault of all people, or of one."""

    person: int | None = Field(None, description="person with this id; default: all people")

    def concerns(self, person: Person) -> bool:
        """Whether it changes this person."""
        return self.person in (None, person.id)


class Freeze(FaultSettings):
    """The source repeats its last scene.

    ``what`` is ``sequence``: the very same scene, sequence and stamp again; or ``joints``: sequence
    and stamp go on, the joints stay bit-identical, as from a hung camera with a live driver.
    """

    what: Literal["sequence", "joints"] = Field(
        "sequence", description="sequence: the same scene again; joints: only they stay as they are"
    )


class Zero(PeopleFault):
    """Lost joints are sent at one place, and marked as observed."""

    joints: list[str] = Field(["l_wrist"], min_length=1, description="names of the source's joints")
    at: Vector3 = Field([0.0, 0.0, 0.0], description="the source's origin in the room")

    def changed(self, person: Person, joints: Sequence[str]) -> Person | None:
        """Return them with the lost joints at one place."""
        lost = np.isin(joints, self.joints)
        positions = np.where(lost[:, None], self.at, person.positions)
        return replace(person, positions=positions, observed=person.observed | lost)


class Nan(FaultSettings):
    """A fraction of the joints is NaN but marked as observed."""

    fraction: float = Field(0.3, gt=0, le=1, description="share of the joints")


class Teleport(NamedPeopleFault):
    """All people (or the ``person`` with this id) are displaced by ``offset`` metres."""

    offset: Vector3 = Field([2.0, 0.0, 0.0], description="displacement of a body's jump, m")

    def changed(self, person: Person, joints: Sequence[str]) -> Person | None:
        """Return them displaced."""
        if not self.concerns(person):
            return person
        return replace(person, positions=person.positions + np.asarray(self.offset))


class Rotate(PeopleFault):
    """All people are turned about the point ``about`` (room frame), as by wrong axes."""

    quaternion_xyzw: Quaternion = Field([SIN_45, 0.0, 0.0, SIN_45], description="rotation")
    about: Vector3 = Field([0.0, 0.0, 0.0], description="about which point, room frame, m")

    def changed(self, person: Person, joints: Sequence[str]) -> Person | None:
        """Return them turned."""
        turn = Pose(quaternion_xyzw=self.quaternion_xyzw).matrix()[:3, :3]
        about = np.asarray(self.about)
        return replace(person, positions=(person.positions - about) @ turn.T + about)


class Mirror(PeopleFault):
    """All people are mirrored at the plane y = ``at_y`` of the room: left and right are swapped."""

    at_y: float = Field(0.0, ge=-1000, le=1000, description="at the plane of this y, m")

    def changed(self, person: Person, joints: Sequence[str]) -> Person | None:
        """Return them mirrored."""
        over, plane = np.array([1.0, -1.0, 1.0]), np.array([0.0, 2.0 * self.at_y, 0.0])
        return replace(person, positions=person.positions * over + plane)


class IdentitySwap(FaultSettings):
    """People's ids rotate; a single person gets a new id."""


class Rename(PeopleFault):
    """The ``person`` with this id gets the id ``to``."""

    person: int = Field(1, description="person with this id")
    to: int = Field(2000, ge=0, le=65535, description="the new id")

    def changed(self, person: Person, joints: Sequence[str]) -> Person | None:
        """Return them with their id."""
        return replace(person, id=self.to) if person.id == self.person else person


class Alternate(FaultSettings):
    """The ids ``person`` and ``other`` become one, ``person``, which shows each of them in turn."""

    person: int = Field(1, description="person with this id")
    other: int = Field(2, description="the other one, who gets that id")
    captures: int = Field(1, ge=1, le=1000, description="number of captures of each, in turn")


class Occlude(FaultSettings):
    """People are seen by ``cameras`` alone: boxes ([x, y, x, y, height]) and bodies hide them.

    A person who is found again gets another id with the probability ``rename``.
    """

    cameras: list[Vector3] = Field(
        [[-6.0, -6.0, 2.8]], min_length=1, description="positions of cameras, room frame, m"
    )
    boxes: list[Annotated[list[Metres], Field(min_length=5, max_length=5)]] = Field(
        [], description="that hide people: [x, y, x, y, height], m"
    )
    rename: float = Field(
        0.0, ge=0, le=1, description="chance that who is found again has another id"
    )


class Vanish(NamedPeopleFault):
    """All people (or the ``person`` with this id) are missing; the source still sees the room."""

    def changed(self, person: Person, joints: Sequence[str]) -> Person | None:
        """Return who has not vanished."""
        return None if self.concerns(person) else person


class Hide(NamedPeopleFault):
    """The named ``joints`` of all people (or of the ``person`` with this id) are not observed."""

    joints: list[str] = Field(min_length=1, description="names of the joints that are not observed")

    def changed(self, person: Person, joints: Sequence[str]) -> Person | None:
        """Return them without the hidden joints."""
        if not self.concerns(person):
            return person
        hidden = np.isin(joints, self.joints)
        positions = np.where(hidden[:, None], np.nan, person.positions)
        return replace(person, positions=positions, observed=person.observed & ~hidden)


class Blind(FaultSettings):
    """The source reports that it does not see the room."""


class ClockDrift(FaultSettings):
    """The source's clock runs fast by ``ppm`` parts in a million; the offset it gained stays."""

    ppm: float = Field(
        1000.0, ge=-100_000, le=100_000, description="rate error of its clock, parts per million"
    )


class ClockJump(FaultSettings):
    """The source's clock is off by ``offset_s``, then right again."""

    offset_s: float = Field(-1.0, ge=-1e6, le=1e6, description="size of the jump of its stamps")
    renumber: int = Field(
        0, ge=-1_000_000, le=0, description="change of its scenes' numbers, as after a restart"
    )


SOURCE_FAULTS: dict[str, type[FaultSettings]] = {
    "drop": Drop,
    "delay": GrowingDelay,
    "jitter": Jitter,
    "freeze": Freeze,
    "made_up": MadeUp,
    "zero": Zero,
    "duplicate": Duplicate,
    "reorder": Reorder,
    "nan": Nan,
    "teleport": Teleport,
    "rotate": Rotate,
    "mirror": Mirror,
    "identity_swap": IdentitySwap,
    "alternate": Alternate,
    "occlude": Occlude,
    "rename": Rename,
    "vanish": Vanish,
    "hide": Hide,
    "blind": Blind,
    "clock_drift": ClockDrift,
    "clock_jump": ClockJump,
}


class FaultySource:
    """A source with faults, itself a ``Source``; a pure function of its seed and its input.

    Attributes:
        on_truth: called with every scene of the inner source before any fault, at the time it was
            due; a referee uses it.
        injected: number of scenes that each kind of fault has changed, delayed or lost.
    """

    kinds: ClassVar[Mapping[str, type[FaultSettings]]] = SOURCE_FAULTS

    def __init__(
        self, inner: Source, faults: Sequence[dict[str, Any]], seed: int, where: str = "source"
    ) -> None:
        """Wrap ``inner``; ``faults`` are applied in the order in which they are listed.

        Raises:
            ConfigError: a fault of unknown kind, with a wrong key, or with a joint that the source
                does not have; ``where`` names the place.
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
        """Open the inner source; the faults' times count from ``start_ns``."""
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
