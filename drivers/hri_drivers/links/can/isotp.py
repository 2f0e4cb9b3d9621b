"""Zone and Pose over classic CAN with ISO-TP (ISO 15765-2:2016), to one peer.

The library can-isotp segments the messages. The link writes each frame when the wire is free and no
urgent message waits. An Advice therefore waits for one frame at most, never for a whole segmented
message.
"""

import logging
from collections import deque
from math import ceil
from typing import Any

from hri_drivers.links.bulk import Bulk
from hri_drivers.links.codec import Codec, item_count
from hri_drivers.links.slots import BULK, Budget, Slots
from hri_drivers.wires.backoff import BackOff
from hri_predict.base.errors import LinkError
from hri_predict.contracts.link import LinkCounters
from hri_predict.protocol import e2e
from hri_predict.protocol.can import CanFrame, CanReceiver
from hri_predict.protocol.definition import BY_TYPE, MAX_ITEMS
from hri_predict.protocol.messages import Message, at_encoding
from hri_predict.protocol.own_frames import OwnFrames
from hri_predict.protocol.profile4 import MAX_WHOLE, Profile4Receiver, Profile4Sender
from hri_predict.protocol.reception import ReceiveCounters
from hri_predict.protocol.wire import WireBits, classic_bits

TRANSFER_LIMIT_NS = 1_000_000_000  # N_Bs of ISO 15765-2; an older zone is useless anyway
MAX_WAITS = 10  # flow control "wait" in a row
PADDING = 0xCC  # ISO 15765-2: unused bytes; this value causes few stuff bits
_FLOW_CONTROL = 3
_ANSWERS = 64  # answers of the peer, kept for the writer
_LOGGER = "hri_drivers.isotp"
logging.getLogger(_LOGGER).setLevel(logging.CRITICAL)  # failures are counted and shown instead


def isotp_bits(message: Message, extended: bool) -> WireBits:
    """Worst-case bits of a whole Zone or Pose with one flow control frame."""
    definition = BY_TYPE[type(message)]
    items = item_count(message) or 0
    length = e2e.PROFILE_4_HEADER + definition.fixed_bytes + items * definition.item_bytes
    frames = 2 + ceil((length - 6) / 7)
    return WireBits(frames * classic_bits(8, extended), 0)


