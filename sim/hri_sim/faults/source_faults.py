"""Faults of a source of scenes, injected between it and the node."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from hri_predict.base.settings import Metres, Pose, Quaternion, Vector3
from hri_predict.contracts.scene import Person
from hri_sim.faults.made_up import MadeUp
from hri_sim.faults.settings import (
    Delay,
    Drop,
    Duplicate,
    FaultSettings,
    Jitter,
    Reorder,
)

SIN_45 = 0.5**0.5


class GrowingDelay(Delay):
    """Scenes arrive late, by ``growth`` seconds more each second; their capture stamps are true."""

    soak = ("delay_s=0.05", "delay_s=0.6")

    growth: float = Field(0.0, ge=0, le=0.5, description="growth of the delay, seconds per second")

    def late_ns(self, elapsed_ns: int, rng: np.random.Generator) -> int:
        """Return the delay, including its growth since the start."""
        grown_s = self.growth * (elapsed_ns * 1e-9 - self.start_s)
        return int((self.delay_s + grown_s) * 1e9)


class PeopleFault(FaultSettings):
    """A fault that changes only people, each independently."""

    def changed(self, person: Person, joints: Sequence[str]) -> Person | None:
        """Return a person as the source reports them; ``None``: not reported.

        Args:
            person: the true person.
            joints: names of the source's joints.
        """
        raise NotImplementedError


class NamedPeopleFault(PeopleFault):
    """A fault of all people, or of one."""

    person: int | None = Field(None, description="person with this id; default: all people")

    def concerns(self, person: Person) -> bool:
        """Return whether the fault applies to this person."""
        return self.person in (None, person.id)


class Freeze(FaultSettings):
    """The source repeats its last scene.

    ``what`` is ``sequence``: the identical scene, including sequence and stamp; or ``joints``:
    sequence and stamp continue while the joints stay bit-identical, as with a hung camera and a
    live driver.
    """

    soak = ("", "what=joints")

    what: Literal["sequence", "joints"] = Field(
        "sequence", description="sequence: repeat the same scene; joints: repeat only the joints"
    )


class Zero(PeopleFault):
    """Lost joints are all sent at one position, marked as observed."""

    soak = ("joints=[l_wrist,l_hand,l_elbow]",)
    deceives = True

    joints: list[str] = Field(["l_wrist"], min_length=1, description="names of the source's joints")
    at: Vector3 = Field([0.0, 0.0, 0.0], description="the source's origin in the room")

    def changed(self, person: Person, joints: Sequence[str]) -> Person | None:
        """Return the person with the lost joints at one position."""
        lost = np.isin(joints, self.joints)
        positions = np.where(lost[:, None], self.at, person.positions)
        return replace(person, positions=positions, observed=person.observed | lost)


class Nan(FaultSettings):
    """A fraction of the joints is NaN but marked as observed."""

    soak = ("", "fraction=1.0")

    fraction: float = Field(0.3, gt=0, le=1, description="fraction of the joints")


class Teleport(NamedPeopleFault):
    """All people (or the ``person`` with this id) are displaced by ``offset`` metres."""

    soak = ("offset=[0,3,0]",)
    deceives = True

    offset: Vector3 = Field([2.0, 0.0, 0.0], description="displacement of a body's jump, m")

    def changed(self, person: Person, joints: Sequence[str]) -> Person | None:
        """Return the person displaced."""
        if not self.concerns(person):
            return person
        return replace(person, positions=person.positions + np.asarray(self.offset))


class Rotate(PeopleFault):
    """All people are turned about the point ``about`` (room frame), as by wrong axes."""

    soak = ()

    quaternion_xyzw: Quaternion = Field([SIN_45, 0.0, 0.0, SIN_45], description="rotation")
    about: Vector3 = Field([0.0, 0.0, 0.0], description="centre of the rotation, room frame, m")

    def changed(self, person: Person, joints: Sequence[str]) -> Person | None:
        """Return the person turned."""
        turn = Pose(quaternion_xyzw=self.quaternion_xyzw).matrix()[:3, :3]
        about = np.asarray(self.about)
        return replace(person, positions=(person.positions - about) @ turn.T + about)


class Mirror(PeopleFault):
    """All people are mirrored at the plane y = ``at_y`` of the room: left and right are swapped."""

    soak = ()

    at_y: float = Field(0.0, ge=-1000, le=1000, description="y of the mirror plane, m")

    def changed(self, person: Person, joints: Sequence[str]) -> Person | None:
        """Return the person mirrored."""
        over, plane = np.array([1.0, -1.0, 1.0]), np.array([0.0, 2.0 * self.at_y, 0.0])
        return replace(person, positions=person.positions * over + plane)


class IdentitySwap(FaultSettings):
    """People's ids rotate; a single person gets a new id."""

    deceives = True


