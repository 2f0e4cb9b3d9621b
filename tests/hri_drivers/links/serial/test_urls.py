"""Ports that are no device paths, and settings that a port refuses: with real servers."""

import contextlib
import itertools
import socket
import termios
import threading
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import pytest
import serial
from serial.rfc2217 import PortManager

from hri_drivers.links.serial.link import SerialLink, SerialLinkSettings
from hri_drivers.wires.serial import SerialTransport
from hri_drivers.wires.transport import TransportBusy
from hri_predict.base.clock import MonotonicClock
from hri_predict.base.errors import LinkError
from hri_predict.contracts.link import check_load
from hri_predict.protocol.messages import Acknowledge
from hri_predict.protocol.serial import SerialReceiver, SerialSender
from hri_sim.wires.pty import PtyTransport, open_pty
from tests.hri_drivers.links.pairs import advice, more
from tests.hri_drivers.links.tcp_options import demand_options
from tests.waiting import eventually


@pytest.fixture
def server() -> Iterator[socket.socket]:
    with socket.create_server(("127.0.0.1", 0)) as listening:
        listening.settimeout(20.0)
        yield listening


def url(scheme: str, server: socket.socket) -> str:
    return f"{scheme}://127.0.0.1:{server.getsockname()[1]}"


def link_on(port: str) -> SerialLink:
    return SerialLink(SerialLinkSettings(name="cell", port=port), MonotonicClock())


def hear(peer: socket.socket, messages: int) -> list[Any]:
    receiver = SerialReceiver()
    heard: list[Any] = []
    peer.settimeout(20.0)
    while len(heard) < messages:
        data = peer.recv(4096)
        assert data, "closed"
        heard += receiver.feed(data)
    return heard


def test_a_tcp_server_that_goes_away_and_comes_back(server):
    link = link_on(url("socket", server))
    link.start()
    first, _ = server.accept()
    link.post(advice(1))
    assert [m.latch_id for m in hear(first, 1)] == [1]
    sender = SerialSender()
    first.sendall(b"".join(sender.encode(Acknowledge(1, n)) for n in range(1, 21)))
    received: list[Any] = []
    eventually(lambda: len(more(received, link.take())) == 20)
    assert [r.message.ack_id for r in received] == list(range(1, 21))

    first.close()
    second, _ = server.accept()
    link.post(advice(2))
    assert [m.latch_id for m in hear(second, 1)] == [2]
    assert link.connected
    assert link.counters.disconnects == link.counters.reconnects == 1
    assert "lost" in str(link.last_error)
    link.stop()
    second.close()


def test_over_tcp_nothing_waits_for_long_and_a_silent_loss_is_noticed(server):
    transport = SerialTransport(url("socket", server), 115_200)
    transport.open()
    demand_options(transport._serial._socket)
    transport.close()


def test_a_tcp_peer_that_does_not_read_never_gets_a_queue(server):
    transport = SerialTransport(url("socket", server), 921_600)
    transport.open()
    peer, _ = server.accept()
    written = 0

    def fill() -> None:
        nonlocal written
        for _ in range(100_000):
            transport.write(bytes(1000))
            written += 1000

    with pytest.raises(TransportBusy, match="does not drain; check that the other end reads"):
        fill()
    peer.settimeout(0.2)
    taken = 0
    with contextlib.suppress(TimeoutError):
        while data := peer.recv(1 << 16):
            taken += len(data)
    assert taken == written + 1  # and the leading delimiter: nothing is lost
    transport.write(b"again")
    assert peer.recv(100) == b"again"
    transport.close()
    peer.close()


@pytest.mark.realtime
def test_a_link_leaves_a_tcp_peer_that_does_not_read_and_tells_the_next_one_the_newest():
    with socket.socket() as server:
        server.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)  # else it takes a minute's
        server.bind(("127.0.0.1", 0))
        server.listen()
        server.settimeout(20.0)
        link = link_on(url("socket", server))
        link.start()
        deaf, _ = server.accept()
        posted = itertools.count(1)

        def given_up() -> bool:
            number = next(posted)
            for robot in range(8):
                link.post(advice(number, robot))
            assert len(link._slots) <= 8  # the newest of each, and no queue
            return link.counters.disconnects > 0

        eventually(given_up)
        assert "that the other end reads" in str(link.last_error)  # by backlog or by time-out
        assert link.counters.write_errors > 0
        hears, _ = server.accept()
        eventually(lambda: link.connected)
        newest = next(posted)
        link.post(advice(newest))
        while advice(newest) not in [replace(m, age_s=None) for m in hear(hears, 1)]:
            pass
        link.stop()
        deaf.close()
        hears.close()


class WithoutModemLines(serial.Serial):
    """A pseudo-terminal as a port: it has none of a modem's lines."""

    cts = dsr = ri = cd = property(lambda self: False)

    def _update_rts_state(self) -> None: ...

    def _update_dtr_state(self) -> None: ...


