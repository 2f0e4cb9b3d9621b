"""A link to a robot controller over CAN, classic or FD."""

from collections.abc import Sequence
from typing import Any, ClassVar, Self

from pydantic import Field, model_validator

from hri_drivers.can_transport import CanTransport, check_interface
from hri_drivers.link_load import check_load, link_load
from hri_drivers.link_slots import BULK, Budget
from hri_drivers.link_thread import BULK_AHEAD_NS, SupervisedLink
from hri_drivers.serial_link import item_count
from hri_drivers.transport import Transport
from hri_predict.clock import Clock
from hri_predict.errors import ConfigError, LinkError
from hri_predict.link import LinkCounters, LinkLoad, LinkSettings
from hri_predict.protocol.can_codec import (
    CLASSIC_BYTES,
    DEFAULT_BASE_ID,
    CanFrame,
    CanReceiver,
    CanSender,
    check_base_id,
)
from hri_predict.protocol.messages import Message
from hri_predict.protocol.wire import LinkKind, WireBits, classic_bits, fd_bits, wire_bits


class CanLinkSettings(LinkSettings):
    """An entry of ``links:`` with ``kind: can``."""

    kind: str = "can"
    interface: str = Field(description="any that python-can knows: socketcan, slcan, pcan, ...")
    channel: str | None = Field(
        None,
        min_length=1,
        description="can0, /dev/ttyACM0, 239.74.163.2, ...; not needed with 'simulate'",
    )
    bitrate: int = Field(500_000, ge=10_000, le=1_000_000)
    fd: bool = Field(False, description="CAN FD; the only kind that carries Zone and Pose")
    data_bitrate: int = Field(2_000_000, ge=10_000, le=12_000_000)
    base_id: int = Field(DEFAULT_BASE_ID, ge=0, description="id of the first of our frames")
    extended: bool = Field(False, description="29-bit ids")
    options: dict[str, Any] = Field({}, description="further arguments of python-can's bus")
    robot_state_rate_hz: float = Field(
        50.0, ge=0, le=1000, description="how often the controller sends RobotState"
    )
    wait_for_device: bool = Field(
        False, description="start although the interface is not there yet, and go on trying"
    )

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        try:
            check_interface(self.interface)
            check_base_id(self.base_id, self.extended)
        except (LinkError, ConfigError) as error:
            raise ValueError(str(error)) from error
        if self.channel is None and self.simulate is None:
            raise ValueError("give 'channel' (such as can0 or /dev/ttyACM0), or 'simulate'")
        if self.fd and self.data_bitrate < self.bitrate:
            raise ValueError("data_bitrate must be at least bitrate")
        return self

    @property
    def wire_kind(self) -> LinkKind:
        """Name of this kind of wire, as the protocol has it."""
        return "can_fd" if self.fd else "can"

    @property
    def blocking_s(self) -> float:
        """The longest frame under way; with FD also what is written ahead of the wire."""
        if not self.fd:
            return classic_bits(CLASSIC_BYTES, self.extended) / self.bitrate
        frames = (
            wire_bits(message, "can_fd", self.extended).seconds(self.bitrate, self.data_bitrate)
            for message in BULK
        )
        return BULK_AHEAD_NS * 1e-9 + max(frames)


