"""Plays a recording as a source (``kind: recording``): motion files, and the node's own MCAP.

A motion file has one person, who is always in view. An MCAP recording plays as it was received:
several people with their ids, and blind, late and lost scenes.
"""

import bisect
import copy
import itertools
import logging
import os
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
import yaml
from pydantic import Field

from hri_predict.base.arrays import Bools, Floats
from hri_predict.base.errors import ConfigError, RecordingError
from hri_predict.base.files import YAML_ENDINGS
from hri_predict.base.settings import MAX_RATE_HZ, MIN_RATE_HZ, Pose, Vector3
from hri_predict.contracts.joint_map import JointMap, load_joint_map
from hri_predict.contracts.link import Received
from hri_predict.contracts.scene import Scene
from hri_predict.contracts.source import SourceSettings
from hri_predict.recording import Recording, open_recording, placed
from hri_predict.recording.cutting import between, decimated
from hri_predict.recording.format_table import ANY_ENDING
from hri_predict.recording.plausibility import check_size
from hri_predict.recording.recording import SELF_EXPLAINED

log = logging.getLogger(__name__)


class RecordingSettings(SourceSettings):
    """``source:`` of ``kind: recording``."""

    kind: Literal["recording"]
    room_from_source: Pose = Field(Pose(), description="pose of the recording's frame in the room")
    keeps_ids: bool = Field(
        True, description="false for a recording of a tracker that may give an id to another person"
    )
    path: str = Field(min_length=1, description=ANY_ENDING)
    place: Vector3 | None = Field(
        None, description="[x, y, yaw] of the recording's start in the room"
    )
    start_s: float = Field(0.0, ge=0, description="start this far into the recording")
    end_s: float | None = Field(None, gt=0, description="end this far into the recording")
    loop: bool = Field(False, description="start again at the end")
    loop_gap_s: float = Field(
        1.0, ge=0, le=60, description="seconds of empty room between two loops"
    )
    rate_hz: float | None = Field(
        None,
        ge=MIN_RATE_HZ,
        le=MAX_RATE_HZ,
        description="rate to play at, by leaving out frames; default: the file's own",
    )
    person: int = Field(1, ge=0, le=65535, description="id of the person in a motion file")
    noise_m: float = Field(
        0.0, ge=0, le=0.2, description="noise to add: standard deviation per axis"
    )
    seed: int = Field(0, ge=0, description="random seed of the noise")
    unit_m: float | None = Field(
        None, gt=0, le=1000, description="metres per unit of a motion file"
    )
    axes: Annotated[list[str], Field(min_length=3, max_length=3)] | None = Field(
        None, description="axes of the motion file that point forward, left and up"
    )
    joint_map: str | None = Field(
        None, description="a joint map's name or file; default: found by the joints' names"
    )
    topic: str | None = Field(
        None, min_length=1, description="topic of the people in a ROS bag; default: the only one"
    )
    frame: str | None = Field(
        None,
        min_length=1,
        description="frame of a ROS bag whose pose is room_from_source; default: the topmost one",
    )

    @property
    def known_places(self) -> list[list[float]]:
        """Known places, including the start of the recording."""
        return [*super().known_places, *([[*self.place[:2], 0.0]] if self.place else [])]


