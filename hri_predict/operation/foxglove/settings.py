"""``foxglove:`` in the configuration."""

from pydantic import Field

from hri_predict.base.settings import Settings
from hri_predict.recording.mcap.items import Rates


class FoxgloveSettings(Settings):
    """Address at which Foxglove connects to the live node, over a WebSocket."""

    port: int = Field(8765, ge=1, le=65535, description="TCP port")
    host: str = Field(
        "127.0.0.1",
        min_length=1,
        max_length=253,
        description="address to listen on; default: only this machine",
    )
    max_clients: int = Field(
        16,
        ge=1,
        le=256,
        description="maximum number of connections; further ones are closed and counted",
    )
    zones_hz: float = Field(5.0, ge=0, le=100, description="zones per second; 0: none")
    poses_hz: float = Field(5.0, ge=0, le=100, description="forecasts per second; 0: none")
    view_hz: float = Field(10.0, ge=0, le=100, description="pictures for 3D views; 0: none")

    @property
    def rates(self) -> Rates:
        """Rates of bulky data; messages sent on links are left out."""
        return Rates(
            zones_hz=self.zones_hz, poses_hz=self.poses_hz, view_hz=self.view_hz, sent=False
        )
