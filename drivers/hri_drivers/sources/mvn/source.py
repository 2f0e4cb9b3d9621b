"""``kind: mvn``: the network stream of Xsens MVN; ``codec`` defines its datagrams.

A segment's position is that of its proximal joint (MVN User Manual MV0319P, 19.6.1 and 19.7); that
of the pelvis is the middle of the hips. Joint map ``xsens23`` names them. Type 02 is in metres with
z up, according to MVN's manual; type 01 is in centimetres with y up, z forward and x left. (Clause
2.5.6 of the protocol says centimetres for both.) A body of inhuman size means wrong units: the
source then reports that it does not see the room.

MVN reports only people who wear its sensors. ``sees_room`` states whether all people nearby wear
them.
"""

import math
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, ClassVar, Literal, Self

import numpy as np
from pydantic import Field, model_validator

from hri_drivers.sources.live import LiveSettings, LiveSource, sender_joints
from hri_drivers.sources.mvn.codec import (
    DEFAULT_PORT,
    EULER,
    MAX_DATAGRAM,
    QUATERNION,
    SEGMENTS,
    Assembler,
    MalformedDatagram,
    MvnPose,
    Sample,
    StreamSplitter,
    parse,
)
from hri_drivers.sources.mvn.second_sender import NOTE, SecondSender
from hri_drivers.sources.one_sender import OneSender
from hri_drivers.sources.sent import SentPerson, SentScene
from hri_drivers.sources.tcp import ALLOW_UNAUTHENTICATED, StreamServer, check_exposure
from hri_predict.base.clock import Clock
from hri_predict.base.errors import ConfigError
from hri_predict.base.quantities.safe_side import Safety, harmless
from hri_predict.base.settings import MAX_RATE_HZ, MIN_RATE_HZ
from hri_predict.contracts.joint_map import METRES_PER_UNIT, JointMap
from hri_predict.contracts.source import SourceCounters

MAX_SENDERS = 8  # MVN connects once for each character
TYPES = {"quaternion": QUATERNION, "euler": EULER}
UNITS = {QUATERNION: "m", EULER: "cm"}
AXES = {QUATERNION: ("x", "y", "z"), EULER: ("z", "x", "y")}
LIMBS = np.array([[15, 16, 17], [19, 20, 21], [8, 9, 10], [12, 13, 14]])  # legs, arms: indices
LIMB_M = (0.3, 1.4)
"""Range of the longest limb, hip to ankle or shoulder to wrist: from children to giants."""


class MvnSettings(LiveSettings):
    """``source:`` of ``kind: mvn``."""

    kind: Literal["mvn"]
    joint_map: str = Field("xsens23", description="joint map of MVN's segments, or your own map")
    keeps_ids: bool = Field(True, description="a suit that returns is the same person")  # a suit's
    host: str = Field("127.0.0.1", description="address to listen on; default: this machine only")
    port: int = Field(DEFAULT_PORT, ge=0, le=65535, description="port that MVN sends to")
    protocol: Literal["udp", "tcp"] = Field("udp", description="as set in MVN's network streamer")
    allow_unauthenticated: bool = ALLOW_UNAUTHENTICATED
    sees_room: bool = Field(
        description="true only if every person who can come near wears streamed sensors; required"
    )
    type: Literal["quaternion", "euler"] = Field(
        "quaternion", description="MVN's stream: Position + Orientation (Quaternion or Euler)"
    )
    units: Literal["m", "cm"] | None = Field(None, description="default: m; with euler: cm")
    axes: Annotated[list[str], Field(min_length=3, max_length=3)] | None = Field(
        None,
        description="axes forward, left, up; default [x, y, z], with euler [z, x, y]",
    )
    sample_rate_hz: float | None = Field(
        None,
        ge=MIN_RATE_HZ,
        le=MAX_RATE_HZ,
        description="rate of the sample counter if MVN streams fewer samples; default: rate_hz",
    )
    stamp: Literal["time_code", "sample_counter"] = Field(
        "time_code", description="field that states the capture time of a sample"
    )

    safety: ClassVar[Safety] = harmless("port", "sample_rate_hz")

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        check_exposure(self.host, self.allow_unauthenticated)
        if self.sample_rate_hz is not None and self.sample_rate_hz < self.rate_hz:
            raise ValueError(
                "sample_rate_hz is less than rate_hz; MVN cannot stream more often than it samples"
            )
        return self

    @property
    def samples_per_scene(self) -> float:
        """Increment of the sample counter from scene to scene."""
        return (self.sample_rate_hz or self.rate_hz) / self.rate_hz