class RecordingSource:
    """See ``hri_predict.contracts.source.Source``.

    Attributes:
        recording: the recording, read and placed; ``recording.note`` states whether the file was
            cut.
    """

    settings_model = RecordingSettings

    def __init__(self, settings: RecordingSettings, base_dir: Path | None = None) -> None:
        """Read the recording; a relative path starts at ``base_dir`` or the current folder.

        Raises:
            RecordingError: it cannot be read.
            ConfigError: it does not contain the configured part or rate, or the configuration sets
                units or axes that the recording itself defines.
        """
        read = partial(
            open_recording,
            _find(settings.path, base_dir),
            person=settings.person,
            axes=settings.axes,
            joint_map=_own_map(settings.joint_map, base_dir),
            topic=settings.topic,
            frame=settings.frame,
        )
        recording = read(unit_m=settings.unit_m)
        _check_own(recording, settings)
        check_size(recording, lambda unit_m: read(unit_m=unit_m))
        if note := _unused_pose(recording, settings.room_from_source):
            log.warning("recording %s: %s", recording.path, note)
        if recording.note:
            log.warning("recording %s: %s", recording.path, recording.note)
        recording = placed(_part(recording, settings), settings.room_from_source, settings.place)
        self.recording = _decimated(recording, settings)
        self.joint_map = recording.joint_map
        self.rate_hz = self.recording.rate_hz
        self.declares_noise = recording.declares_noise or settings.noise_m > 0
        self._settings = settings
        self._scenes, self._arrival = self.recording.scenes, self.recording.arrival_ns
        self._true_ns = _true_times(self.recording)
        self._zero_ns = _zero(recording.kind, self._scenes[0], self._arrival[0])
        self._start_ns: int | None = None
        self._next = 0
        # One loop: the scenes, then empty ones.
        self._gap = round(settings.loop_gap_s * self.rate_hz) if settings.loop else 0
        self._period_ns = round(1e9 / self.rate_hz)
        span_ns = self._arrival[-1] - self._arrival[0]
        self._loop_ns = span_ns + (self._gap + 1) * self._period_ns

    def twin(self) -> "RecordingSource":
        """See ``contracts.source.HasTwin``; both share the recording, which is never modified."""
        twin = copy.copy(self)
        twin.close()
        return twin

    def open(self, start_ns: int) -> None:
        """Start: the first scene is captured at ``start_ns``."""
        self._start_ns, self._next = start_ns, 0

    def next_ns(self) -> int | None:
        """Arrival of the next scene; ``None`` after the last."""
        if self._start_ns is None:
            return None
        loop, k = divmod(self._next, len(self._scenes) + self._gap)
        if loop > 0 and not self._settings.loop:
            return None
        return self._shift_ns(loop) + self._arrival_ns(k)

    def poll(self, now_ns: int) -> Scene | None:
        """Return the oldest unread scene that has arrived by ``now_ns``."""
        due_ns = self.next_ns()
        if due_ns is None or due_ns > now_ns:
            return None
        loop, k = divmod(self._next, len(self._scenes) + self._gap)
        shift_ns = self._shift_ns(loop)
        if k < len(self._scenes):
            scene = self._noisy(self._scenes[k])
            sequence = scene.sequence
        else:
            after = k + 1 - len(self._scenes)
            last = self._scenes[-1]
            scene = Scene(last.stamp_ns + after * self._period_ns, 0, True, ())
            sequence = last.sequence + after
        span = self._scenes[-1].sequence - self._scenes[0].sequence + 1 + self._gap
        self._next += 1
        return replace(scene, stamp_ns=scene.stamp_ns + shift_ns, sequence=sequence + loop * span)

    def close(self) -> None:
        """Do nothing: the source holds no resources."""
        self._start_ns = None

    @property
    def received(self) -> Sequence[tuple[str, Received]]:
        """Return the controllers' recorded messages (MCAP only), as if received in this run.

        Times are on the node's clock after ``open``, and before that on the recording's.
        """
        shift_ns = 0 if self._start_ns is None else self._shift_ns(0)
        return [
            (link, Received(r.message, r.received_ns + shift_ns))
            for link, r in self.recording.received
        ]

    @property
    def last_latch_id(self) -> int | None:
        """See ``RecordingInfo``: recorded Acknowledges name the latch ids of this run, too."""
        return self.recording.last_latch_id

    def truth(self, now_ns: int) -> dict[int, tuple[Floats, Bools]]:
        """Return the true people: id -> ((21, 3) canonical joints in the room, (21,) known).

        Positions between two captures are interpolated linearly, without added noise. The result is
        empty in the gap between loops, before the start and after the end. ``open`` must have been
        called.
        """
        assert self._start_ns is not None
        since_ns = now_ns - self._start_ns
        loop = max(0, since_ns // self._loop_ns) if self._settings.loop else 0
        at_ns = now_ns - self._shift_ns(loop)
        times_ns = self._true_ns
        k = bisect.bisect_right(times_ns, at_ns) - 1
        if k < 0 or at_ns > times_ns[-1] + self._period_ns:
            return {}
        next_k = min(k + 1, len(self._scenes) - 1)
        before, after = self._scenes[k], self._scenes[next_k]
        span_ns = times_ns[next_k] - times_ns[k]
        part = 0.0 if span_ns <= 0 else (at_ns - times_ns[k]) / span_ns
        later = {person.id: person for person in after.people}
        found = {}
        for person in before.people:
            joints, known = self.joint_map.map(person.positions, person.observed)
            if person.id in later:
                then = later[person.id]
                end, end_known = self.joint_map.map(then.positions, then.observed)
                joints, known = joints + part * (end - joints), known & end_known
            found[person.id] = joints, known
        return found

    def _shift_ns(self, loop: int) -> int:
        assert self._start_ns is not None
        return self._start_ns - self._zero_ns + loop * self._loop_ns

    def _arrival_ns(self, k: int) -> int:
        if k < len(self._scenes):
            return self._arrival[k]
        return self._arrival[-1] + (k + 1 - len(self._scenes)) * self._period_ns

    def _noisy(self, scene: Scene) -> Scene:
        if self._settings.noise_m == 0:
            return scene
        rng = np.random.default_rng([self._settings.seed, self._next])
        noise = self._settings.noise_m
        people = tuple(
            replace(p, positions=p.positions + rng.normal(0.0, noise, p.positions.shape))
            for p in scene.people
        )
        return replace(scene, people=people)


def _own_map(name: str | None, base_dir: Path | None) -> JointMap | None:
    """Return the configured joint map; a relative path starts at ``base_dir``."""
    if name is None:
        return None
    return load_joint_map(str(_find(name, base_dir)) if name.endswith(YAML_ENDINGS) else name)


def _find(path: str, base_dir: Path | None) -> Path:
    """Resolve a relative path in the configuration's folder, otherwise in the current folder."""
    beside = base_dir / path if base_dir is not None else Path(path)
    return beside if os.path.exists(beside) else Path(path)  # accepts a name that is too long


def _zero(kind: str, first: Scene, arrival_ns: int) -> int:
    """Return the recording's start time: the first arrival, or the first capture if later.

    The source of an MCAP recording may have had its own clock. Captures then keep their offset from
    the arrivals.
    """
    if kind == "mcap" and abs(arrival_ns - first.stamp_ns) < 1_000_000_000:
        return min(arrival_ns, first.stamp_ns)
    return arrival_ns


def _true_times(recording: Recording) -> list[int]:
    """Return the time of each scene on the arrivals' clock: that of its capture, if possible."""
    captures = [scene.stamp_ns for scene in recording.scenes]
    same_clock = abs(recording.arrival_ns[0] - captures[0]) < 1_000_000_000
    in_order = all(a < b for a, b in itertools.pairwise(captures))
    return captures if same_clock and in_order else list(recording.arrival_ns)


def _check_own(recording: Recording, settings: RecordingSettings) -> None:
    """Refuse units and axes that would be ignored."""
    for key in ("unit_m", "axes"):
        if getattr(settings, key) is not None and recording.kind in SELF_EXPLAINED:
            raise ConfigError(
                f"source.{key}: has no effect on {recording.path}, which states its own; remove it"
            )


def _unused_pose(recording: Recording, pose: Pose) -> str:
    """Return a note if the pose has no effect and differs from the recorded one, otherwise ""."""
    if not recording.in_room or np.allclose(pose.matrix(), np.eye(4)):
        return ""
    try:
        recorded = Pose.model_validate(
            yaml.safe_load(recording.config)["source"]["room_from_source"]
        )
    except (yaml.YAMLError, ValueError, TypeError, KeyError):
        recorded = Pose()
    if np.allclose(pose.matrix(), recorded.matrix()):
        return ""
    return (
        "source.room_from_source has no effect, because its scenes were recorded in the room "
        "frame; move them with place"
    )


def _part(recording: Recording, settings: RecordingSettings) -> Recording:
    """Return the part from ``start_s`` to ``end_s``."""
    try:
        return between(recording, settings.start_s, settings.end_s)
    except RecordingError as error:
        raise ConfigError(f"source.start_s, source.end_s: {error}") from None


def _decimated(recording: Recording, settings: RecordingSettings) -> Recording:
    """Leave out frames so that the rate of the others is as close to ``rate_hz`` as possible."""
    if settings.rate_hz is None:
        return recording
    if recording.kind == "mcap" and settings.rate_hz != recording.rate_hz:
        raise ConfigError("source.rate_hz: an MCAP recording plays as it was received; remove it")
    try:
        return decimated(recording, settings.rate_hz)
    except RecordingError as error:
        raise ConfigError(f"source.rate_hz: {error}") from None
