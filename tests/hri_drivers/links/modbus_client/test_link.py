"""The link and a Modbus server in another process, by pymodbus's server over TCP."""

import math
import socket
import threading
from itertools import pairwise

import pytest

pytest.importorskip("pymodbus", reason="pymodbus is not installed: the link cannot be used")
from hri_drivers.links.modbus_client.link import ModbusClientLink, ModbusClientSettings
from hri_predict.base.errors import LinkError
from hri_predict.protocol.messages import RobotMode
from hri_predict.protocol.wire import StateShape
from hri_predict.robots.settings import RobotSettings
from hri_sim.robot_server.process import ServerProcess
from tests.hri_drivers.links.polled.servers import made, states
from tests.waiting import eventually

pytestmark = pytest.mark.realtime


@pytest.fixture
def started():
    """Starts servers and links that end with the test."""
    opened = []

    def start(what):
        opened.append(what)
        if not isinstance(what, ServerProcess):
            what.start()
        return what

    yield start
    for each in reversed(opened):
        each.kill() if isinstance(each, ServerProcess) else each.stop()


def test_states_come_in_and_their_counter_advances(started):
    link = started(made("modbus", started(ServerProcess("modbus")).port))
    found = states(link, 20)
    counters = [state.counter for state in found]
    assert all(b - a in (0, 1) for a, b in pairwise(counters))
    assert counters[-1] > 5
    assert {state.mode for state in found} == {RobotMode.AUTOMATIC}
    assert found[0].positions[1] == pytest.approx(-1.57, abs=0.25)  # it swings by 0.2 rad
    assert link.counters.malformed == 0


def test_a_heartbeat_that_stands_still_is_not_a_new_state(started):
    server = started(ServerProcess("modbus", "frozen"))
    link = started(made("modbus", server.port))
    states(link, 5)
    server.toggle()
    eventually(lambda: len({state.counter for state in states(link, 5)}) == 1)
    server.toggle()
    eventually(lambda: len({state.counter for state in states(link, 5)}) > 1)


def test_a_position_that_is_not_a_number_is_counted_and_said(started):
    server = started(ServerProcess("modbus", "not a number"))
    link = started(made("modbus", server.port))
    states(link, 5)
    server.toggle()
    eventually(lambda: any(math.isnan(state.positions[2]) for state in states(link, 1)))
    eventually(lambda: "joint 3 position" in (link.last_error or ""))
    assert link.counters.malformed > 0


def test_a_server_that_is_restarted_is_connected_again(started):
    server = started(ServerProcess("modbus"))
    link = started(made("modbus", server.port))
    before = states(link, 3)[-1].counter
    server.kill()
    eventually(lambda: not link.connected)
    started(ServerProcess("modbus", port=server.port))
    eventually(lambda: any(state.counter > before for state in states(link, 1)))
    assert link.counters.reconnects >= 1


def test_registers_that_are_not_there_are_said_at_the_start(started):
    server = started(ServerProcess("modbus"))
    link = made("modbus", server.port, {"heartbeat": 90}, wait_for_device=False)
    with pytest.raises(LinkError, match=r"holding registers 90 to 125 .*correct the addresses"):
        link.start()


def test_a_server_of_another_protocol_is_said_and_never_raises(started):
    with socket.create_server(("127.0.0.1", 0)) as listening:
        port = listening.getsockname()[1]

        def answer():
            connection, _ = listening.accept()
            with connection:
                connection.recv(100)
                connection.sendall(b"HTTP/1.1 400 Bad Request\r\n\r\n" + 64 * b"\xff")

        threading.Thread(target=answer, daemon=True).start()
        link = made("modbus", port, wait_for_device=False, reply_timeout_s=0.3)
        with pytest.raises(LinkError, match=r"not Modbus TCP|no answer|connection lost"):
            link.start()


def robot(**changes):
    motion = {"kind": "state", "delay_s": 0.05} | changes
    data = {"name": "arm", "model": "ur5e", "max_speed_m_s": 1.0, "motion": motion}
    return RobotSettings(
        **data, room_from_robot={"xyz": [0, 0, 0], "quaternion_xyzw": [0, 0, 0, 1]}
    )


DERIVED = {"heartbeat": 1, "automatic": True, "joints": [{"position": 10}], "tick_s": 0.001}


def settings(**changes):
    joints = [{"position": 10, "velocity": 12}]
    state = {"heartbeat": 1, "automatic": True, "joints": joints}
    return ModbusClientSettings(**{"name": "s", "host": "h", "registers": state} | changes)


@pytest.mark.parametrize(
    ("changes", "robots", "said"),
    [
        ({}, [robot(), robot()], "of one robot, and has 2"),
        ({}, [robot(delay_s=0.0)], "needs motion"),
        ({"max_state_age_s": 0.06}, [robot()], "above motion.delay_s 0.05"),
        ({"robot_state_rate_hz": 20}, [robot()], "motion.delay_s allows 0.05; raise it"),
        ({"max_state_age_s": 0.015}, [robot()], "but max_state_age_s allows 0.015; raise it"),
        (
            {"robot_state_rate_hz": 10, "registers": DERIVED},
            [robot(delay_s=0.2)],
            "at most 0.06 s apart; raise robot_state_rate_hz to 17 or more",
        ),
    ],
)
def test_settings_that_do_not_fit_the_robot_are_refused(changes, robots, said):
    with pytest.raises(LinkError, match=said):
        ModbusClientLink.of_robots(settings(**changes), robots)


def test_the_age_of_the_states_is_the_robots():
    assert ModbusClientLink.of_robots(settings(), [robot()]).max_state_age_s == 0.05


@pytest.mark.parametrize(
    ("shape", "said"), [(StateShape(6, False), "1 entries"), (StateShape(1, True), "give it")]
)
def test_another_number_of_joints_is_refused(shape, said):
    with pytest.raises(LinkError, match=said):
        ModbusClientLink.load(settings(), 25.0, (0,), (shape,))
