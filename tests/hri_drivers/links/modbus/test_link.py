"""The server and a PLC in another process, by pymodbus's client over TCP."""

import asyncio
import json
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from pydantic import ValidationError

pytest.importorskip("pymodbus", reason="pymodbus is not installed: the link cannot be used")
from pymodbus.simulator import SimData, SimDevice

from hri_drivers.links.modbus.connections import MOST, MOST_UNREAD, LimitedServer
from hri_drivers.links.modbus.link import ModbusLink, ModbusLinkSettings
from hri_predict.base.clock import MonotonicClock
from hri_predict.base.errors import LinkError
from hri_predict.base.settings import Pose
from hri_predict.protocol.messages import (
    Acknowledge,
    Level,
    NodeState,
    RobotState,
    Status,
)
from hri_predict.protocol.registers import (
    NEAREST,
    NODE,
    ROBOT,
    STATE,
    robot_address,
    state_address,
    unpacked,
    words_of,
)
from hri_predict.protocol.wire import StateShape
from hri_predict.robots.settings import RobotSettings
from tests.hri_drivers.links.plant.test_codec import ADVICE, STATUS, ZONE, state_words
from tests.messages import make_advice
from tests.waiting import eventually

pytestmark = pytest.mark.realtime
CLEAR = make_advice(Level.CLEAR, speed_limit_m_s=0.8, age_s=0.05, latch_id=77)


