"""A CAN link and the controller at its other end, over every transport that needs no hardware.

Not a test itself: what the tests of CAN links share.
"""

import contextlib
import itertools
import threading
from collections import deque
from collections.abc import Iterator
from typing import Any

import isotp

from hri_drivers.links.can.link import CanLink, CanLinkSettings
from hri_drivers.links.can.transport import CanTransport
from hri_predict.base.clock import MonotonicClock
from hri_predict.protocol.can import CanFrame, CanReceiver, CanSender
from hri_predict.protocol.profile4 import Profile4Receiver
from hri_sim.wires.slcan_adapter import SlcanAdapter, open_pty
from tests.waiting import eventually

MULTICAST = "239.74.163.2"
CHANNELS = itertools.count()


class Controller:
    """The other end: hears, answers ISO-TP as can-isotp does it, and keeps every frame.

    Attributes:
        heard: messages, in order.
        frames: frames, in order; not its own, which udp_multicast gives back to it.
    """

    def __init__(self, wire: Any, settings: CanLinkSettings, answers: bool = True) -> None:
        self.wire = wire
        self.heard: list[Any] = []
        self.frames: list[CanFrame] = []
        self._own: list[CanFrame] = []
        self._sender = CanSender(settings.fd, settings.base_id, settings.extended)
        self._receiver = CanReceiver(settings.fd, settings.base_id, settings.extended)
        self._segments: deque[CanFrame] = deque()
        self._whole = Profile4Receiver(255)
        self._layer = self._isotp_layer(settings) if settings.isotp and answers else None
        self._isotp_id = settings.isotp_id
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)

    def _isotp_layer(self, settings: CanLinkSettings) -> Any:
        assert settings.isotp
        mode = isotp.AddressingMode
        return isotp.TransportLayerLogic(
            rxfn=self._next_segment,
            txfn=lambda message: self.wire.write(
                CanFrame(
                    message.arbitration_id, bytes(message.data), extended=message.is_extended_id
                )
            ),
            address=isotp.Address(
                mode.Normal_29bits if settings.extended else mode.Normal_11bits,
                rxid=settings.isotp_id,
                txid=settings.isotp.peer_id,
            ),
            params={"blocksize": 16, "stmin": 0},
        )

    def _next_segment(self, timeout: float) -> Any:
        if not self._segments:
            return None
        frame = self._segments.popleft()
        return isotp.CanMessage(
            frame.arbitration_id, len(frame.data), frame.data, extended_id=frame.extended
        )

    def start(self) -> None:
        self.wire.open()
        self._thread.start()

    def _run(self) -> None:
        while not self._stop.is_set():
            for frame in self.wire.read(0.05):
                self.hear(frame)

    def hear(self, frame: CanFrame) -> None:
        if frame in self._own:
            return
        self.frames.append(frame)
        if frame.arbitration_id != self._isotp_id:
            self.heard += self._receiver.feed(frame)
        elif self._layer is not None:
            self._segments.append(frame)
            self._layer.process()
            while (whole := self._layer.recv()) is not None:
                message = self._whole.take(bytes(whole))
                self.heard += [message] if message is not None else []

    def heard_of(self, kind: type) -> list[Any]:
        return [m for m in self.heard if isinstance(m, kind)]

    def say(self, *messages: Any) -> None:
        for message in messages:
            for frame in self._sender.encode(message):
                self._own.append(frame)
                self.wire.write(frame)

    def stop(self) -> None:
        self._stop.set()
        self._thread.join()
        self.wire.close()


@contextlib.contextmanager
def connected(
    kind: str, answers: bool = True, **settings: Any
) -> Iterator[tuple[CanLink, Controller]]:
    """A started link over ``kind`` ("slcan fd", "virtual", "udp_multicast", ...) and its peer."""
    interface, _, fd = kind.partition(" ")
    far: Any
    if interface == "slcan":
        master, channel = open_pty()
        far = SlcanAdapter(master)
        settings["options"] = {"sleep_after_open": 0}
    else:
        channel = MULTICAST if interface == "udp_multicast" else f"pair-{next(CHANNELS)}"
        far = CanTransport(interface=interface, channel=channel, fd=bool(fd))
    made = CanLinkSettings(
        name="cell", interface=interface, channel=channel, fd=bool(fd), **settings
    )
    link, controller = CanLink(made, MonotonicClock()), Controller(far, made, answers)
    controller.start()
    link.start()
    if interface == "slcan":
        eventually(lambda: far.channel_open)
    try:
        yield link, controller
    finally:
        link.stop()
        controller.stop()
