"""``kind: zed_livelink``: people seen by ZED cameras, from Stereolabs' Live Link senders.

Each datagram states its units and axes, or has Unity's; the joint map gives only the names.

Source: the senders' source code, github.com/stereolabs/zed-livelink (``sender-mono`` and
``sender-multi-camera``, for Unreal) and github.com/stereolabs/zed-unity-livelink. A datagram has
one body of several, or all; the total is in ``nb_bodies`` or ``nb_object``.

- For Unreal: ``frame_id``, ``timestamp`` (ns of UTC), ``role``, ``coordinate_system``,
  ``coordinate_unit``, ``nb_bodies``, and the body at the top.
- For Unity: ``bodies`` with ``timestamp``, ``nb_object`` and ``body_list``; always metres in
  Unity's frame.

Senders write 0 for values that they did not measure. Confidences are 0 to 100.
"""

from collections.abc import Mapping, Sequence
from typing import Any, ClassVar, Literal

import numpy as np
from pydantic import Field

from hri_drivers.sources.mocap.frames import (
    MAX_PEOPLE,
    MAX_STAMP_S,
    Frame,
    FrameError,
    json_object,
    member,
    number_of,
    person,
    place_of,
)
from hri_drivers.sources.mocap.settings import GroupSettings
from hri_drivers.sources.mocap.source import MocapSource
from hri_drivers.sources.sent import SentPerson
from hri_predict.base.arrays import Floats
from hri_predict.base.quantities.safe_side import LessSafe, Safety
from hri_predict.contracts.joint_map import METRES_PER_UNIT, JointMap, axes_rotation
from hri_predict.contracts.source import SourceCounters

AXES = (  # sl::COORDINATE_SYSTEM: axes forward, left and up; whether left-handed
    (("z", "-x", "-y"), False),  # IMAGE
    (("z", "-x", "y"), True),  # LEFT_HANDED_Y_UP: Unity
    (("-z", "-x", "y"), False),  # RIGHT_HANDED_Y_UP
    (("y", "-x", "z"), False),  # RIGHT_HANDED_Z_UP
    (("x", "-y", "z"), True),  # LEFT_HANDED_Z_UP: Unreal
    (("x", "y", "z"), False),  # RIGHT_HANDED_Z_UP_X_FWD: ROS
)
UNITS = ("mm", "cm", "m", "inch", "ft")  # sl::UNIT
UNITY = (1, 2)
ANIMATION = 2
"""``role`` of a body; others are cameras and transforms."""
TRACKING_OFF, TRACKING_OK = 0, 1
_MAX_NS = int(MAX_STAMP_S * 1e9)


