"""``kind: rokoko``: the actors of Rokoko Studio, through its custom streaming; see ``reader``."""

from typing import Literal

from pydantic import Field

from hri_drivers.sources.mocap.settings import MocapSettings
from hri_drivers.sources.mocap.source import MocapSource
from hri_drivers.sources.rokoko.reader import NEEDS_LZ4, RokokoReader, has_lz4
from hri_predict.contracts.joint_map import JointMap
from hri_predict.contracts.source import SourceCounters

DEFAULT_PORT = 14043


class RokokoSettings(MocapSettings):
    """``source:`` of ``kind: rokoko``."""

    kind: Literal["rokoko"]
    joint_map: str = Field(
        "rokoko23", description="joint map of an actor's body parts, or your own map"
    )
    keeps_ids: bool = Field(True, description="an actor who returns is the same person")
    port: int = Field(
        DEFAULT_PORT, ge=0, le=65535, description="UDP port that Rokoko Studio sends to"
    )

    @property
    def notes(self) -> list[str]:
        """Notes for ``check``: network exposure, and the package that compressed streams need."""
        return [*super().notes, *([] if has_lz4() else [NEEDS_LZ4])]


class RokokoSource(MocapSource):
    """See ``hri_predict.contracts.source.Source``."""

    settings_model = RokokoSettings
    root = "hip"

    def _make_reader(
        self, settings: RokokoSettings, joint_map: JointMap, counters: SourceCounters
    ) -> RokokoReader:
        return RokokoReader(joint_map.source_joints, counters)
