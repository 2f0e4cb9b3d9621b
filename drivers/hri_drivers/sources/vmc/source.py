"""``kind: vmc``: the bones of one performer, over the VMC protocol.

A port has one performer, who is person 1, because VMC has no ids. The bones belong to an avatar.
"""

import math
from collections.abc import Sequence
from typing import ClassVar, Literal

import numpy as np
from pydantic import Field

from hri_drivers.sources.mocap.frames import Frame, FrameError, person, stamp_of_s
from hri_drivers.sources.mocap.settings import MocapSettings
from hri_drivers.sources.mocap.source import MocapSource
from hri_drivers.sources.vmc.bones import HIPS, ROOT, Pose, global_positions, needed
from hri_drivers.sources.vmc.osc import Argument, Message, OscError, messages
from hri_predict.base.arrays import Floats
from hri_predict.base.quantities.safe_side import LessSafe, Safety
from hri_predict.contracts.joint_map import JointMap
from hri_predict.contracts.source import SourceCounters

PERFORMER = 1
"""Id of the only person on a port."""
CALIBRATED = 3
NORMAL_MODE = 0
_POSE = 7
_SCALED = _POSE + 6
_MAX_M = 1e4


class VmcReader:
    """See ``hri_drivers.sources.mocap.frames.Reader``.

    A capture's time is the newest time received. If a performer sends the time after the bones,
    each capture is always stamped one period early. Source: VMC Protocol, "Marionette"
    specification V2.7 (protocol.vmc.info/marionette-spec):

    - ``/VMC/Ext/OK (int) loaded [(int) calibration state (int) calibration mode [(int) tracking]]``
    - ``/VMC/Ext/T (float) time`` in seconds of the performer's own clock
    - ``/VMC/Ext/Root/Pos "root" p.x p.y p.z q.x q.y q.z q.w [s.x s.y s.z o.x o.y o.z]``
    - ``/VMC/Ext/Bone/Pos name p.x p.y p.z q.x q.y q.z q.w``, local, metres

    Args:
        joints: names of bones, the joints of the source.
        normal_mode: whether to accept the normal calibration mode, in which the avatar keeps its
            own size.
        counters: counts ``incomplete`` and ``ignored``.
    """

    def __init__(self, joints: Sequence[str], normal_mode: bool, counters: SourceCounters) -> None:
        self._joints = joints
        self._placing = needed(joints)
        self._normal_mode = normal_mode
        self._counters = counters
        self._why_not: str | None = "the performer has not sent /VMC/Ext/OK"
        self._newest = b""
        self._stamp_ns: int | None = None
        self._root: Pose | None = None
        self._scale = np.ones(3)
        self._offset = np.zeros(3)
        self._segments = Segments(counters)

    def reset(self) -> None:
        """Discard the capture in progress and its time, which is not that of the next capture."""
        self._segments.reset()
        self._stamp_ns = None

    def pause(self) -> None:
        """Discard the capture in progress and its time."""
        self.reset()

    def read(self, data: bytes) -> Frame | None:
        """See ``Reader``; a datagram that the network duplicated counts once."""
        if data == self._newest:
            self._counters.ignored += 1
            return None
        self._newest = data
        try:
            found = messages(data)
        except OscError as error:
            raise FrameError(f"not an OSC packet: {error}") from None
        poses = [_checked(message) for message in found]
        frame = None
        for message, pose in zip(found, poses, strict=True):
            frame = self._take(message, pose) or frame
        if not any(message.address.startswith("/VMC/Ext/") for message in found):
            self._counters.ignored += 1
        return self._captured() or frame

    def _take(self, message: Message, pose: Pose) -> Frame | None:
        """Process one message; return the capture that ends with it, unless completed later."""
        if message.address == "/VMC/Ext/OK":
            self._why_not = _why_not(message.arguments, self._normal_mode)
        elif message.address == "/VMC/Ext/Root/Pos":
            self._root = pose[:_POSE]
            self._scale = np.array(pose[_POSE : _POSE + 3] or (1.0, 1.0, 1.0))
            self._offset = np.array(pose[_POSE + 3 :] or (0.0, 0.0, 0.0))
        elif message.address == "/VMC/Ext/Bone/Pos":
            if message.arguments[0] in self._placing:  # fingers and eyes place no joint
                self._segments.add(str(message.arguments[0]), pose)
        elif message.address == "/VMC/Ext/T":
            captured = self._captured()
            self._segments.end()
            self._stamp_ns = stamp_of_s(message.arguments[0])
            if self._why_not is not None:
                self._counters.note(f"vmc: {self._why_not}")
                return Frame(stamp_ns=self._stamp_ns, tracks=False)
            return captured
        return None

    def _captured(self) -> Frame | None:
        """The capture that is now complete, if the performer is tracking."""
        if self._why_not is not None or self._stamp_ns is None or not self._segments.whole():
            return None
        bones = self._segments.bones
        if HIPS not in bones or self._root is None:
            lacks = ROOT if HIPS in bones else HIPS
            self._counters.note(
                f"vmc: a relative stream, without '{lacks}'; let the performer send all bones"
            )
            return Frame(stamp_ns=self._stamp_ns, tracks=False)
        people = (person(PERFORMER, self._positions(self._root, bones)),)
        return Frame(stamp_ns=self._stamp_ns, people=people)

    def _positions(self, root: Pose, bones: dict[str, Pose]) -> Floats:
        """(J, 3) in Unity's frame; in the wearer's size if the performer sends a scale.

        The avatar is larger than the wearer by the factor ``s``, and shifted by ``o``.
        """
        places = global_positions(root, bones)
        found = np.array([places.get(joint, np.full(3, np.nan)) for joint in self._joints])
        sized: Floats = (found - self._offset) / self._scale
        return sized


