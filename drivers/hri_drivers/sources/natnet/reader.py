"""Reads captures from NatNet's frames, and requests the necessary information from Motive."""

from collections.abc import Mapping, Sequence

import numpy as np

from hri_drivers.sources.mocap.frames import Frame, FrameError, person, stamp_of_s
from hri_drivers.sources.natnet import packets
from hri_drivers.sources.natnet.packets import Bone, MocapFrame, Pose
from hri_drivers.sources.sent import SentPerson
from hri_predict.base.arrays import Floats
from hri_predict.contracts.source import SourceCounters

DAMAGED = 10
"""Number of damaged frames in a row after which the version is requested again, because Motive may
have been updated."""
LOCAL_M = 0.02
"""If all bones are this close to their offsets from their parents, coordinates are local."""


class NatNetReader:
    """See ``hri_drivers.sources.mocap.frames.Reader``.

    Args:
        joints: names of bones, the joints of the source.
        counters: counts ``ignored``.
    """

    def __init__(self, joints: Sequence[str], counters: SourceCounters) -> None:
        self._joints = joints
        self._counters = counters
        self._version: tuple[int, int] | None = None
        self._models: dict[int, dict[int, Bone]] | None = None
        self._damaged = 0

    @property
    def wanted(self) -> int:
        """The message to send to Motive next."""
        if self._version is None:
            return packets.CONNECT
        return packets.REQUEST_MODELS if self._models is None else packets.KEEP_ALIVE

    def reset(self) -> None:
        """Request everything again: another Motive may have started."""
        self._version = self._models = None
        self._damaged = 0

    def pause(self) -> None:
        """Do nothing: each frame is complete."""

    def read(self, data: bytes) -> Frame | None:
        """See ``Reader``."""
        message, found = packets.payload(data)
        if message == packets.SERVER_INFO:
            version = packets.version(found)
            if version != self._version:
                self._version, self._models = version, None
            return None
        if self._version is None or message not in (packets.MODELS, packets.FRAME):
            self._counters.ignored += 1
            return None
        if message == packets.MODELS:
            self._models = packets.models(found, self._version)
            return None
        frame = self._parsed(found)
        if frame.models_changed:
            self._models = None
        if self._models is None:
            self._counters.ignored += 1
            self._counters.note("natnet: frames before the model definitions")
            return None
        return self._frame(frame, self._models)

    def _parsed(self, data: bytes) -> MocapFrame:
        try:
            frame = packets.frame(data)
        except FrameError:
            self._damaged += 1
            if self._damaged >= DAMAGED:
                self.reset()
            raise
        self._damaged = 0
        return frame

    def _frame(self, frame: MocapFrame, models: Mapping[int, Mapping[int, Bone]]) -> Frame:
        if not frame.skeletons.keys() <= models.keys():
            self._models = None
            raise FrameError(
                "a skeleton without a model definition; requesting the definitions again"
            )
        people = [self._person(k, pose, models[k]) for k, pose in frame.skeletons.items()]
        return Frame(stamp_ns=stamp_of_s(frame.time_s), number=frame.number, people=tuple(people))

    def _person(self, number: int, pose: Pose, bones: Mapping[int, Bone]) -> SentPerson:
        if _is_local(pose, bones):
            raise FrameError(
                "a relative stream: bones are in local coordinates; select Global in Motive's "
                "streaming settings (Skeleton Coordinates)"
            )
        found: Floats = np.full((len(self._joints), 3), np.nan)
        for bone, place in pose.positions.items():
            name = bones[bone].name if bone in bones else None
            if name in self._joints and bone in pose.tracked:
                found[self._joints.index(name)] = place
        if not {bone.name for bone in bones.values()} & set(self._joints):
            raise FrameError(
                "no bone of the joint map; select the bone naming convention Motive in its "
                "streaming settings, or correct 'joint_map'"
            )
        return person(number & 0xFFFF, found)


def _is_local(pose: Pose, bones: Mapping[int, Bone]) -> bool:
    """Whether every bone except the root is at its offset from its parent."""
    children = [k for k in pose.positions if k in bones and bones[k].parent != 0]
    return bool(children) and all(
        float(np.abs(pose.positions[k] - bones[k].offset).max(initial=0.0)) < LOCAL_M
        for k in children
    )