class CanCodec:
    """Messages as protected frames."""

    def __init__(self, settings: CanLinkSettings, transport: object = None) -> None:
        self._settings = settings
        self._transport = transport
        self._sender = CanSender(settings.fd, settings.base_id, settings.extended)
        self._receiver = CanReceiver(settings.fd, settings.base_id, settings.extended)

    def carries(self, message: Message) -> bool:
        """On classic CAN all but Zone and Pose."""
        return self._sender.carries(type(message))

    def encode(self, message: Message) -> list[CanFrame]:
        """Frames of the message, in order."""
        return self._sender.encode(message)

    def decode(self, unit: CanFrame) -> list[Message]:
        """The message that this frame completes, if any."""
        return self._receiver.feed(unit)

    def reset(self) -> None:
        """Forget what was under way."""
        self._receiver.reset()

    def count(self, counters: LinkCounters) -> None:
        """Copy the receiver's counts, and the transport's where it has some."""
        mine = self._receiver.counters
        counters.crc_errors = mine.crc_errors
        counters.counter_errors = mine.counter_errors
        counters.malformed = mine.malformed + int(getattr(self._transport, "malformed", 0))
        counters.incomplete = mine.incomplete
        counters.ignored = mine.ignored
        counters.bus_errors = int(getattr(self._transport, "bus_errors", 0))

    def worst_s(self, message: Message) -> float:
        """Seconds of wire of such a message, at worst."""
        s = self._settings
        bits = wire_bits(type(message), s.wire_kind, s.extended, item_count(message))
        return bits.seconds(s.bitrate, s.data_bitrate)

    def unit_s(self, unit: CanFrame) -> float:
        """Seconds of wire of a frame, at worst."""
        if unit.fd:
            bits = fd_bits(len(unit.data), unit.extended)
        else:
            bits = WireBits(classic_bits(len(unit.data), unit.extended), 0)
        return bits.seconds(self._settings.bitrate, self._settings.data_bitrate)

    def raw(self, unit: CanFrame) -> bytes:
        """SocketCAN's id word (big-endian, bit 31 marks 29-bit ids), then the data."""
        identifier = unit.arbitration_id | (0x8000_0000 if unit.extended else 0)
        return identifier.to_bytes(4, "big") + unit.data

    def size(self, unit: CanFrame) -> int:
        """Bytes of data."""
        return len(unit.data)


class CanLink(SupervisedLink[CanFrame]):
    """``hri_predict.link.Link`` over CAN; arguments as for ``SerialLink``."""

    settings_model: ClassVar[type[CanLinkSettings]] = CanLinkSettings
    port_field: ClassVar[str] = "channel"  # of the settings: what a simulated other end fills in

    def __init__(
        self,
        settings: CanLinkSettings,
        clock: Clock,
        transport: Transport[CanFrame] | None = None,
        *,
        rate_hz: float = 25.0,
        robots: Sequence[int] = (0,),
    ) -> None:
        load = self.load(settings, rate_hz, robots)
        wire = transport if transport is not None else self.make_transport(settings)
        super().__init__(
            settings,
            clock,
            wire,
            CanCodec(settings, wire),
            Budget(max(0.0, load.spare)),
            settings.wait_for_device,
        )

    @staticmethod
    def make_transport(settings: CanLinkSettings) -> CanTransport:
        """The configured interface, not yet open.

        Raises:
            LinkError: no channel is configured.
        """
        if settings.channel is None:
            raise LinkError(
                f"link '{settings.name}': no 'channel'; the mock controller gives it one"
            )
        options = dict(settings.options)
        if settings.simulate is not None and settings.interface == "slcan":
            options.setdefault("sleep_after_open", 0)  # a simulated adapter need not boot
        return CanTransport(
            settings.interface,
            settings.channel,
            settings.bitrate,
            settings.fd,
            settings.data_bitrate,
            options,
        )

    @staticmethod
    def load(settings: CanLinkSettings, rate_hz: float, robots: Sequence[int] = (0,)) -> LinkLoad:
        """How full the bus will be; see ``check_load``."""
        return link_load(
            settings.name,
            settings.wire_kind,
            settings.bitrate,
            settings.data_bitrate,
            settings.extended,
            rate_hz,
            len(robots),
            settings.robot_state_rate_hz,
            settings.reserved_load,
        )

    @classmethod
    def check_load(
        cls, settings: CanLinkSettings, rate_hz: float, robots: Sequence[int] = (0,)
    ) -> None:
        """Refuse a link that cannot carry what must always fit.

        Raises:
            LinkError: one line with the load and what would fit.
        """
        check_load(cls.load(settings, rate_hz, robots))

    @staticmethod
    def receiver(settings: CanLinkSettings) -> CanReceiver:
        """What decodes this link's units, for whoever only listens."""
        return CanReceiver(settings.fd, settings.base_id, settings.extended)