class ZedReader:
    """See ``hri_drivers.sources.mocap.frames.Reader``.

    Args:
        joints: names of the keypoints, the joints of the source.
        min_confidence: minimum confidence (0 to 1) of an observed joint.
        counters: counts ``incomplete``, ``ignored`` and ``unsure_joints``.

    Attributes:
        stated: (3, 3) from the newest body's units and axes to metres, forward, left and up.
    """

    def __init__(
        self, joints: Sequence[str], min_confidence: float, counters: SourceCounters
    ) -> None:
        self.stated: Floats | None = None
        self._joints = joints
        self._min_confidence = min_confidence
        self._counters = counters
        self._capture: tuple[int, int | None] | None = None  # stamp and number
        self._people: dict[int, SentPerson] = {}

    def reset(self) -> None:
        """Discard the capture in progress."""
        self._capture, self._people = None, {}

    def pause(self) -> None:
        """Discard the capture in progress."""
        self.reset()

    def read(self, data: bytes) -> Frame | None:
        """See ``Reader``."""
        found = json_object(data)
        if "bodies" in found:
            head = member(found, "bodies", dict)
            bodies, total = member(head, "body_list", list), member(head, "nb_object", int)
            to_metres = _to_metres(*UNITY)
            capture = (_stamp(head), None)
        elif member(found, "role", int) != ANIMATION:
            self._counters.ignored += 1
            return None
        else:
            total = member(found, "nb_bodies", int)
            bodies = [found] if "keypoint" in found else []
            to_metres = _to_metres(
                member(found, "coordinate_system", int), member(found, "coordinate_unit", int)
            )
            capture = (_stamp(found), member(found, "frame_id", int))
        if not len(bodies) <= total <= MAX_PEOPLE:
            raise FrameError(f"{len(bodies)} bodies of {total}; at most {MAX_PEOPLE}")
        people = [self._person(body, to_metres) for body in bodies]
        self.stated = to_metres
        return self._add(capture, people, total)

    def _add(
        self, capture: tuple[int, int | None], people: list[SentPerson], total: int
    ) -> Frame | None:
        """Add bodies of one capture; return the capture once it is complete."""
        if capture != self._capture:
            self._counters.incomplete += self._capture is not None
            self._capture, self._people = capture, {}
        if any(each.id in self._people for each in people) or len(
            {each.id for each in people}
        ) < len(people):
            raise FrameError("an id occurs twice in one capture")
        self._people |= {each.id: each for each in people}
        if len(self._people) < total:
            return None
        whole, (stamp_ns, number) = tuple(self._people.values()), capture
        self.reset()
        return Frame(stamp_ns=stamp_ns, number=number, people=whole)

    def _person(self, body: Mapping[str, Any], to_metres: Floats) -> SentPerson:
        keypoints = member(body, "keypoint", list)
        if len(keypoints) != len(self._joints):
            raise FrameError(
                f"bodies of {len(keypoints)} keypoints, and the joint map has "
                f"{len(self._joints)} joints; set 'joint_map' to zed18, zed34 or zed38"
            )
        state = member(body, "tracking_state", int)
        if state == TRACKING_OFF:
            raise FrameError("ids do not persist; enable tracking in the sender")
        places = np.array([place_of(each) for each in keypoints])
        places[(places == 0).all(axis=1)] = np.nan
        sure = np.array([number_of(each) for each in member(body, "keypoint_confidence", list)])
        if sure.shape != (len(self._joints),):
            raise FrameError("keypoint_confidence must have one number for each keypoint")
        unsure = np.isfinite(places).all(axis=1) & (sure < 100 * self._min_confidence)
        self._counters.unsure_joints += int(unsure.sum())
        places[unsure | (state != TRACKING_OK)] = np.nan
        return person(member(body, "id", int) & 0xFFFF, places @ to_metres.T)


def _stamp(found: Mapping[str, Any]) -> int:
    stamp_ns: int = member(found, "timestamp", int)
    if not 0 < stamp_ns < _MAX_NS:
        raise FrameError("a timestamp that is not nanoseconds of UTC")
    return stamp_ns


def _to_metres(system: int, unit: int) -> Floats:
    if not (0 <= system < len(AXES) and 0 <= unit < len(UNITS)):
        raise FrameError(f"coordinate_system {system}, coordinate_unit {unit}: not the SDK's")
    axes, left_handed = AXES[system]
    return axes_rotation(axes, left_handed) * METRES_PER_UNIT[UNITS[unit]]


DEFAULT_PORT = 20001


class ZedLiveLinkSettings(GroupSettings):
    """``source:`` of ``kind: zed_livelink``."""

    kind: Literal["zed_livelink"]
    joint_map: str = Field("zed38", description="zed18, zed34 or zed38: the sender's format")
    port: int = Field(DEFAULT_PORT, ge=0, le=65535, description="UDP port that the sender uses")
    min_confidence: float = Field(
        0.3, ge=0, le=1, description="joints sent with less confidence are unobserved"
    )

    safety: ClassVar[Safety] = {
        "min_confidence": LessSafe(below="joints with a confidence of {value:g} count as seen")
    }


class ZedLiveLinkSource(MocapSource):
    """See ``hri_predict.contracts.source.Source``."""

    settings_model = ZedLiveLinkSettings
    _reader: ZedReader

    @property
    def stamps_utc(self) -> bool:  # type: ignore[override]
        """See ``hri_predict.contracts.source.Live``."""
        settings = self._settings
        return isinstance(settings, ZedLiveLinkSettings) and settings.stamp == "sender"

    @property
    def stated(self) -> Floats | None:
        """See ``hri_predict.contracts.source.StatesFrame``."""
        return self._reader.stated

    def _joints(self, joint_map: JointMap) -> JointMap:
        return joint_map.with_units(1.0).with_axes(["x", "y", "z"])

    def _make_reader(
        self, settings: ZedLiveLinkSettings, joint_map: JointMap, counters: SourceCounters
    ) -> ZedReader:
        self._reader = ZedReader(joint_map.source_joints, settings.min_confidence, counters)
        return self._reader