class Rfc2217Server:
    """A port server (RFC 2217) made of pyserial's own server side, before a pseudo-terminal."""

    def __init__(self, listening: socket.socket) -> None:
        master, path = open_pty()
        self.far = PtyTransport(master)
        self.far.open()
        self._port = WithoutModemLines(path, timeout=0.02)
        self._listening = listening
        self.baudrates: list[int] = []
        self.threads = [threading.Thread(target=self._serve, daemon=True)]
        self.threads[0].start()

    def _serve(self) -> None:
        self._peer, _ = self._listening.accept()
        self._peer.settimeout(20.0)
        manager: Any = PortManager  # the stubs ask for a Serial on both sides
        self._manager = manager(self._port, self)
        self.threads.append(threading.Thread(target=self._to_network, daemon=True))
        self.threads[1].start()
        while data := self._peer.recv(1024):
            self._port.write(b"".join(self._manager.filter(data)))
            self.baudrates.append(self._port.baudrate)

    def _to_network(self) -> None:
        with contextlib.suppress(OSError, TypeError):
            while True:
                if data := self._port.read(self._port.in_waiting or 1):
                    self.write(b"".join(self._manager.escape(data)))

    def write(self, data: bytes) -> None:
        self._peer.sendall(data)

    def close(self) -> None:
        self.threads[0].join(20.0)
        self._port.close()
        self._peer.close()
        self.threads[1].join(20.0)
        self.far.close()


@pytest.mark.filterwarnings("ignore::DeprecationWarning")  # pyserial's own
def test_an_rfc2217_server_sets_the_rate_and_carries_both_ways(server):
    far = Rfc2217Server(server)
    settings = SerialLinkSettings(name="cell", port=url("rfc2217", server), baudrate=230_400)
    link = SerialLink(settings, MonotonicClock())
    link.start()
    assert 230_400 in far.baudrates
    receiver = SerialReceiver()
    heard: list[Any] = []
    link.post(advice(255))
    eventually(lambda: more(heard, receiver.feed(b"".join(far.far.read(0.0)))))
    assert [m.latch_id for m in heard] == [255]
    far.far.write(SerialSender().encode(Acknowledge(255, 0xFFFFFFFF)))
    received: list[Any] = []
    eventually(lambda: more(received, link.take()))
    assert received[0].message == Acknowledge(255, 0xFFFFFFFF)
    link.stop()
    far.close()


def test_spy_shows_what_passes_on_a_device(tmp_path):
    master, path = open_pty()
    far = PtyTransport(master)
    far.open()
    log = tmp_path / "spy.txt"
    transport = SerialTransport(f"spy://{path}?file={log}", 115_200)
    transport.open()
    with pytest.raises(LinkError, match="in use by another program"):
        SerialTransport(path, 115_200).open()
    with contextlib.suppress(TransportBusy):  # on a loaded machine: late, but written
        transport.write(b"abc")
    assert b"".join(far.read(5.0)) == b"\0abc"
    transport.close()
    assert "61 62 63" in log.read_text()
    far.close()


@pytest.mark.parametrize(
    ("port", "words"),
    [
        ("hwgrep://no_such_maker", "no matching port found; plug it in or correct 'port'"),
        ("rfc2217://127.0.0.1:1", "connection refused; start the server there"),
        ("spy:///dev/no_such_port", "not found; plug it in or correct 'port'"),
        ("socket://127.0.0.1:80?no_such=1", "cannot be opened"),
        ("hwgrep://x&n=0", "pyserial does not support this port or setting"),
    ],
)
def test_a_url_that_does_not_open_gets_one_line_with_the_remedy(port, words):
    with pytest.raises(LinkError) as caught:
        SerialTransport(port, 115_200).open()
    assert words in str(caught.value)
    assert "\n" not in str(caught.value)


def test_rs485_where_there_is_none_gets_one_line_with_the_remedy():
    master, path = open_pty()
    far = PtyTransport(master)
    link = SerialLink(SerialLinkSettings(name="cell", port=path, rs485=True), MonotonicClock())
    with pytest.raises(LinkError) as caught:
        link.start()
    words = "its driver has no RS-485 mode; remove 'rs485'"
    assert str(caught.value).startswith(f"link 'cell': serial port {path}: {words}")
    plain = SerialTransport(path, 115_200, stop_bits=2)  # the failed one let go of the port
    plain.open()
    plain.close()
    far.close()


def test_settings_that_the_system_refuses_get_one_line_with_the_remedy(monkeypatch):
    def refuse(port: serial.Serial) -> None:
        raise termios.error(22, "Invalid argument")

    monkeypatch.setattr(serial.Serial, "open", refuse)
    with pytest.raises(LinkError) as caught:
        SerialTransport("/dev/ttyS0", 115_200, parity="mark").open()
    assert str(caught.value) == (
        "serial port /dev/ttyS0: the port refuses the settings (Invalid argument); "
        "correct 'parity' or 'stop_bits'"
    )


def test_parity_and_stop_bits_take_their_share_of_the_wire():
    plain = SerialLinkSettings(name="cell", port="x", robot_state_rate_hz=0.0)
    longer = plain.model_copy(update={"parity": "even", "stop_bits": 2})
    loads = [SerialLink.load(settings, 25.0).load for settings in (plain, longer)]
    assert loads[1] == pytest.approx(loads[0] * 12 / 10)
    slow = SerialLinkSettings(name="cell", port="x", baudrate=9600, parity="odd")
    with pytest.raises(LinkError, match="raise the bit rate from 9600 to 57600"):
        check_load(SerialLink.load(slow, 25.0))
    assert longer.blocking_s > plain.blocking_s
