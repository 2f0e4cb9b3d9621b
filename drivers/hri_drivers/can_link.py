"""A link to a robot controller over CAN, classic or FD."""

import logging
from collections.abc import Sequence
from dataclasses import replace
from typing import ClassVar

from hri_drivers.can_isotp import (
    IsoTpBulk,
    IsoTpReceiver,
    IsoTpTransfer,
    is_available,
    isotp_bits,
)
from hri_drivers.can_settings import CanLinkSettings, check_together, id_filters
from hri_drivers.can_transport import CanTransport
from hri_drivers.link_codec import copy_counts
from hri_drivers.link_load import check_load, link_load
from hri_drivers.link_slots import BULK, Budget
from hri_drivers.link_thread import SupervisedLink
from hri_drivers.serial_link import item_count
from hri_drivers.transport import Transport
from hri_predict.clock import Clock
from hri_predict.errors import LinkError
from hri_predict.link import LinkCounters, LinkLoad
from hri_predict.protocol.can_codec import CanFrame, CanReceiver, CanSender
from hri_predict.protocol.messages import Message, RobotState
from hri_predict.protocol.wire import WireBits, classic_bits, fd_bits, wire_bits

log = logging.getLogger(__name__)

__all__ = ["CanCodec", "CanLink", "CanLinkSettings"]


class CanCodec:
    """Messages as protected frames.

    Args:
        settings: the link's.
        transport: whose counts are shown, where it has some.
        transfer: takes the ISO-TP peer's frames, where there is one.
    """

    def __init__(
        self,
        settings: CanLinkSettings,
        transport: object = None,
        transfer: IsoTpTransfer | None = None,
    ) -> None:
        self._settings = settings
        self._transport = transport
        self._transfer = transfer
        self._sender = CanSender(settings.fd, settings.base_id, settings.extended)
        self._receiver = CanReceiver(settings.fd, settings.base_id, settings.extended)

    def carries(self, message: Message) -> bool:
        """On classic CAN Zone and Pose only by ISO-TP; nothing if the link only listens."""
        if self._settings.listen_only:
            return False
        if isinstance(message, BULK) and self._transfer is not None:
            return True
        return self._sender.carries(type(message))

    def encode(self, message: Message) -> list[CanFrame]:
        """Frames of the message, in order."""
        return self._sender.encode(message)

    def decode(self, unit: CanFrame) -> list[Message]:
        """The message that this frame completes, if any."""
        if self._transfer is not None and self._transfer.feed(unit):
            return []
        return self._receiver.feed(unit)

    def reset(self) -> None:
        """Forget what was under way."""
        self._receiver.reset()

    def count(self, counters: LinkCounters) -> None:
        """Copy the receiver's counts, and the transport's where it has some."""
        no_frames = int(getattr(self._transport, "malformed", 0))
        copy_counts(self._receiver.counters, counters, no_frames)
        health = getattr(self._transport, "health", None)
        if health is not None:
            counters.bus_errors = health.frames
            counters.error_passive = health.passive
            counters.bus_off = health.off

    def worst_s(self, message: Message) -> float:
        """Seconds of wire of such a message, at worst."""
        s = self._settings
        if self._transfer is not None and isinstance(message, BULK):
            bits = isotp_bits(message, s.extended)
        else:
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
        device = getattr(wire, "device", wire)  # beneath injected faults
        if isinstance(device, CanTransport):
            device.on_error_frame = self._on_error_frame
        transfer = None
        if settings.isotp is not None:
            peer_id = settings.isotp.peer_id
            transfer = IsoTpTransfer(settings.isotp_id, peer_id, settings.extended)
        codec = CanCodec(settings, device, transfer)
        budget = Budget(max(0.0, load.spare))
        super().__init__(settings, clock, wire, codec, budget, settings.wait_for_device)
        self._transfer = transfer
        if transfer is not None:
            self._bulk = IsoTpBulk(self._slots, codec, budget, self.counters, transfer)

    def _receive(self, units: list[CanFrame], now_ns: int) -> None:
        super()._receive(units, now_ns)
        if self._transfer is not None and self._transfer.active:
            self._wake.set()  # its peer may have let the next segments go

    def _on_error_frame(self, trouble: str | None) -> None:
        self._codec.count(self.counters)
        if trouble is not None:
            log.warning("link '%s': %s", self.name, trouble)
            self._note(LinkError(trouble))

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
        exact = settings.interface == "socketcan"  # the kernel takes any number of filters
        return CanTransport(
            settings.interface,
            settings.channel,
            settings.bitrate,
            settings.fd,
            settings.data_bitrate,
            options,
            filters=id_filters(settings.heard_ids, settings.extended, exact),
            listen_only=settings.listen_only,
        )

    @staticmethod
    def load(settings: CanLinkSettings, rate_hz: float, robots: Sequence[int] = (0,)) -> LinkLoad:
        """How full the bus will be; see ``check_load``."""
        load = link_load(
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
        return only_heard(load) if settings.listen_only else load

    @staticmethod
    def check_together(links: Sequence[CanLinkSettings]) -> None:
        """Refuse links on one bus that would disturb each other.

        Raises:
            ConfigError: names both, and what to change.
        """
        check_together(links)

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
        if not (settings.hears_isotp and is_available()):
            return CanReceiver(settings.fd, settings.base_id, settings.extended)
        return IsoTpReceiver(settings.base_id, settings.extended, settings.isotp_id)


def only_heard(load: LinkLoad) -> LinkLoad:
    """The load of a link on which this node sends nothing."""
    heard = {name: load.details[name] for name in (RobotState.__name__,)}
    return replace(load, load=sum(heard.values()), spare=0.0, details=heard)
