"""A link to a robot controller over CAN, classic or FD."""

import logging
from collections.abc import Sequence
from dataclasses import replace
from typing import Any, ClassVar

from hri_drivers.links.can.isotp import (
    IsoTpBulk,
    IsoTpReceiver,
    IsoTpTransfer,
    is_available,
    isotp_bits,
)
from hri_drivers.links.can.packages import demand_packages
from hri_drivers.links.can.settings import CanLinkSettings, check_together, id_filters
from hri_drivers.links.can.transport import CanTransport
from hri_drivers.links.codec import copy_counts, item_count, shape_of
from hri_drivers.links.configured import ConfiguredLink
from hri_drivers.links.load import CAN_BITRATES, Traffic, check_bases
from hri_drivers.links.slots import BULK
from hri_drivers.wires.transport import Transport
from hri_predict.base.errors import LinkError
from hri_predict.contracts.link import LinkCounters, LinkLoad
from hri_predict.protocol.can import CanFrame, CanReceiver, CanSender
from hri_predict.protocol.messages import Message, RobotState
from hri_predict.protocol.own_frames import OwnFrames
from hri_predict.protocol.wire import StateShape, WireBits, classic_bits, fd_bits, wire_bits

log = logging.getLogger(__name__)

__all__ = ["CanCodec", "CanLink", "CanLinkSettings"]


class CanCodec:
    """Messages as protected frames.

    Args:
        settings: the link's.
        transport: its error counts are copied, if it has any.

    Attributes:
        transfer: receives the ISO-TP peer's frames; ``None`` without ISO-TP.
    """

    def __init__(self, settings: CanLinkSettings, transport: object = None) -> None:
        self.transfer: IsoTpTransfer | None = None
        if settings.isotp is not None:
            peer_id = settings.isotp.peer_id
            self.transfer = IsoTpTransfer(settings.isotp_id, peer_id, settings.extended)
        self._settings = settings
        self._transport = transport
        self._sender = CanSender(settings.fd, settings.base_id, settings.extended)
        self._receiver = CanReceiver(settings.fd, settings.base_id, settings.extended)
        self._own: OwnFrames | None = None
        self._others: IsoTpReceiver | None = None  # puts another node's segments together

    def watch(self, own: OwnFrames) -> None:
        """See ``Codec``. A listen-only link has no ids of its own."""
        if self._settings.listen_only:
            return
        self._sender.own = self._receiver.own = self._own = own
        if self.transfer is not None:
            self.transfer.own = own
            s = self._settings
            self._others = IsoTpReceiver(s.base_id, s.extended, s.isotp_id)
            self._others.count_in(self._receiver.counters)

    def carries(self, message: Message) -> bool:
        """Zone and Pose need ISO-TP on classic CAN; a listen-only link carries nothing."""
        if self._settings.listen_only:
            return False
        if isinstance(message, BULK) and self.transfer is not None:
            return True
        return self._sender.carries(type(message))

    def encode(self, message: Message) -> list[CanFrame]:
        """Frames of the message in sending order."""
        return self._sender.encode(message)

    def decode(self, unit: CanFrame) -> list[Message]:
        """The message that this frame completes, if any."""
        if self.transfer is not None and self.transfer.feed(unit):
            return []
        if self._own is not None and self._is_segment(unit):
            self._hear_segment(unit, self._own)
            return []
        return self._receiver.feed(unit)

    def _hear_segment(self, unit: CanFrame, own: OwnFrames) -> None:
        """Check a segment with our id: it has no CRC, so only a whole message counts."""
        if self._others is not None and not own.came_back(unit):
            own.foreign += len(self._others.feed(unit))

    def _is_segment(self, unit: CanFrame) -> bool:
        """Whether the frame has the id of our ISO-TP segments."""
        s = self._settings
        ours = (s.isotp_id, s.extended)
        return s.isotp is not None and (unit.arbitration_id, unit.extended) == ours

    def reset(self) -> None:
        """Discard incomplete messages."""
        self._receiver.reset()
        if self._others is not None:
            self._others.reset()

    def count(self, counters: LinkCounters) -> None:
        """Copy the receiver's counts, and those of the transport if it has any."""
        no_frames = int(getattr(self._transport, "malformed", 0))
        copy_counts(self._receiver.counters, counters, no_frames)
        health = getattr(self._transport, "health", None)
        if health is not None:
            counters.bus_errors = health.frames
            counters.error_passive = health.passive
            counters.bus_off = health.off

    @property
    def refused(self) -> str:
        """See ``CanReceiver``."""
        return self._receiver.refused

    def worst_s(self, message: Message) -> float:
        """Worst-case seconds on the wire of the message."""
        s = self._settings
        if self.transfer is not None and isinstance(message, BULK):
            bits = isotp_bits(message, s.extended)
        else:
            items, shape = item_count(message), shape_of(message)
            bits = wire_bits(type(message), s.wire_kind, s.extended, items, shape=shape)
        return bits.seconds(s.bitrate, s.data_bitrate)

    def unit_s(self, unit: CanFrame) -> float:
        """Worst-case seconds on the wire of a frame."""
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
        """Number of data bytes."""
        return len(unit.data)


