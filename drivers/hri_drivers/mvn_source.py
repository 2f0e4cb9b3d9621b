"""``kind: mvn``: the network stream of Xsens MVN; see ``hri_drivers.mvn_codec`` for its datagrams.

A segment's position is that of its proximal joint (MVN User Manual MV0319P, 19.6.1 and 19.7); the
pelvis' is the middle of the hips'. Joint map ``xsens23`` says which is which. Type 02 is in metres
with z up, as MVN's manual has it; type 01 in centimetres with y up, z forward and x left. (The
protocol's clause 2.5.6 says centimetres of both.) A body of no human size tells of wrong units: its
scene does not see the room.

MVN tells of those who wear its sensors, and of nobody else: whether all who may come near do so,
must be configured (``sees_room``).
"""

import math
from pathlib import Path
from typing import Annotated, Literal, Self

import numpy as np
from pydantic import Field, model_validator

from hri_drivers.live_source import LiveSettings, LiveSource, Receiver, sender_joints
from hri_drivers.mvn_codec import (
    DEFAULT_PORT,
    EULER,
    MAX_DATAGRAM,
    QUATERNION,
    SEGMENTS,
    Assembler,
    MalformedDatagram,
    Pose,
    Sample,
    StreamSplitter,
    parse,
)
from hri_drivers.scene_inbox import Heard
from hri_drivers.stream_receiver import ALLOW_UNAUTHENTICATED, StreamServer, check_exposure
from hri_drivers.udp_receiver import UdpReceiver
from hri_predict.clock import Clock
from hri_predict.errors import ConfigError
from hri_predict.joint_map import METRES_PER_UNIT, JointMap
from hri_predict.scene import Person, Scene
from hri_predict.settings import MAX_RATE_HZ, MIN_RATE_HZ
from hri_predict.source import SourceCounters

MAX_SENDERS = 8  # MVN connects once for each character
TYPES = {"quaternion": QUATERNION, "euler": EULER}
UNITS = {QUATERNION: "m", EULER: "cm"}
AXES = {QUATERNION: ("x", "y", "z"), EULER: ("z", "x", "y")}
LIMBS = np.array([[15, 16, 17], [19, 20, 21], [8, 9, 10], [12, 13, 14]])  # legs, arms: indices
LIMB_M = (0.3, 1.4)
"""Of the longest limb, hip to ankle or shoulder to wrist: from children to giants."""


class MvnSettings(LiveSettings):
    """``source:`` of ``kind: mvn``."""

    kind: Literal["mvn"]
    joint_map: str = "xsens23"
    host: str = Field("127.0.0.1", description="address to hear on; default this machine alone")
    port: int = Field(DEFAULT_PORT, ge=0, le=65535)
    protocol: Literal["udp", "tcp"] = Field("udp", description="as in MVN's network streamer")
    allow_unauthenticated: bool = ALLOW_UNAUTHENTICATED
    sees_room: bool = Field(
        description="true: everybody who may come near wears sensors that are streamed; required"
    )
    type: Literal["quaternion", "euler"] = Field(
        "quaternion", description="which of MVN's streams: Position + Orientation (...)"
    )
    units: Literal["m", "cm"] | None = Field(None, description="default: m; with euler, cm")
    axes: Annotated[list[str], Field(min_length=3, max_length=3)] | None = Field(
        None, description="those that are forward, left, up; default [x, y, z], euler [z, x, y]"
    )
    sample_rate_hz: float | None = Field(
        None,
        ge=MIN_RATE_HZ,
        le=MAX_RATE_HZ,
        description="of the sample counter, where MVN streams at a lower rate_hz; default that",
    )
    stamp: Literal["time_code", "sample_counter"] = Field(
        "time_code", description="what says when a sample was captured"
    )

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        check_exposure(self.host, self.allow_unauthenticated)
        if self.sample_rate_hz is not None and self.sample_rate_hz < self.rate_hz:
            raise ValueError("sample_rate_hz is less than rate_hz; MVN streams no more than it has")
        return self

    @property
    def samples_per_scene(self) -> float:
        """By how much the sample counter rises from scene to scene."""
        return (self.sample_rate_hz or self.rate_hz) / self.rate_hz