class MvnDecoder:
    """Turns datagrams into scenes; see ``hri_drivers.sources.live.Decoder``.

    Args:
        settings: the source's.
        joint_map: names, units and axes of the segments.
        counters: counts packets and refusals.
        contradicted: returns whether a second machine was heard recently.
    """

    def __init__(
        self,
        settings: MvnSettings,
        joint_map: JointMap,
        counters: SourceCounters,
        contradicted: Callable[[], bool] = lambda: False,
    ) -> None:
        self._settings = settings
        self._contradicted = contradicted
        self._joint_map = joint_map
        self._counters = counters
        self._step = settings.samples_per_scene
        self._assembler = Assembler(TYPES[settings.type], self._step, counters)
        self._second = SecondSender(counters, joint_map.scale_to_m)
        self._heard_type = False
        self._session = -1
        self._counter = self._sequence = 0

    def reset(self) -> None:
        """Discard the current sample."""
        self._assembler.reset()

    def feed(self, data: bytes, received_ns: int) -> list[SentScene]:
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
                f"MVN streams type {datagram.type:02d}, not {TYPES[self._settings.type]:02d}; "
                f"select Position + Orientation ({self._settings.type.capitalize()}) in MVN"
            )
        sample = self._assembler.add(datagram)
        self._second.in_session(self._assembler.session, received_ns)
        if self._assembler.refused is not None:
            self._second.refused(self._assembler.refused, received_ns)
        return [] if sample is None else [self._scene(sample, received_ns)]

    def _scene(self, sample: Sample, received_ns: int) -> SentScene:
        self._second.used(sample)
        alone = not self._second.heard_lately(received_ns)
        if self._contradicted():
            alone = False
            self._counters.note(NOTE)
        sees_room = self._settings.sees_room and self._is_human_sized(sample)
        sees_room = sees_room and alone  # the other sender's people are unseen
        if self._settings.stamp == "time_code":
            stamp_ns = sample.time_code_ms * 1_000_000
        else:
            stamp_ns = round(sample.counter / self._settings.rate_hz / self._step * 1e9)
        people = tuple(
            SentPerson(number, pose.positions, pose.observed)
            for number, pose in sample.poses.items()
        )
        sequence = self._count(sample.counter)
        return SentScene(
            stamp_ns=stamp_ns,
            sequence=sequence,
            sees_room=sees_room,
            people=people,
            session=self._assembler.session,
        )

    def _count(self, counter: int) -> int:
        """A number that increases by one from scene to scene, and by more if scenes are missing."""
        if self._session != self._assembler.session:
            self._session, self._sequence = self._assembler.session, 0
        else:
            risen = (counter - self._counter) & 0xFFFFFFFF
            self._sequence += max(1, round(risen / self._step))
        self._counter = counter
        return self._sequence

    def _is_human_sized(self, sample: Sample) -> bool:
        """Whether all bodies have human size; if not, the configured units are wrong."""
        for number, pose in sample.poses.items():
            length = longest_limb(pose) * self._joint_map.scale_to_m
            if not LIMB_M[0] <= length <= LIMB_M[1]:
                self._counters.malformed += 1
                if math.isnan(length):
                    why = f"MVN sends no limbs for character {number}; check the suit in MVN"
                else:
                    why = f"MVN character {number} has limbs {length:.3g} m long; correct 'units'"
                self._counters.note(why)
                return False
        return True


def longest_limb(pose: MvnPose) -> float:
    """Length of the longest arm or leg, in the stream's units; NaN if MVN sent none."""
    with np.errstate(all="ignore"):
        bones = np.linalg.norm(np.diff(pose.positions[LIMBS], axis=1), axis=2)
        return float(np.fmax.reduce(bones.sum(axis=1)))


class MvnSource(LiveSource):
    """See ``hri_predict.contracts.source.Source``."""

    settings_model = MvnSettings

    def __init__(
        self, settings: MvnSettings, base_dir: Path | None = None, clock: Clock | None = None
    ) -> None:
        """Build the source without opening it.

        Raises:
            ConfigError: the joint map or the axes are wrong.
        """
        number = TYPES[settings.type]
        joint_map = sender_joints(settings, base_dir)
        if len(joint_map.source_joints) != SEGMENTS:
            raise ConfigError(
                f"source.joint_map: {joint_map.name} has {len(joint_map.source_joints)} joints; "
                f"MVN sends {SEGMENTS} segments; use xsens23, or a map with as many joints"
            )
        joint_map = joint_map.with_units(METRES_PER_UNIT[settings.units or UNITS[number]])
        joint_map = joint_map.with_axes(settings.axes or AXES[number])
        counters = SourceCounters()
        receiver = _receiver(settings, counters)
        super().__init__(
            settings=settings,
            receiver=receiver,
            decoder=MvnDecoder(settings, joint_map, counters, lambda: receiver.contradicted),
            counters=counters,
            joint_map=joint_map,
            clock=clock,
        )


def _receiver(settings: MvnSettings, counters: SourceCounters) -> OneSender | StreamServer:
    if settings.protocol == "udp":
        return OneSender(
            settings.host,
            settings.port,
            largest=MAX_DATAGRAM,
            counters=counters,
            by_machine=True,  # MVN may use a port for each character
        )
    return StreamServer(
        host=settings.host,
        port=settings.port,
        splitter=StreamSplitter,
        places=MAX_SENDERS,
        counters=counters,
    )
