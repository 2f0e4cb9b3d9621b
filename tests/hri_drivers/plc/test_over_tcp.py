"""A controller without CAN: it is the TCP server, and the node's serial link connects to it."""

import socket
import threading
import time
from collections.abc import Callable, Iterator
from typing import Any

import pytest

from hri_drivers.links.serial.link import SerialLink, SerialLinkSettings
from hri_predict.base.clock import MonotonicClock
from hri_predict.protocol.messages import Acknowledge, Level, RobotState
from hri_predict.protocol.reasons import Reason
from hri_predict.protocol.reception import OURS
from tests.hri_drivers.plc.conftest import everything
from tests.hri_drivers.plc.test_hri_send import STILL, inputs, line, outputs, sender
from tests.messages import make_advice
from tests.waiting import eventually

pytestmark = pytest.mark.realtime
PATIENCE_S = 30.0
SLOW = make_advice(
    Level.SLOW, Reason.PERSON_APPROACHING, latch_id=9, speed_limit_m_s=0.75, age_s=0.02
)


class Plc(threading.Thread):
    """The cycle of a program as the guide says: bytes in, the speed, bytes out."""

    def __init__(self) -> None:
        super().__init__(daemon=True)
        units = everything()
        self.advice, self.state = units["HRI_SERIAL_ADVICE"], units["HRI_STATE"]
        self.acknowledge = units["HRI_ACKNOWLEDGE"]
        self.sends_state = sender("HRI_SERIAL_SEND", STILL)
        self.sends_acknowledge = sender("HRI_SERIAL_SEND", Acknowledge(0, 1))
        limits = self.advice.variables["Rule"].variables
        # Patient, as the machine that runs this may be busy with other things.
        limits |= {"SILENCE_MS": 900, "MAX_AGE_MS": 5000, "TOLERATED_ERRORS": 10_000}
        self.server = socket.create_server(("127.0.0.1", 0))
        self.server.setblocking(False)
        self.peer: socket.socket | None = None
        self.pressed, self.over, self.speed = False, threading.Event(), 0

    def run(self) -> None:
        while not self.over.wait(0.02):
            self.cycle(round(time.monotonic() * 1000) % 2**32)
        self.drop()
        self.server.close()

    def cycle(self, ms: int) -> None:
        begins = False
        if self.peer is None:
            try:
                self.peer, begins = self.server.accept()[0], True
                self.peer.setblocking(False)
            except BlockingIOError:
                pass
        came = self.receive()
        known = outputs(self.state, "StateCounter", "Sent", "SentMs")
        padded = [*came, *bytes(256 - len(came))]
        self.advice(Bytes=padded, ByteCount=len(came), NowMs=ms, **known)
        self.speed = self.advice.variables["PermittedSpeed"]
        self.state(**inputs(STILL) | {"NowMs": ms})
        self.send(line(self.sends_state, self.state, begins))
        if self.pressed:
            self.pressed = False
            self.acknowledge(LatchId=self.advice.variables["LatchId"], AckId=77)
            self.send(line(self.sends_acknowledge, self.acknowledge))

    def receive(self) -> bytes:
        if self.peer is None:
            return b""
        try:
            data = self.peer.recv(256)
        except BlockingIOError:
            return b""
        except OSError:
            data = b""
        if not data:
            self.drop()
        return data

    def send(self, data: bytes) -> None:
        if self.peer is not None:
            try:
                self.peer.sendall(data)
            except OSError:
                self.drop()

    def drop(self) -> None:
        if self.peer is not None:
            self.peer.close()
            self.peer = None


@pytest.fixture
def plc() -> Iterator[Plc]:
    running = Plc()
    running.start()
    yield running
    running.over.set()
    running.join(PATIENCE_S)


def test_a_plc_as_tcp_server_obeys_the_node_and_stops_without_it(plc: Plc) -> None:
    port = f"socket://127.0.0.1:{plc.server.getsockname()[1]}"
    heard: list[Any] = []

    def obeyed(link: SerialLink, goal: Callable[[], bool]) -> bool:
        for message in (OURS, SLOW):
            link.post(message)
        heard.extend(received.message for received in link.take())
        return goal()

    def started() -> SerialLink:
        link = SerialLink(SerialLinkSettings(name="plc", port=port), MonotonicClock())
        link.start()
        return link

    first = started()
    eventually(lambda: obeyed(first, lambda: plc.speed == 750))
    plc.pressed = True
    eventually(lambda: obeyed(first, lambda: Acknowledge(9, 77) in heard))
    assert len([m for m in heard if isinstance(m, RobotState)]) > 1
    first.stop()
    eventually(lambda: plc.speed == 0)
    assert plc.advice.variables["Silent"] == 1
    second = started()
    eventually(lambda: obeyed(second, lambda: plc.speed == 750))
    second.stop()