class MvnDecoder:
    """Makes scenes of datagrams; see ``hri_drivers.live_source.Decoder``."""

    def __init__(
        self, settings: MvnSettings, joint_map: JointMap, counters: SourceCounters
    ) -> None:
        self._settings = settings
        self._joint_map = joint_map
        self._counters = counters
        self._step = settings.samples_per_scene
        self._assembler = Assembler(TYPES[settings.type], self._step, counters)
        self._heard_type = False
        self._session = -1
        self._counter = self._sequence = 0

    def reset(self) -> None:
        """Forget the sample under way."""
        self._assembler.reset()

    def feed(self, data: bytes, received_ns: int) -> list[Heard]:
        """The scene that one datagram completes, if any."""
        self._counters.packets += 1
        try:
            datagram = parse(data)
        except MalformedDatagram as error:
            self._counters.malformed += 1
            self._counters.note(f"MVN datagram: {error}")
            return []
        self._heard_type |= datagram.type == TYPES[self._settings.type]
        if not self._heard_type:
            self._counters.note(
                f"MVN streams type {datagram.type:02d}, not {TYPES[self._settings.type]:02d}; tick "
                f"Position + Orientation ({self._settings.type.capitalize()}) in MVN"
            )
        sample = self._assembler.add(datagram)
        return [] if sample is None else [Heard(self._scene(sample), self._assembler.session)]

    def _scene(self, sample: Sample) -> Scene:
        sees_room = self._settings.sees_room and self._is_human_sized(sample)
        if self._settings.stamp == "time_code":
            capture_ns = sample.time_code_ms * 1_000_000
        else:
            capture_ns = round(sample.counter / self._settings.rate_hz / self._step * 1e9)
        people = tuple(
            Person(number, pose.positions, pose.observed) for number, pose in sample.poses.items()
        )
        return Scene(capture_ns, self._count(sample.counter), sees_room, people)

    def _count(self, counter: int) -> int:
        """A number that rises by one from scene to scene, and by more where some are missing."""
        if self._session != self._assembler.session:
            self._session, self._sequence = self._assembler.session, 0
        else:
            risen = (counter - self._counter) & 0xFFFFFFFF
            self._sequence += max(1, round(risen / self._step))
        self._counter = counter
        return self._sequence

    def _is_human_sized(self, sample: Sample) -> bool:
        """Whether everybody is as long as people are; else the units are not as configured."""
        for number, pose in sample.poses.items():
            length = longest_limb(pose) * self._joint_map.scale_to_m
            if not LIMB_M[0] <= length <= LIMB_M[1]:
                self._counters.malformed += 1
                if math.isnan(length):
                    why = f"of MVN character {number} no limb was sent; look at the suit in MVN"
                else:
                    why = f"MVN character {number} has limbs of {length:.3g} m; correct 'units'"
                self._counters.note(why)
                return False
        return True


def longest_limb(pose: Pose) -> float:
    """Length of the longest arm or leg, in the stream's units; NaN if none was sent."""
    with np.errstate(all="ignore"):
        bones = np.linalg.norm(np.diff(pose.positions[LIMBS], axis=1), axis=2)
        return float(np.fmax.reduce(bones.sum(axis=1)))


class MvnSource(LiveSource):
    """See ``hri_predict.source.Source``."""

    settings_model = MvnSettings

    def __init__(
        self, settings: MvnSettings, base_dir: Path | None = None, clock: Clock | None = None
    ) -> None:
        """Nothing is opened yet.

        Raises:
            ConfigError: the joint map or the axes are wrong.
        """
        number = TYPES[settings.type]
        joint_map = sender_joints(settings, base_dir)
        if len(joint_map.source_joints) != SEGMENTS:
            raise ConfigError(
                f"source.joint_map: {joint_map.name} has {len(joint_map.source_joints)} joints; "
                f"MVN has {SEGMENTS} segments, as xsens23 names them"
            )
        joint_map = joint_map.with_units(METRES_PER_UNIT[settings.units or UNITS[number]])
        joint_map = joint_map.with_axes(settings.axes or AXES[number])
        counters = SourceCounters()
        self.receiver: UdpReceiver | StreamServer
        if settings.protocol == "udp":
            self.receiver = UdpReceiver(settings.host, settings.port, largest=MAX_DATAGRAM)
        else:
            self.receiver = StreamServer(
                settings.host, settings.port, StreamSplitter, MAX_SENDERS, counters
            )
        decoder = MvnDecoder(settings, joint_map, counters)
        receiver: Receiver = self.receiver
        super().__init__(settings, receiver, decoder, counters, joint_map, clock)
