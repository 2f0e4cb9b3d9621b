"""``kind: vmc``: the bones of one performer, over the VMC protocol; see ``reader``.

A port has one performer, who is person 1, because VMC has no ids. The bones belong to an avatar.
"""

from typing import ClassVar, Literal

from pydantic import Field

from hri_drivers.sources.mocap.settings import MocapSettings
from hri_drivers.sources.mocap.source import MocapSource
from hri_drivers.sources.vmc.bones import HIPS
from hri_drivers.sources.vmc.reader import VmcReader
from hri_predict.base.quantities.safe_side import LessSafe, Safety
from hri_predict.contracts.joint_map import JointMap
from hri_predict.contracts.source import SourceCounters

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
