"""Zone and Pose over classic CAN by ISO-TP (ISO 15765-2:2016), to the one peer that answers.

The segmenting is can-isotp's; the link writes the frames, each when the wire is free and whatever
is urgent has gone. An Advice therefore never waits for a segmented message, only for one frame.
"""

import logging
from collections import deque
from math import ceil
from typing import Any

from hri_drivers.link_bulk import Bulk
from hri_drivers.link_codec import Codec
from hri_drivers.link_slots import BULK, Budget, Slots
from hri_drivers.serial_link import item_count
from hri_predict.errors import LinkError
from hri_predict.link import LinkCounters
from hri_predict.protocol import e2e
from hri_predict.protocol.can_codec import CanFrame, CanReceiver
from hri_predict.protocol.definition import BY_TYPE, MAX_ITEMS
from hri_predict.protocol.messages import Message, at_encoding
from hri_predict.protocol.profile4_codec import MAX_WHOLE, Profile4Receiver, Profile4Sender
from hri_predict.protocol.wire import WireBits, classic_bits

ISOTP_NUMBER = 0x46  # the node's segments, where no other id is configured: base id plus this
FLOW_CONTROL_NUMBER = 0x47  # the peer's answers, if it has no other id in mind
TRANSFER_LIMIT_NS = 1_000_000_000  # ISO 15765-2's N_Bs; a zone that old is of no use either
MAX_WAITS = 10  # flow control "wait" in a row
PADDING = 0xCC  # ISO 15765-2: unused bytes, which cause few stuff bits
_FLOW_CONTROL = 3
_ANSWERS = 64  # of the peer's, kept until the writer looks
_LOGGER = "hri_drivers.isotp"
logging.getLogger(_LOGGER).setLevel(logging.CRITICAL)  # what fails is counted and shown instead


def isotp_bits(message: Message, extended: bool) -> WireBits:
    """Worst-case bits of a whole Zone or Pose with one flow control frame."""
    definition = BY_TYPE[type(message)]
    items = item_count(message) or 0
    length = e2e.PROFILE_4_HEADER + definition.fixed_bytes + items * definition.item_bytes
    frames = 2 + ceil((length - 6) / 7)
    return WireBits(frames * classic_bits(8, extended), 0)


class IsoTpTransfer:
    """One segmented message at a time to one peer.

    ``feed`` belongs to the link's reading thread, all else to its writing thread.

    Args:
        own_id: id of our segments.
        peer_id: id of the peer's flow control.
        extended: 29-bit ids.

    Attributes:
        active: whether segments of a message are still to come.

    Raises:
        LinkError: can-isotp is not installed.
    """

    def __init__(self, own_id: int, peer_id: int, extended: bool) -> None:
        self.peer_id = peer_id
        self._extended = extended
        self._answers: deque[bytes] = deque(maxlen=_ANSWERS)
        self._frames: list[CanFrame] = []
        self._failure: str | None = None
        self._began_ns = 0
        self.active = False
        self._layer: Any = _layer(
            own_id, peer_id, extended, self._answer, self._transmit, self._failed
        )

    def feed(self, frame: CanFrame) -> bool:
        """Take a frame from the bus; ``False`` if it is not the peer's."""
        if (frame.arbitration_id, frame.extended, frame.fd) != (
            self.peer_id,
            self._extended,
            False,
        ):
            return False
        if frame.data and frame.data[0] >> 4 == _FLOW_CONTROL:  # nothing else is expected of it
            self._answers.append(frame.data)
        return True

    def begin(self, payload: bytes, now_ns: int) -> None:
        """Start with a message; answers to earlier ones are forgotten."""
        self._answers.clear()
        self._failure = None
        self._began_ns = now_ns
        self._layer.send(payload)
        self.active = True

    def frames(self, now_ns: int) -> list[CanFrame]:
        """The frames that the peer lets go now, in order.

        Raises:
            ValueError: the peer does not answer, or does not want the message; it is given up.
        """
        self._layer.process()
        if self._layer.transmitting() and now_ns - self._began_ns > TRANSFER_LIMIT_NS:
            self._failure = "did not let it pass within a second"
        if self._failure is not None:
            failure = self._failure
            self.stop()
            raise ValueError(
                f"ISO-TP peer {self.peer_id:#x}: {failure}; check that it runs and takes zones"
            )
        self.active = bool(self._layer.transmitting())
        frames, self._frames = self._frames, []
        return frames

    def patience_s(self) -> float | None:
        """How long the link may sleep, ``None`` if nothing is under way."""
        if not self.active:
            return None
        delay = self._layer.next_cf_delay()
        return TRANSFER_LIMIT_NS * 1e-9 if delay is None else max(0.0005, delay)

    def stop(self) -> None:
        """Give up what is under way."""
        self._layer.reset()
        self._frames.clear()
        self._failure, self.active = None, False

    def _answer(self, timeout: float) -> Any:
        if not self._answers:
            return None
        return _can_message(self.peer_id, self._answers.popleft(), self._extended)

    def _transmit(self, message: Any) -> None:
        self._frames.append(
            CanFrame(message.arbitration_id, bytes(message.data), extended=self._extended)
        )

    def _failed(self, error: Exception) -> None:
        if self.active:  # else a late answer, to what has gone or was given up
            self._failure = _FAILURES.get(type(error).__name__, type(error).__name__)


