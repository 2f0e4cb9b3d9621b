"""One approach as a source (``kind: approach``): motions placed on the floor.

``hri-predict simulate`` fills in motions and places. A configuration that contains them plays that
approach through the node (``hri-predict run``), so that a user can examine a contact listed in a
table.
"""

import zlib
from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache, partial
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, field_validator

from hri_predict.base.arrays import Bools, Floats
from hri_predict.base.errors import ConfigError, nearest
from hri_predict.base.files import YAML_ENDINGS
from hri_predict.base.geometry import transform
from hri_predict.base.settings import MIN_RATE_HZ, Pose, Vector3
from hri_predict.base.skeleton import JOINTS
from hri_predict.contracts.joint_map import JointMap, load_joint_map
from hri_predict.contracts.scene import Person, Scene
from hri_predict.contracts.source import SourceSettings
from hri_sim.people.tracker import Wander, delivered_by
from hri_sim.referee import TruePeople
from hri_sim.simulation.motion import Motion, load_motion

_SAME_NS = 1_000_000  # captures of several people nearer than this are one scene


class ApproachSettings(SourceSettings):
    """``source:`` of ``kind: approach``."""

    kind: Literal["approach"]
    room_from_source: Pose = Field(Pose(), description="pose of the source's frame in the room")
    keeps_ids: bool = Field(True, description="an id that reappears is the same person")
    motions: list[str] = Field(
        [], max_length=16, description="recordings or procedural:SEED; simulate fills them in"
    )
    places: list[Vector3] = Field(
        [], description="[x, y, yaw] of each motion: its frame is turned about z, then moved"
    )
    joint_map: str | None = Field(
        None, description="a joint map's name or file; default: found by the joints' names"
    )
    tracker: str | None = Field(
        None,
        description="deliver only the joints of this tracker (a joint map's name or file)",
    )
    lacks: list[str] = Field([], description="canonical joints that the tracker never delivers")
    hidden: list[str] = Field(
        [], description="canonical joints that the tracker knows but does not see here"
    )
    noise_m: float = Field(0.0, ge=0, le=0.2, description="noise: standard deviation per axis")
    wander_m: float = Field(
        0.0, ge=0, le=0.2, description="noise correlated in time: standard deviation per axis"
    )
    wander_s: float = Field(0.3, gt=0, le=10, description="correlation time of wander_m")
    lost_limbs: float = Field(
        0.0, ge=0, le=0.9, description="share of time in which the tracker loses each arm and leg"
    )
    lost_s: float = Field(0.2, gt=0, le=10, description="mean duration of such a loss, s")
    error_m: float = Field(
        0.0, ge=0, le=3, description="position error of each person, as stated by the tracker"
    )
    lead_in_s: float = Field(3.0, ge=0, le=60, description="seconds of empty room at the start")
    rate_hz: float = Field(30.0, ge=MIN_RATE_HZ, le=240, description="maximum scenes per second")

    @field_validator("lacks", "hidden")
    @classmethod
    def _canonical_joints(cls, joints: list[str]) -> list[str]:
        for joint in joints:
            if joint not in JOINTS:
                raise ValueError(f"no canonical joint '{joint}'{nearest(joint, JOINTS)}")
        return joints


def exact(settings: ApproachSettings) -> ApproachSettings:
    """The same approach without errors: the true course."""
    clear: dict[str, Any] = {
        "tracker": None,
        "lacks": [],
        "hidden": [],
        "noise_m": 0.0,
        "wander_m": 0.0,
        "lost_limbs": 0.0,
        "error_m": 0.0,
    }
    return settings.model_copy(update=clear)


class ApproachSource:
    """See ``contracts.source.Source``. People have the ids 1, 2, ... in the order of motions."""

    settings_model = ApproachSettings

    def __init__(self, settings: ApproachSettings, base_dir: Path | None = None) -> None:
        """Read the motions; relative paths start at ``base_dir`` or the current folder.

        Raises:
            ConfigError: no motion is named, or the motions cannot be combined.
            RecordingError: a recording cannot be read.
        """
        if not settings.motions or len(settings.motions) != len(settings.places):
            raise ConfigError(
                "source: an approach needs motions and the same number of places; run "
                "'hri-predict simulate', which fills them in"
            )
        self._motions = [
            load_motion(name, settings.rate_hz, base_dir, settings.joint_map)
            for name in settings.motions
        ]
        self._captures = together(self._motions)
        room = settings.room_from_source.matrix()
        self._positions = [
            transform(
                room @ over_floor(place),
                motion.positions
                + noise(motion, settings.noise_m, settings.wander_m, settings.wander_s),
            )
            for motion, place in zip(self._motions, settings.places, strict=True)
        ]
        self.joint_map = map_of(self._motions, settings.tracker, base_dir, settings.lacks)
        self._delivered: Bools = np.asarray((self.joint_map.weights > 0).any(axis=0))
        self._delivered[[JOINTS.index(joint) for joint in settings.hidden]] = False
        self._observed = [
            motion.observed & self._delivered & kept(motion, settings.lost_limbs, settings.lost_s)
            for motion in self._motions
        ]
        self.rate_hz = self._motions[0].rate_hz
        self.declares_noise = settings.noise_m > 0 or settings.wander_m > 0
        self._error_m = settings.error_m
        self._exact = partial(ApproachSource, exact(settings), base_dir)
        self._truth: TruePeople | None = None
        self._empty = round(settings.lead_in_s * self.rate_hz)
        self._start_ns: int | None = None
        self._next = 0

    def open(self, start_ns: int) -> None:
        """Start: the first (empty) scene is captured at ``start_ns``."""
        self._start_ns, self._next, self._truth = start_ns, 0, None

    def next_ns(self) -> int | None:
        """Arrival of the next scene; ``None`` after the last."""
        if self._start_ns is None or self._next >= self._empty + len(self._captures):
            return None
        return self._capture_ns(self._next)

    def poll(self, now_ns: int) -> Scene | None:
        """Return the oldest unread scene that has arrived by ``now_ns``."""
        due_ns = self.next_ns()
        if due_ns is None or due_ns > now_ns:
            return None
        k, self._next = self._next, self._next + 1
        here = range(len(self._motions)) if k >= self._empty else ()
        people = tuple(
            Person(
                p + 1,
                self._positions[p][k - self._empty],
                self._observed[p][k - self._empty],
                error_m=self._error_m,
            )
            for p in here
        )
        return Scene(due_ns, k, True, people)

    def truth(self, now_ns: int) -> dict[int, tuple[Floats, Bools]]:
        """Return id -> canonical joints (J, 3) and which are known (J,), at ``now_ns``.

        Without noise, with all recorded joints; ``open`` must have been called, and successive
        times must not decrease.
        """
        assert self._start_ns is not None
        if self._truth is None:
            self._truth = TruePeople(self._exact())
            self._truth.open(self._start_ns)
        return self._truth.at(now_ns)

    def close(self) -> None:
        """Do nothing: the source holds no resources."""
        self._start_ns = self._truth = None

    def _capture_ns(self, k: int) -> int:
        assert self._start_ns is not None
        if k < self._empty:
            return self._start_ns + round(k * 1e9 / self.rate_hz)
        lead_ns = _lead_ns(self._empty, self.rate_hz)
        return self._start_ns + lead_ns + int(self._captures[k - self._empty])