class Plc:
    """``plc.py`` as a process."""

    def __init__(self, port: int) -> None:
        script = Path(__file__).with_name("plc.py")
        self._process = subprocess.Popen(
            [sys.executable, str(script), str(port)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )

    def ask(self, **asked: Any) -> dict[str, Any]:
        """Send one request."""
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        self._process.stdin.write(json.dumps(asked) + "\n")
        self._process.stdin.flush()
        answer: dict[str, Any] = json.loads(self._process.stdout.readline())
        return answer

    def robot(self, index: int = 0, function: int = 4) -> dict[str, int]:
        """The registers of a robot."""
        count = words_of(ROBOT + NEAREST)
        answer = self.ask(read=[robot_address(index), count], function=function)
        return unpacked(ROBOT + NEAREST, answer["words"])

    def node(self) -> dict[str, int]:
        """The registers of the node."""
        return unpacked(NODE, self.ask(read=[0, words_of(NODE)])["words"])

    def kill(self) -> None:
        """End it."""
        self._process.kill()
        self._process.wait()


@pytest.fixture
def link() -> Iterator[Callable[..., ModbusLink]]:
    made: list[ModbusLink] = []

    def make(**changes: Any) -> ModbusLink:
        data = {"name": "plant", "port": 0, "max_age_s": 0.4, "bases": [Pose()]} | changes
        made.append(ModbusLink(ModbusLinkSettings(**data), MonotonicClock()))
        made[-1].start()
        return made[-1]

    yield make
    for each in made:
        each.stop()


def port_of(link: ModbusLink) -> int:
    port: int = link._transport.port  # type: ignore[attr-defined]
    return port


@pytest.fixture
def plc() -> Iterator[Callable[[ModbusLink], Plc]]:
    made: list[Plc] = []

    def make(link: ModbusLink) -> Plc:
        made.append(Plc(port_of(link)))
        return made[-1]

    yield make
    for each in made:
        each.kill()


def posted(link: ModbusLink, condition: Callable[[], Any], *more: Any) -> Any:
    """Post as the node does until something happens."""

    def step() -> Any:
        for message in (STATUS, CLEAR, *more):
            link.post(message)
        return condition()

    return eventually(step)


def test_a_plc_reads_the_advice_by_both_functions(link, plc):
    server = link()
    there = plc(server)
    found = posted(server, lambda: (r := there.robot())["LEVEL"] == 1 and r)
    assert (found["SPEED_LIMIT"], found["LATCH_ID"], found["NEAREST"]) == (800, 77, 65534)
    assert 50 <= found["AGE"] < 110
    assert posted(server, lambda: there.robot(function=3)["LEVEL"] == 1)
    node = posted(server, lambda: (n := there.node())["NODE_STATE"] == 2 and n)
    assert node["MAP_VERSION"] == 1
    assert there.robot(3)["LEVEL"] == 0  # of a robot that there is not


def test_the_nearest_person_is_read_with_distance_and_angle(link, plc):
    server = link()
    there = plc(server)
    one = Status(**{f: getattr(STATUS, f) for f in STATUS.__slots__} | {"people": 1})

    def near() -> Any:
        for message in (one, CLEAR, ZONE):
            server.post(message)
        found = there.robot()
        return found["NEAREST"] == 1800 and found

    found = eventually(near)
    assert (found["NEAREST_ANGLE"], found["NEAREST_PERSON"]) == (900, 5)


def test_values_that_the_node_does_not_renew_become_unknown_by_themselves(link, plc):
    server = link()
    there = plc(server)
    before = posted(server, lambda: (r := there.robot())["LEVEL"] == 1 and r)
    time.sleep(0.1)  # the silence time-out of 60 ms, in real time
    after = there.robot()
    assert (after["LEVEL"], after["SPEED_LIMIT"], after["REASON"]) == (0, 0, 65535)
    assert after["ADVICE_COUNTER"] >= before["ADVICE_COUNTER"]
    assert there.robot()["ADVICE_COUNTER"] == after["ADVICE_COUNTER"]
    posted(server, lambda: server.counters.advice_timeouts >= 1)
    time.sleep(0.1)  # the last one posted may still be on its way
    beats = [there.node()["HEARTBEAT"] for _ in range(3)]
    assert len(set(beats)) == 1


def test_presses_and_states_reach_the_node(link, plc):
    server = link()
    there = plc(server)
    for _ in range(3):  # as an I/O scanner writes
        assert "words" in there.ask(write=[1000, [1, 77, 0, 9]])
    there.ask(write=[state_address(0), state_words()])
    heard: list[Any] = []

    def both() -> bool:
        heard.extend(r.message for r in server.take())
        return len(heard) >= 2

    eventually(both)
    assert heard[0] == Acknowledge(77, 9)
    assert isinstance(heard[1], RobotState)
    assert heard[1].positions[0] == -0.5
    node = posted(server, lambda: (n := there.node())["ACK_TAKEN"] == 9 and n)
    assert node["PLC_ALIVE"] == 1


@pytest.mark.parametrize(
    ("asked", "exception"),
    [
        ({"write": [1001, [77, 0]]}, 3),  # half a press
        ({"one": [1002, 1]}, 3),
        ({"write": [1100, state_words()[:-2]]}, 3),
        ({"write": [100, [1, 65535]]}, 2),  # the node's own
        ({"read": [500, 2]}, 2),
        ({"coils": [0, 8]}, 1),
    ],
)
def test_what_is_not_in_the_map_is_an_exception_and_counted(link, plc, asked, exception):
    server = link()
    there = plc(server)
    assert there.ask(**asked) == {"exception": exception}
    assert posted(server, lambda: there.robot()["LEVEL"] == 1)
    assert server.take() == []
    refused = int(exception == 3)
    assert posted(server, lambda: (n := there.node())["NODE_STATE"] == 2 and n)[
        "WRITES_REFUSED"
    ] == (refused)


def test_a_heartbeat_that_ends_is_said_once(link, plc, caplog):
    server = link(plc_timeout_s=0.2)
    there = plc(server)
    assert there.ask(one=[1000, 4]) == {"words": [4]}
    posted(server, lambda: there.node()["PLC_ALIVE"] == 1)
    assert there.node()["WRITES_REFUSED"] == 0
    posted(server, lambda: there.node()["PLC_ALIVE"] == 0)
    assert "heartbeat does not change" in (server.last_error or "")
    assert sum("does not change" in line for line in caplog.messages) == 1
    assert server.connected


def test_other_bytes_do_not_end_the_server(link, plc):
    server = link()
    for garbage in (b"GET / HTTP/1.1\r\n\r\n", b"\0" * 300, b"\xff" * 4000, b"\0\1\0\0\0\6\1"):
        with socket.create_connection(("127.0.0.1", port_of(server))) as raw:
            raw.sendall(garbage)
    there = plc(server)
    assert posted(server, lambda: there.robot()["LEVEL"] == 1)
    assert server.take() == []


def ended(connection: socket.socket) -> bool:
    """Whether the server has stopped a connection."""
    connection.settimeout(0.0)
    try:
        return not connection.recv(1)
    except BlockingIOError:
        return False
    except ConnectionError:
        return True


def test_connections_that_pile_up_end_and_a_plc_is_answered(link, plc):
    server = link()
    there = plc(server)
    address, many = ("127.0.0.1", port_of(server)), 3 * MOST
    opened = [socket.create_connection(address, 5.0)]
    try:
        for _ in range(many - 1):
            assert posted(server, lambda: there.robot()["LEVEL"] == 1)
            opened.append(socket.create_connection(address, 5.0))
        eventually(lambda: sum(not ended(each) for each in opened) < MOST)
        assert ended(opened[0])
        assert not ended(opened[-1])
    finally:
        for each in opened:
            each.close()


def test_a_client_that_does_not_read_its_replies_is_ended():
    class Unread(asyncio.WriteTransport):
        aborted = False

        def is_closing(self) -> bool:
            return self.aborted

        def get_write_buffer_size(self) -> int:
            return MOST_UNREAD + 1

        def abort(self) -> None:
            self.aborted = True

    async def check() -> None:
        server = LimitedServer(SimDevice(0, simdata=[SimData(0)]), ("127.0.0.1", 0), lambda _: None)
        connection = server.callback_new_connection()
        connection.transport = unread = Unread()
        connection.data_received(b"\0\1\0\0\0\6\1\4\0\0\0\x7d")
        assert unread.aborted
        assert connection.writes is None

    asyncio.run(check())


def test_writes_that_the_link_did_not_read_in_time_are_counted(link, plc, monkeypatch):
    monkeypatch.setattr("hri_drivers.links.modbus.server.CAPACITY", 1)
    server = link()
    there = plc(server)

    def reads_nothing(timeout_s):
        time.sleep(0.01)
        return []

    monkeypatch.setattr(server._transport, "read", reads_nothing)
    for beat in range(3):  # the first may still be read
        there.ask(one=[1000, beat])
    monkeypatch.undo()
    there.ask(one=[1000, 9])
    eventually(lambda: server.counters.overrun >= 1)


def test_after_the_stop_no_reply_comes(link, plc):
    server = link()
    there = plc(server)
    assert posted(server, lambda: there.robot()["LEVEL"] == 1)
    server.stop()
    assert "lost" in there.ask(read=[100, 2])


def test_a_port_that_is_taken_is_one_line(link):
    taken = socket.create_server(("127.0.0.1", 0))
    port = taken.getsockname()[1]
    said = rf"link 'plant': Modbus server at 127.0.0.1:{port}: in use by another program"
    with pytest.raises(LinkError, match=said):
        link(port=port)
    taken.close()


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        ({"host": "0.0.0.0"}, "allow_unauthenticated: true"),
        ({"host": "127.example.org"}, "must be an IP address of this machine"),
        ({"host": "a" * 70 + ".b"}, "must be an IP address of this machine"),
        ({"host": "a\0b"}, "must be an IP address of this machine"),
        ({"simulate": {}}, "no simulated controller"),
        ({"port": 70_000}, "less than or equal to 65535"),
    ],
)
def test_settings_that_cannot_be(wrong, said):
    with pytest.raises(ValidationError, match=said):
        ModbusLinkSettings(name="plant", **wrong)


