"""Common part of all links: newest-wins slots, supervision, reconnecting, counters.

In real time a link has two threads. The writer sleeps until a message is posted, writes it, and
supervises: it opens, closes and reopens the device; an endless opening holds up nothing else. The
reader waits in the device's ``read``. Neither polls, so a posted message leaves within a fraction
of a millisecond. Neither can fail unnoticed: every error is counted, kept as ``last_error``, and
the device is reopened. On the virtual clock ``service`` does the same in the caller's thread.
"""

import logging
import threading
from collections.abc import Callable
from concurrent.futures import Future
from typing import Generic, TypeVar

from hri_drivers.links.bulk import Bulk
from hri_drivers.links.codec import Codec
from hri_drivers.links.inbox import Inbox
from hri_drivers.links.slots import BULK, Budget, Slots
from hri_drivers.wires.backoff import BackOff
from hri_drivers.wires.transport import READ_TIMEOUT_S, TOO_SLOW, Transport, TransportBusy
from hri_predict.base.clock import Clock
from hri_predict.base.errors import LinkError, failure, first_line
from hri_predict.contracts.link import LinkCounters, LinkSettings, Received
from hri_predict.protocol.messages import Advice, FromController, Message, RobotState, at_encoding
from hri_predict.protocol.own_frames import OwnFrames

log = logging.getLogger(__name__)

U = TypeVar("U")

BUSY_RETRY_S = 0.005
BUSY_LIMIT_NS = 1_000_000_000  # if busy for longer (bus-off, nobody reads): reopen
FLUSH_NS = 200_000_000  # longest time that a stop may take to write the last messages
BULK_AHEAD_NS = 2_000_000  # how far ahead of the wire bulk is written
BULK_WAIT_S = 0.001  # shortest wait, so that a fast wire does not wake its writer for every frame
OPEN_S = 8.0  # longest time that a start waits for a device, unless its transport needs longer
OPEN_MARGIN_S = 2.0  # the transport's own limit comes first, because it knows the reason
WAIT_FOR_S = 3.0  # longest time that a start waits for a device that may be absent
STOP_S = 5.0  # how long a stop waits for the writer
OPENING_STOP_S = 0.5  # the same if the device is not open: there is nothing to write
READS_PER_SERVICE = 1024
SECOND_SENDER = (
    "another sender uses this node's ids; switch it off, or give one of the two different ids "
    "(base_id, or site and cell) or a separate line"
)


