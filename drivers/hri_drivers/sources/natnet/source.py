"""``kind: natnet``: the skeletons of OptiTrack Motive; see ``packets``.

Motive's frame is right-handed in metres, with y up by default. Each skeleton is a person. A bone
that Motive does not track is unobserved.
"""

import ipaddress
from pathlib import Path
from typing import ClassVar, Literal, Self

from pydantic import Field, field_validator, model_validator

from hri_drivers.sources.live import LiveSettings, LiveSource, sender_joints
from hri_drivers.sources.mocap.decoder import MocapDecoder
from hri_drivers.sources.mocap.settings import GroupSettings
from hri_drivers.sources.multicast import MulticastGroup
from hri_drivers.sources.natnet.reader import NatNetReader
from hri_drivers.sources.natnet.receiver import NatNetReceiver
from hri_drivers.sources.tcp import check_exposure
from hri_drivers.sources.udp_receiver import is_loopback
from hri_predict.base.clock import Clock
from hri_predict.base.quantities.safe_side import Safety, harmless
from hri_predict.contracts.source import SourceCounters

AXES = {"y": ("z", "x", "y"), "z": ("x", "y", "z")}
"""Axes forward, left and up for each up axis; ``room_from_source`` rotates about it."""


class NatNetSettings(GroupSettings):
    """``source:`` of ``kind: natnet``."""

    kind: Literal["natnet"]
    joint_map: str = Field("motive21", description="joint map of Motive's bones, or your own map")
    keeps_ids: bool = Field(True, description="a skeleton that returns is the same person")
    server: str = Field("127.0.0.1", description="address of the machine that runs Motive")
    command_port: int = Field(1510, ge=1, le=65535, description="Motive's command port")
    port: int = Field(
        1511, ge=1, le=65535, description="Motive's data port, used with a multicast group"
    )
    multicast_group: MulticastGroup = Field(
        None, description="Motive's multicast group, 239.255.42.99; default: unicast"
    )
    up: Literal["y", "z"] | None = Field(
        None, description="Motive's up axis, as streamed; default: the joint map's, y"
    )

    safety: ClassVar[Safety] = harmless("command_port")

    @field_validator("server")
    @classmethod
    def _address(cls, value: str) -> str:
        try:
            return str(ipaddress.IPv4Address(value))
        except ValueError:
            raise ValueError("must be an IPv4 address, such as 192.168.1.20") from None

    @model_validator(mode="after")
    def _known(self) -> Self:
        check_exposure(self.server, self.allow_unauthenticated)
        if is_loopback(self.host) and not is_loopback(self.server):
            raise ValueError(
                f"host {self.host} does not reach the server {self.server}; set 'host' to this "
                "machine's address in Motive's network"
            )
        return self


class NatNetSource(LiveSource):
    """See ``hri_predict.contracts.source.Source``."""

    settings_model: ClassVar[type[LiveSettings]] = NatNetSettings

    def __init__(
        self, settings: NatNetSettings, base_dir: Path | None = None, clock: Clock | None = None
    ) -> None:
        """Build the source without opening it.

        Raises:
            ConfigError: the joint map is wrong.
        """
        counters = SourceCounters()
        joint_map = sender_joints(settings, base_dir)
        if settings.up is not None:
            joint_map = joint_map.with_axes(AXES[settings.up])
        reader = NatNetReader(joint_map.source_joints, counters)
        super().__init__(
            settings=settings,
            receiver=NatNetReceiver(
                server=settings.server,
                command_port=settings.command_port,
                host=settings.host,
                group=settings.multicast_group,
                data_port=settings.port,
                wanted=lambda: reader.wanted,
            ),
            decoder=MocapDecoder(
                reader=reader, settings=settings, joint_map=joint_map, counters=counters
            ),
            counters=counters,
            joint_map=joint_map,
            clock=clock,
        )
