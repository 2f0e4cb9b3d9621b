"""Settings common to all sources of motion capture over UDP."""

from typing import ClassVar, Literal, Self

from pydantic import Field, model_validator

from hri_drivers.sources.live import LiveSettings
from hri_drivers.sources.tcp import ALLOW_UNAUTHENTICATED, check_exposure
from hri_drivers.sources.udp_receiver import MulticastGroup
from hri_predict.base.quantities.safe_side import LessSafe, Safety, harmless


class MocapSettings(LiveSettings):
    """``source:`` of every kind of motion capture."""

    host: str = Field("127.0.0.1", description="address to listen on; default: this machine only")
    port: int = Field(ge=0, le=65535, description="UDP port that the program sends to")
    allow_unauthenticated: bool = ALLOW_UNAUTHENTICATED
    sees_room: bool = Field(
        description="true only if every person who can come near is tracked by this source; "
        "required"
    )
    stamp: Literal["sender", "arrival"] = Field(
        "sender",
        description="source of the capture time; with arrival, give the delay before arrival as "
        "min_latency_s",
    )

    safety: ClassVar[Safety] = harmless("port") | {
        "stamp": LessSafe(other="a capture that the network delays is treated as fresh"),
    }

    @model_validator(mode="after")
    def _guarded(self) -> Self:
        check_exposure(self.host, self.allow_unauthenticated)
        return self


class GroupSettings(MocapSettings):
    """Settings of a source whose program may send to a multicast group."""

    multicast_group: MulticastGroup = None

    @model_validator(mode="after")
    def _interface(self) -> Self:
        if self.multicast_group is None:
            return self
        if ":" in self.host:
            raise ValueError("multicast needs an IPv4 'host': the address of the interface")
        if not self.allow_unauthenticated:
            raise ValueError(
                "multicast_group accepts network input, and any program could claim an empty "
                "room: set 'allow_unauthenticated: true' if you trust the whole network"
            )
        return self
