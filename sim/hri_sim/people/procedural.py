"""A room with procedural people: a source that needs no recording (``kind: procedural``).

Everything is a function of time and the seed, so scenes do not depend on polling times, and a
script plays identically at any speed.
"""

import math
from pathlib import Path
from typing import Any, Literal, Self

import numpy as np
from pydantic import Field, model_validator

from hri_predict.base.arrays import Bools, Floats
from hri_predict.base.errors import ConfigError
from hri_predict.base.files import YAML_ENDINGS
from hri_predict.base.geometry import transform
from hri_predict.base.settings import MIN_RATE_HZ, Pose, Region, validated
from hri_predict.contracts.joint_map import JointMap, load_joint_map
from hri_predict.contracts.scene import Person, Scene
from hri_predict.contracts.source import SourceSettings
from hri_sim.people.script import PersonSettings, Timeline
from hri_sim.people.tracker import Wander, delivered_by

_SWAY_M = 0.006  # amplitude of quiet standing: a centimetre or so of travel
_SWAY_HZ = (0.13, 0.31, 0.53)
_LEAST_JOINTS = 4  # fewest joints in view at which a sensor sees a body

# A person comes in, walks up to the robot at the origin, reaches into its workspace, steps back and
# leaves by the same way.
DEMO: list[dict[str, Any]] = [
    {
        "start": [3.6, 2.4],
        "enter_s": 1.0,
        "script": [
            {"do": "walk", "via": [[2.4, 1.2]], "to": [1.05, 0.65]},
            {"do": "wait", "seconds": 1.0},
            {"do": "reach", "hand": "right", "to": [0.65, 0.4, 0.95], "hold_s": 1.5},
            {"do": "walk", "to": [1.9, 1.2], "speed_m_s": 0.6, "backwards": True},
            {"do": "wait", "seconds": 1.0},
            {"do": "walk", "to": [4.7, 3.2]},
            {"do": "leave", "seconds": 2.0},
        ],
    }
]


class ProceduralSettings(SourceSettings):
    """``source:`` of ``kind: procedural``; the scripts' points are in the source's frame."""

    kind: Literal["procedural"]
    room_from_source: Pose = Field(Pose(), description="pose of the source's frame in the room")
    people: list[PersonSettings] = Field(
        [validated(PersonSettings, person, "demo") for person in DEMO],
        max_length=16,
        description="people and their actions; default: a person who walks up and reaches out",
    )
    keeps_ids: bool = Field(True, description="an id that reappears is the same person")
    rate_hz: float = Field(30.0, ge=MIN_RATE_HZ, le=240, description="scenes per second")
    seed: int = Field(0, ge=0, description="random seed")
    latency_s: float = Field(0.0, ge=0, le=2, description="time from capture to arrival")
    noise_m: float = Field(0.0, ge=0, le=0.2, description="noise: standard deviation per axis")
    wander_m: float = Field(
        0.0, ge=0, le=0.2, description="noise correlated in time: standard deviation per axis"
    )
    wander_s: float = Field(0.3, gt=0, le=10, description="correlation time of wander_m")
    stamp_jitter_s: float = Field(0.0, ge=0, le=1, description="maximum random delay of stamps")
    dropout: float = Field(0.0, ge=0, lt=1, description="chance that a joint is not observed")
    joint_map: str | None = Field(
        None,
        description="deliver only the joints of this tracker (a joint map's name or file)",
    )
    duration_s: float | None = Field(None, gt=0, description="end of the source; default: never")

    @property
    def known_places(self) -> list[list[float]]:
        """Known places, including the people's starting points."""
        room = self.room_from_source.matrix()
        starts = [room @ [*person.start, 0.0, 1.0] for person in self.people]
        return [*super().known_places, *(start[:3].tolist() for start in starts)]

    @model_validator(mode="after")
    def _stamps_in_order(self) -> Self:
        if self.stamp_jitter_s * self.rate_hz >= 1:
            raise ValueError(
                f"stamp_jitter_s {self.stamp_jitter_s:g} would put captures out of order; give "
                f"less than one period, {1 / self.rate_hz:.3g} s"
            )
        return self


