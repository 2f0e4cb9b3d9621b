"""A link over zenoh: the same messages, for machines that display or collect many cells.

``docs/guides/fleet.md`` describes key scheme, topologies and protection.
"""

from typing import ClassVar, Self

from pydantic import Field, model_validator

from hri_drivers.links.codec import FrameCodec, item_count, shape_of
from hri_drivers.links.configured import ConfiguredLink, ConfiguredLinkSettings
from hri_drivers.links.load import Traffic
from hri_drivers.wires.transport import Transport
from hri_drivers.wires.zenoh import ZenohTransport
from hri_drivers.wires.zenoh_session import CellSettings, ZenohSettings
from hri_predict.base.quantities.safe_side import Safety, harmless
from hri_predict.protocol.keyed import ROOT, Keyed, KeyedReceiver, KeyedSender, prefix
from hri_predict.protocol.messages import Message
from hri_predict.protocol.own_frames import OwnFrames
from hri_predict.protocol.wire import SIX_JOINTS, StateShape, wire_bits

OVERHEAD_BITS = 8 * 160
"""Maximum overhead of a message on Ethernet: 38 + 52 bytes of Ethernet, IPv6 and TCP (with gap and
timestamps), the rest for zenoh's own header and the key."""
MBIT = 1_000_000
OF_A_NODE = ("status", "advice/*", "schema")
"""Keys under which only a cell's node sends; the link detects a second node that uses them."""


class ZenohLinkSettings(CellSettings, ConfiguredLinkSettings):
    """An entry of ``links:`` with ``kind: zenoh``."""

    kind: str = "zenoh"
    take: bool = Field(
        False, description="whether to receive RobotState and Acknowledge from a controller"
    )
    bitrate: int = Field(
        10 * MBIT,
        ge=MBIT,
        le=10**6 * MBIT,
        description="network bandwidth that this link may use, bit/s",
    )
    wait_for_device: bool = Field(
        True, description="start without a connection, so that no cell waits for a router"
    )

    safety: ClassVar[Safety] = harmless("take", "bitrate")

    @model_validator(mode="after")
    def _nobody_is_simulated(self) -> Self:
        if self.simulate is not None:
            raise ValueError("a zenoh link has no simulated controller; leave 'simulate' out")
        return self


class ZenohCodec(FrameCodec[Keyed]):
    """Messages as payloads under keys; see ``hri_drivers.links.codec.Codec``."""

    def __init__(self, bitrate: int) -> None:
        super().__init__(KeyedReceiver())
        self._sender = KeyedSender()
        self._bitrate = bitrate

    def watch(self, own: OwnFrames) -> None:
        """See ``Codec``."""
        self._sender.watch(own)
        self._receiver.watch(own)

    def encode(self, message: Message) -> list[Keyed]:
        """One payload."""
        return [self._sender.encode(message)]

    def worst_s(self, message: Message) -> float:
        """Worst-case seconds on the network of the message."""
        return worst_bits(type(message), item_count(message), shape_of(message)) / self._bitrate

    def unit_s(self, unit: Keyed) -> float:
        """Seconds on the network of this payload."""
        return (OVERHEAD_BITS + 8 * len(unit.data)) / self._bitrate

    def raw(self, unit: Keyed) -> bytes:
        """The payload."""
        return unit.data

    def size(self, unit: Keyed) -> int:
        """Number of payload bytes."""
        return len(unit.data)


def worst_bits(
    message: type[Message], items: int | None = None, shape: StateShape = SIX_JOINTS
) -> int:
    """Worst-case bits of one message: the same bytes as on a serial line, plus the overhead."""
    return OVERHEAD_BITS + wire_bits(message, "serial", items=items, shape=shape).nominal * 8 // 10


class ZenohLink(ConfiguredLink[ZenohLinkSettings, Keyed]):
    """``hri_predict.contracts.link.Link`` over zenoh; arguments as for ``ConfiguredLink``."""

    settings_model: ClassVar[type[ZenohLinkSettings]] = ZenohLinkSettings

    @staticmethod
    def make_transport(settings: ZenohLinkSettings) -> ZenohTransport:
        """The configured session, not yet open."""
        return ZenohTransport(
            settings,
            prefix(settings.site, settings.cell),
            (*OF_A_NODE, *(("state/*", "ack") if settings.take else ())),
        )

    @staticmethod
    def _make_codec(settings: ZenohLinkSettings, wire: Transport[Keyed]) -> ZenohCodec:
        return ZenohCodec(settings.bitrate)

    @staticmethod
    def receiver(settings: ZenohLinkSettings) -> KeyedReceiver:
        """Return a decoder for this link's units, for listeners."""
        return KeyedReceiver()

    @staticmethod
    def observer(settings: ZenohSettings, site: str | None) -> ZenohTransport:
        """Return a transport for Status, Advice and Schema of all cells of one or all sites."""
        cells = f"{site or '*'}/*/"
        heard = [cells + what for what in OF_A_NODE]
        return ZenohTransport(settings, f"{ROOT}/", heard)

    @staticmethod
    def _shares(settings: ZenohLinkSettings, traffic: Traffic) -> dict[str, float]:
        return traffic.shares(
            lambda message, shape: worst_bits(message, shape=shape) / settings.bitrate,
            settings.robot_state_rate_hz if settings.take else 0.0,
        )

    @staticmethod
    def _bitrate(settings: ZenohLinkSettings) -> int:
        return settings.bitrate
