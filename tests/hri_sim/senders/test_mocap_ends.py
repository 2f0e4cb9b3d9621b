"""The programs of motion capture: the node's readers find their captures and their clocks."""

import socket
import time
from collections.abc import Callable

import numpy as np
import pytest

from hri_drivers.sources.mocap.frames import Reader
from hri_drivers.sources.natnet.source import NatNetReader
from hri_drivers.sources.qualisys.source import QtmReader
from hri_drivers.sources.rokoko.source import RokokoReader
from hri_drivers.sources.vmc.source import VmcReader
from hri_drivers.sources.zed_livelink.source import ZedReader
from hri_predict.base.skeleton import JOINTS
from hri_predict.contracts.joint_map import load_joint_map
from hri_predict.contracts.scene import Person, Scene
from hri_predict.contracts.source import SourceCounters
from hri_sim.people.body import Body
from hri_sim.senders import mocap_person, natnet, qualisys
from hri_sim.senders.mocap_ends import PROGRAMS
from hri_sim.senders.natnet import Motive
from hri_sim.senders.qualisys import Qtm

READERS: dict[str, tuple[str, Callable[..., Reader]]] = {
    "vmc": ("unity22", lambda joints, counters: VmcReader(joints, False, counters)),
    "rokoko": ("rokoko23", RokokoReader),
    "zed_livelink": ("zed38", lambda joints, counters: ZedReader(joints, 0.0, counters)),
    "natnet": ("motive21", NatNetReader),
    "qualisys": ("qualisys24", QtmReader),
}
PERIOD_NS = 40_000_000
_BODY = Body(1.75)
STANDING = _BODY.joints(_BODY.standing(np.array([1.7, 0.2]), np.pi))


@pytest.mark.parametrize("kind", PROGRAMS)
def test_a_reader_finds_each_capture_at_its_time(kind):
    program = PROGRAMS[kind]()
    layout, make = READERS[kind]
    reader = make(load_joint_map(layout).source_joints, SourceCounters())
    program.start()
    for unit in program.greeting:
        reader.read(unit)
    person = Person(1, STANDING, np.ones(len(JOINTS), np.bool_))
    began_ns, frames = time.time_ns(), []
    for k in range(6):
        scene = Scene(began_ns + k * PERIOD_NS, k, True, (person,))
        frames += [f for f in map(reader.read, program.encode(scene)) if f is not None]
    assert len(frames) >= 4  # a reader that waits for a next capture keeps the last ones
    times_ns = [frame.stamp_ns or 0 for frame in frames]
    assert all(len(frame.people) == 1 for frame in frames)
    # Clocks of single precision, two hours after their start, have steps of 0.5 ms.
    np.testing.assert_allclose(np.diff(times_ns), PERIOD_NS, atol=1_000_000)


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["vmc", "--host", "nosuch.invalid", "--port", "39539"], "--host nosuch.invalid: not the"),
        (["vmc", "--host", "a" * 70, "--port", "39539"], "not the name or address of a machine"),
        (["vmc", "--host", "255.255.255.255", "--port", "39539"], "correct it, or the network"),
        (["vmc", "--port", "99999"], "give a number from 1 to 65535"),
        (["vmc", "--port", "39539", "--rate", "0"], "give a number above 0"),
        (["vmc", "--port", "39539", "--seconds", "nan"], "give a number above 0"),
    ],
)
def test_a_wrong_option_is_one_line(arguments, said, capsys):
    with pytest.raises(SystemExit, match="2"):
        mocap_person.main(arguments)
    assert said in capsys.readouterr().err.splitlines()[-1]


@pytest.mark.parametrize("kind", ["natnet", "qualisys"])
def test_a_port_of_another_program_is_one_line(kind, capsys):
    socket_kind = socket.SOCK_DGRAM if kind == "natnet" else socket.SOCK_STREAM
    with socket.socket(socket.AF_INET, socket_kind) as taken:
        taken.bind(("127.0.0.1", 0))
        if kind == "qualisys":
            taken.listen()
        with pytest.raises(SystemExit, match="2"):
            mocap_person.main([kind, "--port", str(taken.getsockname()[1])])
    assert "in use; choose another one" in capsys.readouterr().err.splitlines()[-1]


def test_datagrams_without_a_message_do_not_end_motive():
    server = Motive({1: "person"})
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as client:
        client.settimeout(20.0)
        client.connect(("127.0.0.1", server.port))
        for noise in (b"", b"\0"):
            client.send(noise)
        client.send(natnet.packet(0, b""))
        assert client.recv(4096) == natnet.server_info()
    server.close()


class QtmClient:
    """A client of QTM's stand-in that is connected and greeted."""

    def __init__(self, server: Qtm) -> None:
        self.socket = socket.create_connection(("127.0.0.1", server.port), 20.0)
        self._from = self.socket.makefile("rb")
        self.expect(qualisys.packet(1, b"QTM RT Interface connected\0"))

    def expect(self, wanted: bytes) -> None:
        assert self._from.read(len(wanted)) == wanted

    def close(self) -> None:
        self._from.close()
        self.socket.close()

    def send(self, *commands: bytes) -> None:
        self.socket.sendall(b"".join(qualisys.packet(1, each + b"\0") for each in commands))


VERSION = qualisys.packet(1, b"Version set to 1.25\0")


def test_qtm_answers_each_of_several_commands_and_survives_text_that_is_not_utf_8():
    server = Qtm(["Ann"])
    client = QtmClient(server)
    client.send(b"\xff\xfe", b"Version 1.25", b"GetParameters Skeleton", b"Version 1.25")
    client.expect(VERSION + qualisys.parameters(["Ann"]) + VERSION)
    for byte in qualisys.packet(1, b"Version 1.25\0"):
        client.socket.sendall(bytes((byte,)))
    client.expect(VERSION)
    client.socket.sendall(b"GET / HTTP/1.1\r\n\r\n")
    assert client.socket.recv(1) == b""  # another protocol
    client.close()
    again = QtmClient(server)
    again.send(b"Version 1.25")
    again.expect(VERSION)
    again.close()
    server.close()


def test_qtm_sends_while_its_client_goes():
    ends, far = socket.socketpair()

    class Leaving(Qtm):
        """Its client is gone at the second look."""

        looks = 0

        @property
        def _streams(self):
            self.looks += 1
            return ends if self.looks == 1 else None

        @_streams.setter
        def _streams(self, _): ...

    server = Leaving(["Ann"])
    server.send(b"data")
    assert far.recv(4) == b"data"
    server.close()
    ends.close()
    far.close()