class IsoTpTransfer:
    """Sends one segmented message at a time to one peer.

    The link's reading thread calls ``feed``; its writing thread calls all other methods.

    Args:
        own_id: id of our segments.
        peer_id: id of the peer's flow control.
        extended: 29-bit ids.

    Attributes:
        active: whether segments of a message remain to be sent.
        own: records the segments that were sent, if set.

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
        self.own: OwnFrames | None = None
        self._layer: Any = _layer(
            own_id=own_id,
            peer_id=peer_id,
            extended=extended,
            receive=self._answer,
            transmit=self._transmit,
            failed=self._failed,
        )

    def feed(self, frame: CanFrame) -> bool:
        """Process a frame from the bus; ``False`` if it is not from the peer."""
        if (frame.arbitration_id, frame.extended, frame.fd) != (
            self.peer_id,
            self._extended,
            False,
        ):
            return False
        if frame.data and frame.data[0] >> 4 == _FLOW_CONTROL:  # the peer should send nothing else
            self._answers.append(frame.data)
        return True

    def begin(self, payload: bytes, now_ns: int) -> None:
        """Start a message; discard answers to earlier ones."""
        self._answers.clear()
        self._failure = None
        self._began_ns = now_ns
        self._layer.send(payload)
        self.active = True

    def frames(self, now_ns: int) -> list[CanFrame]:
        """Return the frames that the peer permits us to send now, in order.

        Raises:
            ValueError: the peer does not answer or refuses the message; the message is dropped.
        """
        self._layer.process()
        if self._layer.transmitting() and now_ns - self._began_ns > TRANSFER_LIMIT_NS:
            self._failure = "it did not accept the whole message within a second"
        if self._failure is not None:
            failure = self._failure
            self.stop()
            raise ValueError(
                f"ISO-TP peer {self.peer_id:#x}: {failure}; check that it runs and accepts zones"
            )
        self.active = bool(self._layer.transmitting())
        frames, self._frames = self._frames, []
        return frames

    def patience_s(self) -> float | None:
        """Return the maximum sleep of the link; ``None`` if no message is in transit."""
        if not self.active:
            return None
        delay = self._layer.next_cf_delay()
        return TRANSFER_LIMIT_NS * 1e-9 if delay is None else max(0.0005, delay)

    def stop(self) -> None:
        """Drop the message under way."""
        self._layer.reset()
        self._frames.clear()
        self._failure, self.active = None, False

    def _answer(self, timeout: float) -> Any:
        if not self._answers:
            return None
        return _can_message(self.peer_id, self._answers.popleft(), self._extended)

    def _transmit(self, message: Any) -> None:
        frame = CanFrame(message.arbitration_id, bytes(message.data), extended=self._extended)
        if self.own is not None:
            self.own.sent(frame)
        self._frames.append(frame)

    def _failed(self, error: Exception) -> None:
        if self.active:  # else a late answer to a finished or dropped message
            self._failure = _FAILURES.get(type(error).__name__, type(error).__name__)


_FAILURES = {
    "FlowControlTimeoutError": "it sent no flow control within a second",
    "OverflowError": "it has no room for the message",
    "MaximumWaitFrameReachedError": "it requested too many waits",
}


class IsoTpBulk(Bulk[CanFrame]):
    """Whole Zones and Poses, one after the other, as fast as peer, wire and budget allow.

    A peer that refuses or does not answer is tried again after a wait that doubles with each
    failure (``BackOff``), so that retries do not fill the bus.
    """

    def __init__(
        self,
        *,
        slots: Slots,
        codec: Codec[CanFrame],
        budget: Budget,
        counters: LinkCounters,
        transfer: IsoTpTransfer,
    ) -> None:
        super().__init__(slots, codec, budget, counters)
        self._transfer = transfer
        self._sender = Profile4Sender(MAX_ITEMS)
        self._back_off = BackOff()
        self._retry_ns = 0

    @property
    def waiting(self) -> bool:
        """Return true during a transfer, too: the peer may answer before the wire is free."""
        return self._transfer.active or super().waiting

    def patience_s(self) -> float | None:
        """Return the maximum time until the next segment may be sent."""
        return self._transfer.patience_s()

    def next(self, now_ns: int) -> CanFrame | None:
        """The segment to write next, ``None`` if none may be sent now.

        Raises:
            ValueError: a message was dropped: a value does not fit, or the peer failed.
        """
        if not self._under_way:
            if not self._transfer.active:
                message = self._take(now_ns) if now_ns >= self._retry_ns else None
                if message is None:
                    return None
                (whole,) = self._sender.encode(at_encoding(message, now_ns))
                self._transfer.begin(whole, now_ns)
            try:
                self._under_way.extend(self._transfer.frames(now_ns))
            except ValueError:
                self._retry_ns = now_ns + int(self._back_off.next_s(now_ns) * 1e9)
                raise
        return self._under_way[0] if self._under_way else None

    def sent(self) -> bool:
        """Note that a segment was written; return whether it ended a message."""
        whole = super().sent() and not self._transfer.active
        if whole:
            self._back_off = BackOff()
        return whole

    def give_up(self) -> None:
        """Drop the message under way."""
        self._counters.decimated += bool(self._under_way) or self._transfer.active
        self._under_way.clear()
        self._transfer.stop()


class IsoTpReceiver(CanReceiver):
    """A receiver for classic CAN that also receives Zone and Pose over ISO-TP; it never answers.

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
            own_id=None,
            peer_id=own_id,
            extended=extended,
            receive=self._segment,
            transmit=lambda message: None,
            failed=self._failed,
        )

    def count_in(self, counters: ReceiveCounters) -> None:
        """Use these counters, which another receiver of the same link also uses."""
        self.counters = self._packets.counters = counters

    def reset(self) -> None:
        """Discard sequences and incomplete messages; keep the counters."""
        super().reset()
        self._packets.reset()
        self._layer.reset()

    def feed(self, frame: CanFrame) -> list[Message]:
        """Process one frame from the bus; return the message that it completes, if fresh."""
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
            elif message is not None:  # valid, but not allowed over ISO-TP
                self.counters.malformed += 1
        return messages

    def _segment(self, timeout: float) -> Any:
        if not self._segments:
            return None
        return _can_message(self._own_id, self._segments.popleft(), self._extended)

    def _failed(self, error: Exception) -> None:
        self.counters.incomplete += 1


def _layer(
    *, own_id: int | None, peer_id: int, extended: bool, receive: Any, transmit: Any, failed: Any
) -> Any:
    """can-isotp's state machine, without threads; it only listens if ``own_id`` is ``None``.

    can-isotp's timers run on real time. ``TRANSFER_LIMIT_NS`` on the node's clock is shorter and
    takes precedence; only the peer's pause between segments uses can-isotp's timer.
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