def test_the_network_may_be_allowed():
    assert ModbusLinkSettings(name="a", host="0.0.0.0", allow_unauthenticated=True).host


POSE = {"xyz": [1, 2, 0], "quaternion_xyzw": [0, 0, 0, 1]}
ROBOT_AT = RobotSettings.model_validate(
    {"name": "a", "model": "ur5e", "room_from_robot": POSE, "max_speed_m_s": 1.5}
)


def test_bases_are_those_of_the_robots():
    given = ModbusLinkSettings(name="plant")
    assert ModbusLink.of_robots(given, [ROBOT_AT]).bases == [ROBOT_AT.room_from_robot]
    two = given.model_copy(update={"bases": [None, None]})
    with pytest.raises(LinkError, match="2 bases for 1 robots; give one for each"):
        ModbusLink.of_robots(two, [ROBOT_AT])


def test_a_base_that_moves_is_refused():
    given = ModbusLinkSettings(name="plant")
    with pytest.raises(LinkError, match="no registers for a base that moves"):
        ModbusLink.load(given, 25.0, (0,), (StateShape(6, True),))
    assert ModbusLink.load(given, 25.0, (0,), (StateShape(9),)).spare > 0


def test_the_words_of_a_state_are_those_of_the_page():
    assert words_of(STATE) == 44
    assert NodeState.RUNNING == 2
    assert ADVICE.robot == 1
