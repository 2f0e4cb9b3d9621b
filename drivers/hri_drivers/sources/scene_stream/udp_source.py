"""The node's own scene stream over UDP (``kind: udp``), specified in ``drivers/SCENE_STREAM.md``.

The user's program sends it, and needs only ``drivers/python/hri_sender.py``.
"""

import ipaddress
from pathlib import Path
from typing import ClassVar, Literal, Self

from pydantic import Field, field_validator, model_validator

from hri_drivers.sources.scene_stream.codec import MAX_DATAGRAM
from hri_drivers.sources.scene_stream.stream_source import StreamSettings, StreamSource
from hri_drivers.sources.udp_receiver import MulticastGroup, UdpReceiver, is_loopback
from hri_predict.base.quantities.safe_side import Safety, harmless

DEFAULT_PORT = 47_800


class UdpSettings(StreamSettings):
    """``source:`` of ``kind: udp``."""

    kind: Literal["udp"]
    host: str = Field(
        "127.0.0.1", description="address of the interface to listen on; default: this machine only"
    )
    port: int = Field(DEFAULT_PORT, ge=0, le=65535, description="UDP port; 0: any free port")
    multicast_group: MulticastGroup = None
    allow_unauthenticated: bool = Field(
        False,
        description="without a key: believe any program that reaches the port",
    )

    safety: ClassVar[Safety] = harmless("port")

    @field_validator("host")
    @classmethod
    def _address(cls, value: str) -> str:
        try:
            return str(ipaddress.ip_address("127.0.0.1" if value == "localhost" else value))
        except ValueError:
            raise ValueError("must be an IP address of this machine, such as 127.0.0.1") from None

    @model_validator(mode="after")
    def _protected(self) -> Self:
        if self.multicast_group is not None and ":" in self.host:
            raise ValueError("multicast needs an IPv4 'host': the address of the interface")
        self.demand_key(is_loopback(self.host), f"host {self.host}", "you trust the whole network")
        return self


class UdpSource(StreamSource):
    """See ``StreamSource``."""

    settings_model = UdpSettings
    _receiver: UdpReceiver

    @staticmethod
    def _make_receiver(settings: UdpSettings, base_dir: Path) -> UdpReceiver:
        return UdpReceiver(
            settings.host, settings.port, settings.multicast_group, largest=MAX_DATAGRAM
        )

    @property
    def port(self) -> int:
        """Port to which the source listens; 0 until it is open."""
        return self._receiver.port