def _checked(message: Message) -> Pose:
    """The pose in a message; empty if its kind has none.

    Raises:
        FrameError: its arguments are not those of its kind.
    """
    wanted = {"/VMC/Ext/Root/Pos": (_POSE, _SCALED), "/VMC/Ext/Bone/Pos": (_POSE,)}
    if message.address == "/VMC/Ext/T":
        try:
            (seconds,) = message.arguments
            stamp_of_s(seconds)
        except ValueError as error:
            raise FrameError(f"/VMC/Ext/T must have one number: {error}") from None
        return ()
    if message.address == "/VMC/Ext/OK":
        if not message.arguments or not all(type(each) is int for each in message.arguments):
            raise FrameError("/VMC/Ext/OK must have whole numbers")
        return ()
    if message.address not in wanted:
        return ()
    name, *numbers = message.arguments or (None,)
    if not isinstance(name, str) or len(numbers) not in wanted[message.address]:
        raise FrameError(f"{message.address} must have a name, a position and a quaternion")
    return _pose(message.address, numbers)


def _pose(address: str, numbers: Sequence[Argument]) -> Pose:
    pose = tuple(float(each) for each in numbers if type(each) is float)
    if len(pose) < len(numbers) or not all(abs(each) <= _MAX_M for each in pose):
        raise FrameError(f"{address} has a number that is not finite, or out of range")
    if not 0.5 <= math.hypot(*pose[3:_POSE]) <= 2.0:
        raise FrameError(f"{address} has a quaternion that is not of length 1")
    if not all(each > 1e-3 for each in pose[_POSE : _POSE + 3]):
        raise FrameError(f"{address} has a scale that is not positive")
    return pose


def _why_not(arguments: Sequence[Argument], normal_mode: bool) -> str | None:
    """The reason why the bones do not represent a person; ``None`` if they do."""
    given: list[Argument] = [*arguments[:4], None, None, None]
    loaded, state, mode, tracking = given[:4]
    if loaded != 1:
        return "the performer has loaded no avatar"
    if state is not None and state != CALIBRATED:
        return "the performer is not calibrated"
    if mode == NORMAL_MODE and not normal_mode:
        return (
            "calibrated in the normal mode, in which the avatar keeps its own size; calibrate in "
            "an MR mode, or set 'normal_mode: true' if avatar and wearer are of the same size"
        )
    if tracking is not None and tracking != 1:
        return "the performer has lost its trackers"
    return None


GONE_AFTER = 10
"""Number of captures in a row without one of the bones after which another avatar is assumed."""


class Segments:
    """Collects the bones of one capture: those between two times of the performer.

    VMC does not mark the end of a capture, which may need several datagrams. A performer sends its
    time with every capture, before the bones or after them. A capture is complete when every bone
    of the avatar has arrived since the newest time. If a datagram is lost, its bones are missing,
    and the capture is dropped and counted. Thus no body combines two captures or lacks a parent
    bone.

    Args:
        counters: counts ``incomplete``.

    Attributes:
        bones: local poses since the newest time.
    """

    def __init__(self, counters: SourceCounters) -> None:
        self.bones: dict[str, Pose] = {}
        self._counters = counters
        self._avatar: frozenset[str] | None = None  # its bones, known from two equal captures
        self._before: frozenset[str] = frozenset()
        self._given = True  # nothing is whole before the first time
        self._short = 0

    def reset(self) -> None:
        """Discard the capture in progress."""
        self.bones, self._given = {}, True

    def add(self, bone: str, pose: Pose) -> None:
        """Add a bone; a bone that arrives twice belongs to a capture whose time was lost."""
        if bone in self.bones and not self._given:
            self._counters.incomplete += 1
            self._counters.note("vmc: bones arrive twice without a new /VMC/Ext/T between them")
            self._given = True
        self.bones[bone] = pose

    def end(self) -> None:
        """Process a time: the bones that follow belong to another capture."""
        seen = frozenset(self.bones)
        if not seen:
            self._given = False
            return
        if self._avatar is None or seen - self._avatar:
            self._avatar = seen if seen == self._before else None
            self._short = 0
        elif seen < self._avatar:
            self._counters.incomplete += 1
            self._short += 1
            if self._short >= GONE_AFTER:
                self._avatar = None
        else:
            self._short = 0
        self._before = seen
        self.bones, self._given = {}, False

    def whole(self) -> bool:
        """Whether the capture is complete; true only once for each capture."""
        if self._given or self._avatar is None or not self._avatar <= self.bones.keys():
            return False
        self._given = True
        return True


DEFAULT_PORT = 39539


class VmcSettings(MocapSettings):
    """``source:`` of ``kind: vmc``."""

    kind: Literal["vmc"]
    joint_map: str = Field("unity22", description="joint map of Unity's humanoid, or your own map")
    keeps_ids: bool = Field(True, description="the performer of a port is always the same person")
    port: int = Field(
        DEFAULT_PORT, ge=0, le=65535, description="UDP port that the performer sends to"
    )
    normal_mode: bool = Field(
        False,
        description="accept bones of the normal calibration mode: the avatar has the wearer's "
        "size; true for a performer that has no MR mode",
    )

    safety: ClassVar[Safety] = {
        "normal_mode": LessSafe(
            other="joints are those of an avatar, which may be smaller than its wearer"
        )
    }


class VmcSource(MocapSource):
    """See ``hri_predict.contracts.source.Source``."""

    settings_model = VmcSettings
    root = HIPS
    largest = 16_384

    def _make_reader(
        self, settings: VmcSettings, joint_map: JointMap, counters: SourceCounters
    ) -> VmcReader:
        return VmcReader(joint_map.source_joints, settings.normal_mode, counters)
