"""A link over zenoh: the same messages, for other machines that show or gather many cells.

Key scheme, topologies and what protects them: ``docs/fleet.md``.
"""

from collections.abc import Sequence
from typing import ClassVar, Self

from pydantic import Field, model_validator

from hri_drivers.link_codec import copy_counts
from hri_drivers.link_load import MIN_STATUS_HZ, SCHEMA_HZ, check_load
from hri_drivers.link_slots import Budget
from hri_drivers.link_thread import SupervisedLink
from hri_drivers.serial_link import item_count
from hri_drivers.transport import Transport
from hri_drivers.zenoh_session import CellSettings, ZenohSettings
from hri_drivers.zenoh_transport import ZenohTransport
from hri_predict.clock import Clock
from hri_predict.link import LinkCounters, LinkLoad, LinkSettings
from hri_predict.protocol.keyed_codec import ROOT, Keyed, KeyedReceiver, KeyedSender, prefix
from hri_predict.protocol.messages import Advice, Message, RobotState, Schema, Status
from hri_predict.protocol.wire import wire_bits

OVERHEAD_BITS = 8 * 160
"""Of a message on Ethernet at most: 38 + 52 bytes of Ethernet, IPv6 and TCP with pause and
timestamps, the rest for zenoh's own header and the key."""
MBIT = 1_000_000


class ZenohLinkSettings(CellSettings, LinkSettings):
    """An entry of ``links:`` with ``kind: zenoh``."""

    kind: str = "zenoh"
    take: bool = Field(
        False, description="whether RobotState and Acknowledge are heard: a controller is there"
    )
    robot_state_rate_hz: float = Field(
        50.0, ge=0, le=1000, description="how often the controller sends RobotState"
    )
    bitrate: int = Field(
        10 * MBIT, ge=MBIT, description="what the network may carry of this link, bit/s"
    )
    wait_for_device: bool = Field(
        True, description="start although nobody is there yet: no cell waits for a router"
    )

    @model_validator(mode="after")
    def _nobody_is_simulated(self) -> Self:
        if self.simulate is not None:
            raise ValueError("a zenoh link has no simulated controller; leave 'simulate' out")
        return self


class ZenohCodec:
    """Messages as payloads under keys; see ``link_codec.Codec``."""

    def __init__(self, bitrate: int) -> None:
        self._sender = KeyedSender()
        self._receiver = KeyedReceiver()
        self._bitrate = bitrate

    def carries(self, message: Message) -> bool:
        """Everything."""
        return True

    def encode(self, message: Message) -> list[Keyed]:
        """One payload."""
        return [self._sender.encode(message)]

    def decode(self, unit: Keyed) -> list[Message]:
        """Messages of a payload."""
        return self._receiver.feed(unit)

    def reset(self) -> None:
        """Forget sequences."""
        self._receiver.reset()

    def count(self, counters: LinkCounters) -> None:
        """Copy the receiver's counts."""
        copy_counts(self._receiver.counters, counters)

    def worst_s(self, message: Message) -> float:
        """Seconds of network of such a message."""
        return worst_bits(type(message), item_count(message)) / self._bitrate

    def unit_s(self, unit: Keyed) -> float:
        """Seconds of network of this payload."""
        return (OVERHEAD_BITS + 8 * len(unit.data)) / self._bitrate

    def raw(self, unit: Keyed) -> bytes:
        """The payload."""
        return unit.data

    def size(self, unit: Keyed) -> int:
        """Bytes of payload."""
        return len(unit.data)


def worst_bits(message: type[Message], items: int | None = None) -> int:
    """Bits of one message at most; a serial line's count of its bytes, and the overhead."""
    return OVERHEAD_BITS + wire_bits(message, "serial", items=items).nominal * 8 // 10


class ZenohLink(SupervisedLink[Keyed]):
    """``hri_predict.link.Link`` over zenoh.

    Args:
        settings: the link's.
        clock: the node's.
        transport: if not the configured session (a fault injector).
        rate_hz: the node's cycle, from which the room for Zone and Pose follows.
        robots: indices of the robots that are advised on this link.
    """

    settings_model: ClassVar[type[ZenohLinkSettings]] = ZenohLinkSettings

    def __init__(
        self,
        settings: ZenohLinkSettings,
        clock: Clock,
        transport: Transport[Keyed] | None = None,
        *,
        rate_hz: float = 25.0,
        robots: Sequence[int] = (0,),
    ) -> None:
        load = self.load(settings, rate_hz, robots)
        super().__init__(
            settings,
            clock,
            transport if transport is not None else self.make_transport(settings),
            ZenohCodec(settings.bitrate),
            Budget(max(0.0, load.spare)),
            settings.wait_for_device,
        )

    @staticmethod
    def make_transport(settings: ZenohLinkSettings) -> ZenohTransport:
        """The configured session, not yet open."""
        return ZenohTransport(
            settings,
            prefix(settings.site, settings.cell),
            ("state/*", "ack") if settings.take else (),
        )

    @staticmethod
    def receiver(settings: ZenohLinkSettings) -> KeyedReceiver:
        """What decodes this link's units, for whoever only listens."""
        return KeyedReceiver()

    @staticmethod
    def observer(settings: ZenohSettings, site: str | None) -> ZenohTransport:
        """What hears the Status, Advice and Schema of all cells of one site, or of all sites."""
        cells = f"{site or '*'}/*/"
        heard = [cells + what for what in ("status", "advice/*", "schema")]
        return ZenohTransport(settings, f"{ROOT}/", heard)

    @staticmethod
    def load(settings: ZenohLinkSettings, rate_hz: float, robots: Sequence[int] = (0,)) -> LinkLoad:
        """How much of ``bitrate`` the link takes; see ``check_load``."""
        rates: dict[type[Message], float] = {
            Status: max(rate_hz, MIN_STATUS_HZ),
            Advice: rate_hz * len(robots),
            Schema: SCHEMA_HZ,
            RobotState: settings.robot_state_rate_hz * len(robots) if settings.take else 0.0,
        }
        details = {m.__name__: r * worst_bits(m) / settings.bitrate for m, r in rates.items()}
        load = sum(details.values())
        spare = 1.0 - load - settings.reserved_load
        return LinkLoad(settings.name, load, spare, details, rate_hz, settings.bitrate)

    @classmethod
    def check_load(
        cls, settings: ZenohLinkSettings, rate_hz: float, robots: Sequence[int] = (0,)
    ) -> None:
        """Refuse a link that cannot carry what must always fit.

        Raises:
            LinkError: one line with the load and what would fit.
        """
        check_load(cls.load(settings, rate_hz, robots))