class CanLink(ConfiguredLink[CanLinkSettings, CanFrame]):
    """``hri_predict.contracts.link.Link`` over CAN; arguments as for ``ConfiguredLink``.

    Raises:
        LinkError: a package that the interface needs is not installed, or see ``ConfiguredLink``.
    """

    settings_model: ClassVar[type[CanLinkSettings]] = CanLinkSettings
    bitrates = CAN_BITRATES
    port_field: ClassVar[str] = "channel"  # see ``Simulatable``

    @staticmethod
    def _demand(settings: CanLinkSettings) -> None:
        demand_packages(settings.name, settings.interface)

    def _prepare(self, settings: CanLinkSettings, robots: Sequence[int]) -> None:
        device = _device(self._transport)
        if isinstance(device, CanTransport):
            device.on_error_frame = self._on_error_frame
        assert isinstance(self._codec, CanCodec)
        self._transfer = self._codec.transfer
        if self._transfer is not None:
            self._bulk = IsoTpBulk(
                slots=self._slots,
                codec=self._codec,
                budget=self._bulk.budget,
                counters=self.counters,
                transfer=self._transfer,
            )

    def _receive(self, units: list[CanFrame], now_ns: int) -> None:
        super()._receive(units, now_ns)
        if self._transfer is not None and self._transfer.active:
            self._wake.set()  # the peer may have released the next segments

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
                f"link '{settings.name}': 'channel' is missing; the mock controller provides one"
            )
        options = dict(settings.options)
        if settings.simulate is not None and settings.interface == "slcan":
            options.setdefault("sleep_after_open", 0)  # a simulated adapter does not boot
        exact = settings.interface == "socketcan"  # the kernel accepts any number of filters
        return CanTransport(
            interface=settings.interface,
            channel=settings.channel,
            bitrate=settings.bitrate,
            fd=settings.fd,
            data_bitrate=settings.data_bitrate,
            options=options,
            filters=id_filters(settings.heard_ids, settings.extended, exact),
            listen_only=settings.listen_only,
        )

    @staticmethod
    def _make_codec(settings: CanLinkSettings, wire: Transport[CanFrame]) -> CanCodec:
        return CanCodec(settings, _device(wire))

    @classmethod
    def load(cls, settings: CanLinkSettings, *traffic: Any, **named: Any) -> LinkLoad:
        """Return the worst-case load of the bus; see ``LinkClass``."""
        load = super().load(settings, *traffic, **named)
        return replace(load, spare=0.0) if settings.listen_only else load

    @staticmethod
    def _shares(settings: CanLinkSettings, traffic: Traffic) -> dict[str, float]:
        if settings.wire_kind == "can":
            check_bases(settings.name, traffic)

        def seconds(message: type[Message], shape: StateShape) -> float:
            bits = wire_bits(message, settings.wire_kind, settings.extended, shape=shape)
            return bits.seconds(settings.bitrate, settings.data_bitrate)

        shares = traffic.shares(seconds, settings.robot_state_rate_hz)
        heard = RobotState.__name__
        return {heard: shares[heard]} if settings.listen_only else shares

    @staticmethod
    def _bitrate(settings: CanLinkSettings) -> int:
        return settings.bitrate

    @staticmethod
    def check_together(links: Sequence[CanLinkSettings]) -> None:
        """Refuse links that would disturb each other on one bus.

        Raises:
            ConfigError: the message names both and the necessary change.
        """
        check_together(links)

    @staticmethod
    def receiver(settings: CanLinkSettings) -> CanReceiver:
        """Return a decoder for this link's units, for listeners."""
        if not (settings.hears_isotp and is_available()):
            return CanReceiver(settings.fd, settings.base_id, settings.extended)
        return IsoTpReceiver(settings.base_id, settings.extended, settings.isotp_id)


def _device(wire: Transport[CanFrame]) -> object:
    """The transport that a fault injector wraps."""
    return getattr(wire, "device", wire)
