"""``kind: zed_livelink``: people seen by ZED cameras, from Stereolabs' Live Link senders.

Each datagram states its units and axes, or has Unity's; the joint map gives only the names.
"""

from typing import ClassVar, Literal

from pydantic import Field

from hri_drivers.sources.mocap.settings import GroupSettings
from hri_drivers.sources.mocap.source import MocapSource
from hri_drivers.sources.zed_livelink.reader import ZedReader
from hri_predict.base.arrays import Floats
from hri_predict.base.quantities.safe_side import LessSafe, Safety
from hri_predict.contracts.joint_map import JointMap
from hri_predict.contracts.source import SourceCounters

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