class ProceduralSource:
    """See ``hri_predict.contracts.source.Source``."""

    settings_model = ProceduralSettings

    def __init__(self, settings: ProceduralSettings, base_dir: Path | None = None) -> None:
        """Compute the timelines of the scripts.

        Raises:
            ConfigError: a body cannot perform a script, two people share an id, or the joint map
                does not exist.
        """
        self.joint_map = _joint_map(settings.joint_map, base_dir)
        self._delivered: Bools = np.asarray((self.joint_map.weights > 0).any(0))
        self.rate_hz = settings.rate_hz
        self.declares_noise = settings.noise_m > 0 or settings.wander_m > 0
        self._settings = settings
        self._room = settings.room_from_source.matrix()
        self._start_ns: int | None = None
        self._next = 0
        self._people: list[_Actor] = []
        for i, person in enumerate(settings.people):
            where = f"source.people.{i}"
            actor = _Actor(
                person_id=person.id if person.id is not None else i + 1,
                person=person,
                where=where,
                settings=settings,
                index=i,
            )
            if actor.id in [other.id for other in self._people]:
                raise ConfigError(f"{where}.id: {actor.id} is used twice; give another")
            self._people.append(actor)

    def open(self, start_ns: int) -> None:
        """Start: the first capture is at ``start_ns``."""
        self._start_ns, self._next = start_ns, 0
        for actor in self._people:
            actor.begin()

    def next_ns(self) -> int | None:
        """Arrival of the next scene, ``None`` after the last."""
        if self._start_ns is None or self._over(self._next):
            return None
        return self._stamp_ns(self._next) + round(self._settings.latency_s * 1e9)

    def poll(self, now_ns: int) -> Scene | None:
        """Return the oldest unread scene that has arrived by ``now_ns``."""
        due_ns = self.next_ns()
        if due_ns is None or due_ns > now_ns:
            return None
        scene = self._scene(self._next)
        self._next += 1
        return scene

    def close(self) -> None:
        """Do nothing: the source holds no resources."""
        self._start_ns = None

    def truth(self, now_ns: int) -> dict[int, tuple[Floats, Bools]]:
        """Return the true people: id -> ((21, 3) canonical joints in the room, (21,) known).

        Noise, latency, dropout and the field of view have no effect; ``open`` must have been
        called.
        """
        assert self._start_ns is not None
        seconds = (now_ns - self._start_ns) * 1e-9
        there = {actor.id: actor.joints(seconds) for actor in self._people}
        known = np.ones(len(self.joint_map.source_joints), dtype=np.bool_)
        return {i: (transform(self._room, j), known) for i, j in there.items() if j is not None}

    def _over(self, k: int) -> bool:
        end_s = self._settings.duration_s
        return end_s is not None and k / self.rate_hz >= end_s

    def _stamp_ns(self, k: int) -> int:
        assert self._start_ns is not None
        capture_ns = self._start_ns + round(k * 1e9 / self.rate_hz)
        if self._settings.stamp_jitter_s == 0:
            return capture_ns
        rng = np.random.default_rng([self._settings.seed, len(self._people), k])
        return capture_ns + int(rng.uniform(0.0, self._settings.stamp_jitter_s) * 1e9)

    def _scene(self, k: int) -> Scene:
        seen = (self._seen(actor, k) for actor in self._people)
        people = tuple(person for person in seen if person is not None)
        return Scene(self._stamp_ns(k), k, True, people)

    def _seen(self, actor: "_Actor", k: int) -> Person | None:
        """Return one person of scene ``k`` as seen by the sensor; ``None`` if not seen."""
        joints = actor.joints(round(k * 1e9 / self.rate_hz) * 1e-9)
        if joints is None:
            return None
        joints = transform(self._room, joints)
        observed = self._delivered.copy()
        if self._settings.field_of_view is not None:
            observed &= inside(self._settings.field_of_view, joints)
            if np.count_nonzero(observed) < _LEAST_JOINTS:
                return None
        if self._settings.noise_m > 0 or self._settings.dropout > 0:
            rng = np.random.default_rng([self._settings.seed, actor.index, k])
            joints = joints + rng.normal(0.0, self._settings.noise_m, joints.shape)
            observed &= rng.random(len(joints)) >= self._settings.dropout
        if self._settings.wander_m > 0:
            joints = joints + actor.wander.next(len(joints))
        return Person(actor.id, np.where(observed[:, None], joints, np.nan), observed)


class _Actor:
    """A person's script and individual sway."""

    def __init__(
        self,
        *,
        person_id: int,
        person: PersonSettings,
        where: str,
        settings: ProceduralSettings,
        index: int,
    ) -> None:
        self.id, self.index = person_id, index
        self._settings = settings
        self.begin()
        rng = np.random.default_rng([settings.seed, index])
        self._timeline = Timeline(person, where, left_first=bool(rng.integers(2)))
        self._amplitudes = rng.uniform(0.3, 1.0, (len(_SWAY_HZ), 2)) * _SWAY_M / len(_SWAY_HZ)
        self._phases = rng.uniform(0.0, 2 * math.pi, (len(_SWAY_HZ), 2))
        self._rates = 2 * math.pi * np.array(_SWAY_HZ)[:, None]

    def begin(self) -> None:
        """Start again, with the same errors."""
        settings = self._settings
        self.wander = Wander(
            settings.wander_m,
            settings.wander_s,
            settings.rate_hz,
            seed=[settings.seed, self.index, 0, 1],  # a fourth number: no capture's seed
        )

    def joints(self, t: float) -> Floats | None:
        """Return (21, 3) canonical joints ``t`` seconds after the start; ``None`` if absent."""
        sway = (self._amplitudes * np.sin(self._rates * t + self._phases)).sum(axis=0)
        return self._timeline.joints(t, sway)


def _joint_map(name: str | None, base_dir: Path | None) -> JointMap:
    """Return the canonical joints, or the subset that a tracker delivers."""
    if name is None:
        return load_joint_map("canonical")
    beside = base_dir / name if base_dir is not None else Path(name)
    is_file = name.endswith(YAML_ENDINGS) and beside.is_file()
    return delivered_by(load_joint_map(str(beside) if is_file else name))


def inside(region: Region, points: Floats) -> Bools:
    """Return which of (..., 3) points lie in a region: height range, then the even-odd rule."""
    x, y, z = np.moveaxis(points, -1, 0)
    result = np.zeros(x.shape, dtype=np.bool_)
    corners = np.asarray(region.polygon)
    for (ax, ay), (bx, by) in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        if ay != by:
            crosses = ((ay > y) != (by > y)) & (x < ax + (y - ay) * (bx - ax) / (by - ay))
            result ^= crosses
    return np.asarray(result & (z >= region.z_min) & (z <= region.z_max))
