"""``kind: zenoh``: scenes under ``hri/<site>/<cell>/scene``; see ``docs/guides/fleet.md``.

Each payload is one datagram of the node's own scene stream (``drivers/SCENE_STREAM.md``), so a key
(HMAC) protects a scene all the way from sender to node, through any router.
"""

from pathlib import Path
from typing import Literal, Self

from pydantic import Field, model_validator

from hri_drivers.sources.scene_stream.stream_source import StreamSettings, StreamSource
from hri_drivers.wires.zenoh import ZenohTransport
from hri_drivers.wires.zenoh_session import CellSettings, is_local
from hri_predict.protocol.keyed import SCENE, prefix


class ZenohSourceSettings(CellSettings, StreamSettings):
    """``source:`` of ``kind: zenoh``."""

    kind: Literal["zenoh"]
    allow_unauthenticated: bool = Field(
        False,
        description="without a key: believe any program that may publish",
    )

    @model_validator(mode="after")
    def _protected(self) -> Self:
        ends = [*(self.connect or []), *(self.listen or [])]
        local = self.zenoh_config is None and all(is_local(end) for end in ends)
        self.demand_key(local, "zenoh", "zenoh_config excludes strangers")
        return self


class ZenohReceiver:
    """``hri_drivers.sources.live.Receiver`` of the payloads under the scene's key."""

    def __init__(self, settings: ZenohSourceSettings) -> None:
        self._transport = ZenohTransport(settings, prefix(settings.site, settings.cell), [SCENE])

    def open(self) -> None:
        """Open the session; see ``ZenohTransport.open``."""
        self._transport.open()

    def read(self, timeout_s: float) -> list[bytes]:
        """Return the payloads that have arrived.

        Raises:
            LinkError: there is no connection.
        """
        return [unit.data for unit in self._transport.read(timeout_s)]

    def close(self) -> None:
        """Close the session."""
        self._transport.close()


class ZenohSource(StreamSource):
    """See ``StreamSource``."""

    settings_model = ZenohSourceSettings

    @staticmethod
    def _make_receiver(settings: ZenohSourceSettings, base_dir: Path) -> ZenohReceiver:
        return ZenohReceiver(settings.resolved(base_dir))
