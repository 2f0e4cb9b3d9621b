"""A link over any wire of bytes: the node's own protected frames, as on a serial line.

A kind of link that derives from ``FramedLink`` provides only settings and a transport. Code that
reads the serial line (``drivers/c``, ``drivers/plc``) also reads this link.
"""

import logging
from typing import ClassVar, Generic, TypeVar

from hri_drivers.links.codec import FrameCodec, item_count, shape_of
from hri_drivers.links.configured import ConfiguredLink, ConfiguredLinkSettings
from hri_drivers.links.load import BAUDRATES, Traffic
from hri_drivers.links.slots import BULK
from hri_drivers.links.supervised import BULK_AHEAD_NS
from hri_drivers.wires.transport import Transport
from hri_predict.base.errors import LinkError
from hri_predict.protocol.messages import Message
from hri_predict.protocol.own_frames import OwnFrames
from hri_predict.protocol.serial import SerialReceiver, SerialSender
from hri_predict.protocol.wire import StateShape, wire_bits

log = logging.getLogger(__name__)

BITS_PER_BYTE = 10  # start bit, eight data bits, stop bit: what ``wire_bits`` counts
NOISE_BYTES = 1000
"""Number of bytes that contain at least one frame if the other end sends frames; the longest has
255."""
NETWORK_BITRATE = 10_000_000.0


class FramedLinkSettings(ConfiguredLinkSettings):
    """Settings common to all links over a wire of bytes."""

    @property
    def bitrate_8n1(self) -> float:
        """Bit rate, in bit/s, of an equally fast line without parity and with one stop bit.

        For a network 10 Mbit/s, unless a derived class overrides it.
        """
        return NETWORK_BITRATE

    @property
    def blocking_s(self) -> float:
        """Time of the bytes written ahead, plus that of the longest frame of a Zone or Pose."""
        if not self.zones:
            return 0.0
        frames = (wire_bits(message, "serial").seconds(self.bitrate_8n1) for message in BULK)
        return BULK_AHEAD_NS * 1e-9 + max(frames)


S = TypeVar("S", bound=FramedLinkSettings)


class SerialCodec(FrameCodec[bytes]):
    """Messages as protected packets on a serial line; ``bitrate_8n1`` as in its settings.

    ``with_items``: whether received Zones and Poses are unpacked completely.
    """

    def __init__(self, bitrate_8n1: float, *, with_items: bool = True) -> None:
        super().__init__(SerialReceiver(with_items=with_items))
        self._sender = SerialSender()
        self._bitrate_8n1 = bitrate_8n1

    def watch(self, own: OwnFrames) -> None:
        """See ``Codec``."""
        self._sender.watch(own)
        self._receiver.watch(own)

    def encode(self, message: Message) -> list[bytes]:
        """Packets of the message, each with its delimiter."""
        return [packet + b"\0" for packet in self._sender.encode(message).split(b"\0")[:-1]]

    def worst_s(self, message: Message) -> float:
        """Worst-case seconds on the wire of the message."""
        bits = wire_bits(
            type(message), "serial", items=item_count(message), shape=shape_of(message)
        )
        return bits.seconds(self._bitrate_8n1)

    def unit_s(self, unit: bytes) -> float:
        """Seconds on the wire of these bytes."""
        return BITS_PER_BYTE * len(unit) / self._bitrate_8n1

    def raw(self, unit: bytes) -> bytes:
        """The bytes."""
        return unit

    def size(self, unit: bytes) -> int:
        """Return the number of bytes."""
        return len(unit)


class FramedLink(ConfiguredLink[S, bytes], Generic[S]):
    """``contracts.link.Link`` over a wire of bytes; arguments as for ``ConfiguredLink``.

    A derived class sets ``settings_model`` and defines ``make_transport``.
    """

    settings_model: ClassVar[type[FramedLinkSettings]] = FramedLinkSettings
    bitrates = BAUDRATES
    _noise_said = False

    def _receive(self, units: list[bytes], now_ns: int) -> None:
        """See ``SupervisedLink``; log once if the received bytes contain no frames."""
        super()._receive(units, now_ns)
        counts = self.counters
        heard = counts.messages_received + counts.echoes + counts.unexpected + counts.foreign
        if getattr(self._codec, "refused", ""):  # whole frames: only what they hold is wrong
            return
        if heard or self._noise_said or counts.bytes_received < NOISE_BYTES:
            return
        self._noise_said = True
        said = (
            f"bytes arrive ({counts.bytes_received}), but no frame: check that both ends have the "
            f"same baud rate, parity and stop bits, and that the wire carries raw bytes (no CR/LF "
            f"translation, no text mode)"
        )
        log.warning("link '%s': %s", self.name, said)
        self._note(LinkError(said))

    @staticmethod
    def _make_codec(settings: S, wire: Transport[bytes]) -> SerialCodec:
        return SerialCodec(settings.bitrate_8n1)

    @staticmethod
    def _shares(settings: S, traffic: Traffic) -> dict[str, float]:
        def seconds(message: type[Message], shape: StateShape) -> float:
            return wire_bits(message, "serial", shape=shape).seconds(settings.bitrate_8n1)

        return traffic.shares(seconds, settings.robot_state_rate_hz)

    @staticmethod
    def _bitrate(settings: S) -> int:
        return round(settings.bitrate_8n1)

    @staticmethod
    def receiver(settings: S) -> SerialReceiver:
        """Return a decoder of this link's units, for programs that only listen."""
        return SerialReceiver()