_FAILURES = {
    "FlowControlTimeoutError": "no flow control within a second",
    "OverflowError": "has no room for the message",
    "MaximumWaitFrameReachedError": "asked to wait too often",
}


class IsoTpBulk(Bulk[CanFrame]):
    """Zone and Pose whole, one after the other, as fast as peer, wire and budget let."""

    def __init__(
        self,
        slots: Slots,
        codec: Codec[CanFrame],
        budget: Budget,
        counters: LinkCounters,
        transfer: IsoTpTransfer,
    ) -> None:
        super().__init__(slots, codec, budget, counters)
        self._transfer = transfer
        self._sender = Profile4Sender(MAX_ITEMS)

    @property
    def waiting(self) -> bool:
        """So too if the peer may have answered: its answer may come before the wire is free."""
        return self._transfer.active or super().waiting

    def patience_s(self) -> float | None:
        """Until the next segment may go, at most."""
        return self._transfer.patience_s()

    def next(self, now_ns: int) -> CanFrame | None:
        """The segment to write next, ``None`` if none may go now.

        Raises:
            ValueError: a message was given up, because of a value in it or because of the peer.
        """
        if not self._under_way:
            if not self._transfer.active:
                message = self._take(now_ns)
                if message is None:
                    return None
                (whole,) = self._sender.encode(at_encoding(message, now_ns))
                self._transfer.begin(whole, now_ns)
            self._under_way.extend(self._transfer.frames(now_ns))
        return self._under_way[0] if self._under_way else None

    def sent(self) -> bool:
        """Note that a segment was written; whether that was the end of a message."""
        return super().sent() and not self._transfer.active

    def give_up(self) -> None:
        """Forget the message under way."""
        self._counters.decimated += bool(self._under_way) or self._transfer.active
        self._under_way.clear()
        self._transfer.stop()


class IsoTpReceiver(CanReceiver):
    """A receiver of classic CAN that hears Zone and Pose too, sent to whomever; it never answers.

    Args:
        base_id, extended: as for ``CanReceiver``.
        own_id: id of the node's segments.

    Raises:
        LinkError: can-isotp is not installed.
    """

    def __init__(self, base_id: int, extended: bool, own_id: int) -> None:
        super().__init__(False, base_id, extended)
        self._own_id = own_id
        self._segments: deque[bytes] = deque()
        self._packets = Profile4Receiver(MAX_ITEMS)
        self._packets.counters = self.counters
        self._layer: Any = _layer(
            None, own_id, extended, self._segment, lambda message: None, self._failed
        )

    def reset(self) -> None:
        """Forget sequences and what is under way; counters stay."""
        super().reset()
        self._packets.reset()
        self._layer.reset()

    def feed(self, frame: CanFrame) -> list[Message]:
        """Take one frame from the bus; return the message that it completes, if it is fresh."""
        mine = (frame.arbitration_id, frame.extended, frame.fd)
        if mine != (self._own_id, self._extended, False):
            return super().feed(frame)
        self._segments.append(frame.data)
        self._layer.process()
        messages: list[Message] = []
        while (whole := self._layer.recv()) is not None:
            message = self._packets.take(bytes(whole))
            if isinstance(message, BULK):
                messages.append(message)
            elif message is not None:  # right, but nothing that may come this way
                self.counters.malformed += 1
        return messages

    def _segment(self, timeout: float) -> Any:
        if not self._segments:
            return None
        return _can_message(self._own_id, self._segments.popleft(), self._extended)

    def _failed(self, error: Exception) -> None:
        self.counters.incomplete += 1


def _layer(
    own_id: int | None, peer_id: int, extended: bool, receive: Any, transmit: Any, failed: Any
) -> Any:
    """can-isotp's state machine, without threads; it only listens if ``own_id`` is ``None``.

    Its own timers run on real time: the time that counts is ``TRANSFER_LIMIT_NS`` on the node's
    clock; can-isotp's are longer, but for the pause between segments that the peer asks for.
    """
    isotp = _isotp()
    mode = isotp.AddressingMode.Normal_29bits if extended else isotp.AddressingMode.Normal_11bits
    sender = own_id if own_id is not None else peer_id ^ 1  # a listener never sends
    return isotp.TransportLayerLogic(
        rxfn=receive,
        txfn=transmit,
        address=isotp.Address(mode, rxid=peer_id, txid=sender),
        error_handler=failed,
        params={
            "tx_padding": PADDING,
            "wftmax": MAX_WAITS,
            "rx_flowcontrol_timeout": 2000,
            "max_frame_size": MAX_WHOLE,
            "listen_mode": own_id is None,
            "logger_name": _LOGGER,
        },
    )


def _can_message(identifier: int, data: bytes, extended: bool) -> Any:
    return _isotp().CanMessage(
        arbitration_id=identifier, dlc=len(data), data=data, extended_id=extended
    )


def _isotp() -> Any:
    try:
        import isotp
    except ImportError as error:
        raise LinkError(
            "ISO-TP needs can-isotp; install it with: pip install 'hri-predict[isotp]'"
        ) from error
    return isotp


def is_available() -> bool:
    """Whether can-isotp is installed."""
    try:
        _isotp()
    except LinkError:
        return False
    return True