class Rename(PeopleFault):
    """The ``person`` with this id gets the id ``to``."""

    soak = ("person=2,to=1",)
    deceives = True

    person: int = Field(1, description="person with this id")
    to: int = Field(2000, ge=0, le=65535, description="the new id")

    def changed(self, person: Person, joints: Sequence[str]) -> Person | None:
        """Return the person with the new id."""
        return replace(person, id=self.to) if person.id == self.person else person


class Alternate(FaultSettings):
    """The people ``person`` and ``other`` share the id ``person``, which shows them in turn."""

    deceives = True

    person: int = Field(1, description="person with this id")
    other: int = Field(2, description="id of the other person, who gets that id")
    captures: int = Field(
        1, ge=1, le=1000, description="number of consecutive captures of each person"
    )


class Occlude(FaultSettings):
    """Only ``cameras`` see people: boxes ([x, y, x, y, height]) and bodies hide them.

    A person who is found again gets another id with the probability ``rename``.
    """

    soak = ()

    cameras: list[Vector3] = Field(
        [[-6.0, -6.0, 2.8]], min_length=1, description="positions of cameras, room frame, m"
    )
    boxes: list[Annotated[list[Metres], Field(min_length=5, max_length=5)]] = Field(
        [], description="boxes that hide people: [x, y, x, y, height], m"
    )
    rename: float = Field(
        0.0, ge=0, le=1, description="chance that a person found again has another id"
    )


class Vanish(NamedPeopleFault):
    """All people (or the ``person`` with this id) are missing; the source still sees the room."""

    deceives = True

    def changed(self, person: Person, joints: Sequence[str]) -> Person | None:
        """Return the person unless vanished."""
        return None if self.concerns(person) else person


class Hide(NamedPeopleFault):
    """The named ``joints`` of all people (or of the ``person`` with this id) are not observed."""

    soak = ()

    joints: list[str] = Field(min_length=1, description="names of the joints that are not observed")

    def changed(self, person: Person, joints: Sequence[str]) -> Person | None:
        """Return the person without the hidden joints."""
        if not self.concerns(person):
            return person
        hidden = np.isin(joints, self.joints)
        positions = np.where(hidden[:, None], np.nan, person.positions)
        return replace(person, positions=positions, observed=person.observed & ~hidden)


class Blind(FaultSettings):
    """The source reports that it does not see the room."""


class ClockDrift(FaultSettings):
    """The source's clock runs fast by ``ppm`` parts per million; the gained offset stays."""

    soak = ("ppm=400",)

    ppm: float = Field(
        1000.0, ge=-100_000, le=100_000, description="rate error of its clock, parts per million"
    )


class ClockJump(FaultSettings):
    """The source's clock is off by ``offset_s``, then correct again."""

    soak = ("offset_s=-3600", "offset_s=3600", "offset_s=0.5")

    offset_s: float = Field(-1.0, ge=-1e6, le=1e6, description="size of the jump of its stamps")
    renumber: int = Field(
        0,
        ge=-1_000_000,
        le=0,
        description="change of the scenes' sequence numbers, as after a restart",
    )


SOURCE_FAULTS: dict[str, type[FaultSettings]] = {
    "drop": Drop,
    "delay": GrowingDelay,
    "jitter": Jitter,
    "freeze": Freeze,
    "duplicate": Duplicate,
    "reorder": Reorder,
    "nan": Nan,
    "teleport": Teleport,
    "identity_swap": IdentitySwap,
    "vanish": Vanish,
    "blind": Blind,
    "clock_drift": ClockDrift,
    "clock_jump": ClockJump,
    "made_up": MadeUp,
    "alternate": Alternate,
    "rename": Rename,
    "zero": Zero,
    "rotate": Rotate,
    "mirror": Mirror,
    "occlude": Occlude,
    "hide": Hide,
}