@lru_cache(maxsize=64)
def noise(motion: Motion, noise_m: float, wander_m: float, wander_s: float) -> Floats:
    """Return noise (N, J, 3) in metres in the motion's own frame, the same at any place."""
    if noise_m == 0 and wander_m == 0:
        return np.zeros(3)
    seed = zlib.crc32(Path(motion.name).name.encode())
    found = np.random.default_rng([seed, 0]).normal(0.0, noise_m, motion.positions.shape)
    if wander_m > 0:
        wander = Wander(wander_m, wander_s, motion.rate_hz, [seed, 1])
        found += np.stack([wander.next(found.shape[1]) for _ in found])
    return found


_LIMBS = [
    [JOINTS.index(f"{side}_{joint}") for joint in joints]
    for joints in (("elbow", "wrist", "hand"), ("knee", "ankle", "foot"))
    for side in "lr"
]


@lru_cache(maxsize=64)
def kept(motion: Motion, share: float, mean_s: float) -> Bools:
    """Return (N, J) whether the tracker keeps a joint: arms and legs get lost for moments.

    Each limb alone is lost for ``share`` of the time, for ``mean_s`` seconds on average; the same
    at any place.
    """
    found = np.ones(motion.observed.shape, np.bool_)
    rng = np.random.default_rng([zlib.crc32(Path(motion.name).name.encode()), 2])
    ends = min(1.0, 1.0 / (mean_s * motion.rate_hz))
    begins = ends * share / (1.0 - share)
    for limb in _LIMBS:
        lost = False
        for k, chance in enumerate(rng.random(len(found)).tolist()):
            lost = chance >= ends if lost else chance < begins
            found[k, limb] = not lost
    return found


@lru_cache(maxsize=1)
def _canonical() -> JointMap:
    return load_joint_map("canonical")


def map_of(
    motions: Sequence[Motion],
    tracker: str | None,
    base_dir: Path | None,
    without: Sequence[str] = (),
) -> JointMap:
    """Return a tracker that delivers the joints of the recordings except ``without``."""
    whole = _canonical()
    if tracker is not None:
        beside = (base_dir or Path()) / tracker
        whole = delivered_by(
            load_joint_map(str(beside) if tracker.endswith(YAML_ENDINGS) else tracker)
        )
    recorded = np.any([motion.observed.any(axis=0) for motion in motions], axis=0)
    recorded &= ~np.isin(JOINTS, list(without))
    lacks = (whole.weights[:, ~recorded] != 0).any(axis=1)
    return replace(whole, weights=np.where(lacks[:, None], 0.0, whole.weights))


def together(motions: list[Motion]) -> NDArray[np.int64]:
    """Return (N,) capture times common to all motions, up to the end of the shortest.

    Raises:
        ConfigError: their rates differ.
    """
    count = min(len(motion.capture_ns) for motion in motions)
    captures = motions[0].capture_ns[:count]
    for motion in motions[1:]:
        apart = np.abs(motion.capture_ns[: len(captures)] - captures) > _SAME_NS
        if apart[:-1].any():  # the last of a recording may come early
            raise ConfigError(
                f"recordings {motions[0].name} ({motions[0].rate_hz:g} Hz) and {motion.name} "
                f"({motion.rate_hz:g} Hz): several people need the same rate; lower source.rate_hz"
            )
        captures = captures[: len(captures) - int(apart[-1])]
    return captures


def lasts_ns(motions: list[Motion], lead_in_s: float) -> int:
    """Return the time in ns from the start of an approach to its last capture."""
    rate_hz = motions[0].rate_hz
    return _lead_ns(round(lead_in_s * rate_hz), rate_hz) + int(together(motions)[-1])


def _lead_ns(empty: int, rate_hz: float) -> int:
    """Return the time in ns of the first scenes, in which the room is empty."""
    return round(empty * 1e9 / rate_hz)


def over_floor(place: Sequence[float]) -> Floats:
    """Return the matrix (4, 4) of a turn about z by yaw, then a move by x and y."""
    x, y, yaw = place
    matrix = np.eye(4)
    matrix[:2, :2] = [[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]]
    matrix[:2, 3] = x, y
    return matrix