class SupervisedLink(Generic[U]):
    """A ``Link`` over any ``Transport``; see ``hri_predict.contracts.link.Link``.

    Attributes:
        name, counters, connected, foreign_ns: see the contract.
        last_error: one line about the newest error; ``None`` if there was none.
        on_sent: called for the recorder with (link name, unit as bytes, time) after each write.
    """

    def __init__(
        self,
        *,
        settings: LinkSettings,
        clock: Clock,
        transport: Transport[U],
        codec: Codec[U],
        budget: Budget,
        wait_for_device: bool = False,
    ) -> None:
        self.name = settings.name
        self.counters = LinkCounters()
        self.connected = False
        self.last_error: str | None = None
        self.foreign_ns: int | None = None
        self.on_sent: Callable[[str, bytes, int], None] | None = None
        self._clock = clock
        self._transport = transport
        self._codec = codec
        self._own = OwnFrames()
        codec.watch(self._own)
        self._not_ours = 0  # messages that a codec decoded, though no controller sends them
        self._bulk_waits = False  # until the wire is free
        self._wire_free_ns = 0  # calculated time at which all written units will have left
        self._wait_for_device = wait_for_device
        self._zones, self._simulated = settings.zones, settings.simulate is not None
        self._slots = Slots()
        self._bulk: Bulk[U] = Bulk(self._slots, codec, budget, self.counters)
        self._inbox = Inbox()
        self._echo: dict[int, int] = {}
        self._opened_before = False
        self._back_off = BackOff()
        self._retry_ns = 0
        self._busy_since_ns: int | None = None
        self._wake = threading.Event()
        self._stopping = threading.Event()
        self._hang_up = threading.Event()
        self._reader_error: Exception | None = None
        self._reader: threading.Thread | None = None
        self._writer: threading.Thread | None = None

    def start(self) -> None:
        """Open the device and start the threads.

        Raises:
            LinkError: the device is absent, unless ``wait_for_device`` is set.
        """
        if self._writer is not None:
            return
        self._stopping.clear()
        tried: Future[None] = Future()
        self._writer = threading.Thread(
            target=self._write_loop, args=(tried,), name=f"{self.name}-tx", daemon=True
        )
        self._writer.start()
        limit_s = getattr(self._transport, "open_limit_s", OPEN_S) + OPEN_MARGIN_S
        if self._wait_for_device:
            limit_s = min(limit_s, WAIT_FOR_S)
        try:
            tried.result(limit_s)
        except (LinkError, TimeoutError) as error:
            if self._wait_for_device:
                return
            self.stop()
            why = error if isinstance(error, LinkError) else f"not open within {limit_s:g} s"
            raise LinkError(f"link '{self.name}': {why}") from error
        except BaseException:  # a signal, or what no device should raise
            self.stop()
            raise

    def post(self, message: Message) -> None:
        """Put a message into its newest-wins slot; never blocks."""
        if not self._codec.carries(message) or (isinstance(message, BULK) and not self._zones):
            self.counters.decimated += 1
            return
        displaced = self._slots.post(message)
        if displaced is not None:
            self._count_displaced(displaced)
        self._wake.set()

    def take(self) -> list[Received]:
        """Return the messages received since the last call, oldest first."""
        return self._inbox.take()

    def service(self, now_ns: int) -> None:
        """Read received units, write posted messages, and reopen if due, in this thread."""
        if self._writer is not None:
            raise RuntimeError("service is for links whose thread was not started")
        try:
            if not self.connected:
                if now_ns < self._retry_ns:
                    return
                self._open(now_ns)
            for _ in range(READS_PER_SERVICE):
                units = self._transport.read(0.0)
                if not units:
                    break
                self._receive(units, now_ns)
            self._drain(lambda: now_ns)
        except LinkError as error:
            self._lost(error, now_ns)

    def stop(self) -> None:
        """Write posted messages (for at most 200 ms), then close. Safe to call twice."""
        writer, self._writer = self._writer, None
        if writer is not None:
            self._stopping.set()
            self._wake.set()
            writer.join(timeout=STOP_S if self.connected else OPENING_STOP_S)
            if writer.is_alive():
                self._note(LinkError(f"link '{self.name}': its device failed to close"))
            return
        if self.connected:
            now_ns = self._clock.now_ns()
            try:
                self._drain(lambda: now_ns, with_bulk=False)
            except LinkError as error:
                self._note(error)
        self._end()

    def _open_first(self, tried: "Future[None]") -> None:
        """Open the device for the first time, and report the result."""
        try:
            self._open(self._clock.now_ns())
            self._start_reader()
        except BaseException as raised:  # the supervisor must survive any fault of its device
            self._lost(error := failure(raised), self._clock.now_ns())
            tried.set_exception(error)
        else:
            tried.set_result(None)

    def _write_loop(self, tried: "Future[None]") -> None:
        self._open_first(tried)
        while not self._stopping.is_set():
            try:
                self._turn()
            except BaseException as error:  # the supervisor must survive any fault of its device
                self._lost(failure(error), self._clock.now_ns())
        self._flush()
        self._stop_reader()
        self._end()

    def _turn(self) -> None:
        """Wait for work, then do it."""
        if not self.connected:
            self._clock.wait_until(self._retry_ns, self._stopping)
            if not self._stopping.is_set():
                self._open(self._clock.now_ns())
                self._start_reader()
                self._wake.set()
            return
        self._wake.wait(self._patience_s())
        self._wake.clear()
        if self._reader_error is not None:
            raise self._reader_error
        if not self._stopping.is_set():
            self._drain(self._clock.now_ns, paced=True)

    def _patience_s(self) -> float | None:
        """Maximum sleep if nothing is posted."""
        if self._busy_since_ns is not None:
            return BUSY_RETRY_S
        if self._bulk_waits:
            # wake before the wire is free: it must not idle while this thread wakes up
            ahead_ns = self._wire_free_ns - self._clock.now_ns() - BULK_AHEAD_NS
            return max(BULK_WAIT_S, ahead_ns * 1e-9)
        return self._bulk.patience_s()

    def _read_loop(self, hang_up: threading.Event) -> None:
        try:
            while not hang_up.is_set():
                units = self._transport.read(READ_TIMEOUT_S)
                if units:
                    self._receive(units, self._clock.now_ns())
        except BaseException as error:  # the writer closes and reopens
            if not hang_up.is_set():
                self._reader_error = failure(error)
                self._wake.set()

    def _start_reader(self) -> None:
        self._reader_error = None
        self._hang_up = threading.Event()
        self._reader = threading.Thread(
            target=self._read_loop, args=(self._hang_up,), name=f"{self.name}-rx", daemon=True
        )
        self._reader.start()

    def _stop_reader(self) -> None:
        reader, self._reader = self._reader, None
        self._hang_up.set()
        if reader is not None:
            reader.join(timeout=1.0)

    def _flush(self) -> None:
        """Write posted messages, so that the last ones leave the node."""
        deadline_ns = self._clock.now_ns() + FLUSH_NS
        try:
            while self.connected and self._clock.now_ns() < deadline_ns:
                self._drain(self._clock.now_ns, with_bulk=False)
                if self._busy_since_ns is None:
                    return
                self._wake.clear()
                self._wake.wait(BUSY_RETRY_S)
        except BaseException as error:  # the link ends either way; keep the cause
            self._note(failure(error))

    def _end(self) -> None:
        """Close, and count what was not sent."""
        self.connected = False
        self._transport.close()
        self._bulk.give_up()
        while (message := self._slots.pop()) is not None:
            if isinstance(message, BULK):
                self.counters.decimated += 1
            else:
                self.counters.write_errors += 1

    def _open(self, now_ns: int) -> None:
        self._transport.open()
        self.connected = True
        self._back_off.opened(now_ns)
        self._busy_since_ns = None
        if self._opened_before:
            self._codec.reset()
            self._echo.clear()  # a restarted controller must not mistake an old counter for its own
            self.counters.reconnects += 1
            log.info("link '%s': connected again", self.name)
        self._opened_before = True

    def _lost(self, error: Exception, now_ns: int) -> None:
        """Close, record the cause, and set the time of the next attempt."""
        if self.connected:
            log.warning("link '%s': %s; trying again", self.name, error)
            self.counters.disconnects += 1
        self.connected = False
        self._note(error)
        self._stop_reader()
        self._transport.close()
        self._bulk.give_up()
        self._busy_since_ns = None
        self._retry_ns = now_ns + int(self._back_off.next_s(now_ns) * 1e9)

    def _note(self, error: Exception) -> None:
        self.last_error = first_line(error)

    def _drain(self, now: Callable[[], int], with_bulk: bool = True, paced: bool = False) -> None:
        """Write posted messages, most urgent first; bulk only within its budget.

        If ``paced``, bulk goes frame by frame as the wire becomes free. An urgent message then
        waits at most two milliseconds and one frame, not for a whole Zone.

        Raises:
            LinkError: the device is lost, or has been busy for too long.
        """
        while True:
            now_ns = now()
            message = self._slots.pop(with_bulk=False)
            try:
                if message is not None:
                    for unit in self._encoded(message, now_ns):
                        self._send(unit, now_ns)
                    self.counters.messages_sent += 1
                elif not with_bulk or not self._send_bulk(now_ns, paced):
                    break
            except TransportBusy as error:
                self._busy(message, error, now_ns)
                return
            except (ValueError, OverflowError) as error:  # a value fits no field: it alone is lost
                self.counters.write_errors += 1
                self._note(error)
            except BaseException:
                self.counters.write_errors += 1
                self._return(message)
                raise
            self._busy_since_ns = None
        self._busy_since_ns = None

    def _encoded(self, message: Message, now_ns: int) -> list[U]:
        echo = self._echo.get(message.robot) if isinstance(message, Advice) else None
        return self._codec.encode(at_encoding(message, now_ns, echo))

    def _send(self, unit: U, now_ns: int) -> None:
        self._transport.write(unit)
        self._wire_free_ns = max(now_ns, self._wire_free_ns) + int(self._codec.unit_s(unit) * 1e9)
        self.counters.bytes_sent += self._codec.size(unit)
        if self.on_sent is not None:
            self.on_sent(self.name, self._codec.raw(unit), now_ns)

    def _send_bulk(self, now_ns: int, paced: bool) -> bool:
        """Write one frame of a Zone or Pose; ``False`` if none may be sent now."""
        self._bulk_waits = False
        if paced and self._wire_free_ns - now_ns > BULK_AHEAD_NS:
            self._bulk_waits = self._bulk.waiting
            return False
        unit = self._bulk.next(now_ns)
        if unit is None:
            return False
        self._send(unit, now_ns)
        self.counters.messages_sent += self._bulk.sent()
        return True

    def _busy(self, message: Message | None, error: TransportBusy, now_ns: int) -> None:
        """Keep the message for a retry unless a newer one is posted; give up after a second."""
        self.counters.write_errors += 1
        error = TransportBusy(TOO_SLOW) if self._simulated else error
        self._note(error)
        self._return(message)
        if self._busy_since_ns is None:
            self._busy_since_ns = now_ns
        elif now_ns - self._busy_since_ns > BUSY_LIMIT_NS:
            raise LinkError(str(error)) from error

    def _return(self, message: Message | None) -> None:
        """Put the message back into its slot; ``None``: drop the unfinished Zone or Pose."""
        if message is None:
            self._bulk.give_up()
        elif not self._slots.put_back(message):
            self._count_displaced(message)

    def _count_displaced(self, message: Message) -> None:
        if isinstance(message, BULK):
            self.counters.decimated += 1
        else:
            self.counters.superseded += 1

    def _receive(self, units: list[U], now_ns: int) -> None:
        for unit in units:
            self.counters.bytes_received += self._codec.size(unit)
            for message in self._codec.decode(unit):
                if not isinstance(message, FromController):
                    self._not_ours += 1  # a node's, on a link that only listens
                    continue
                self.counters.messages_received += 1
                if isinstance(message, RobotState):
                    self._echo[message.robot] = message.counter
                self._inbox.put(Received(message, now_ns))
        self._codec.count(self.counters)
        self.counters.overrun = self._inbox.overrun
        self.counters.echoes, self.counters.unexpected = self._own.echoes, self._not_ours
        self.counters.foreign = self._own.foreign
        if self._own.prove_second(now_ns):
            self.foreign_ns = now_ns
            self._note(LinkError(SECOND_SENDER))
