"""The link and an OPC UA server in another process, by asyncua's server."""

import math

import pytest

pytest.importorskip("asyncua", reason="asyncua is not installed: the link cannot be used")
from hri_drivers.links.opcua_client.link import OpcUaClientSettings
from hri_predict.base.errors import LinkError
from hri_predict.protocol.messages import RobotMode
from hri_sim.robot_server.process import ServerProcess
from tests.hri_drivers.links.polled.servers import made, states
from tests.waiting import eventually

pytestmark = [pytest.mark.realtime, pytest.mark.long]  # its server takes seconds to start


@pytest.fixture(scope="module")
def server():
    started = ServerProcess("opcua", "wrong type")
    yield started
    started.kill()


@pytest.fixture
def link(server):
    found = made("opcua", server.port)
    found.start()
    yield found
    found.stop()


def test_degrees_become_rad_and_the_counter_advances(link):
    found = states(link, 20)
    assert found[-1].counter > 5
    assert {state.mode for state in found} == {RobotMode.AUTOMATIC}
    assert found[0].positions[1] == pytest.approx(-1.57, abs=0.25)  # it swings by 0.2 rad
    assert link.counters.malformed == 0


def test_a_text_where_a_number_belongs_is_said_and_no_position(server, link):
    states(link, 3)
    server.toggle()
    eventually(lambda: any(math.isnan(state.positions[2]) for state in states(link, 1)))
    words = "'ns=2;s=Robot.Joint3.Position'): it holds str"
    eventually(lambda: words in (link.last_error or ""))
    server.toggle()
    eventually(lambda: not math.isnan(states(link, 1)[-1].positions[2]))


def test_a_node_that_is_not_there_is_said_at_the_start(server):
    other = made("opcua", server.port, {"heartbeat": "ns=2;s=Beat"}, wait_for_device=False)
    with pytest.raises(LinkError, match=r"heartbeat \('ns=2;s=Beat'\).*BadNodeIdUnknown.*correct"):
        other.start()


def test_a_server_that_ends_is_connected_again():
    first = ServerProcess("opcua")
    link = made("opcua", first.port)
    link.start()
    try:
        before = states(link, 3)[-1].counter
        first.kill()
        eventually(lambda: not link.connected)
        second = ServerProcess("opcua", port=first.port)
        try:
            eventually(lambda: any(state.counter > before for state in states(link, 1)))
        finally:
            second.kill()
    finally:
        link.stop()
        first.kill()


def test_the_connection_to_a_server_that_hangs_is_closed_at_once():
    hung = ServerProcess("opcua")
    link = made("opcua", hung.port)
    link.start()
    try:
        states(link, 3)
        transport = link._transport._client.uaclient.protocol.transport
        connection = transport.get_extra_info("socket")
        assert connection.fileno() >= 0
        hung.hang(True)
        link.stop()
        assert connection.fileno() < 0  # this test holds the transport: no collector closes it
    finally:
        link.stop()
        hung.kill()


@pytest.mark.parametrize("node", ["Heartbeat", "ns=2", "ns=2;x=1", "ns=2;s=", "i=one"])
def test_what_is_no_node_id_is_refused(node):
    joints = [{"position": "i=2", "velocity": "i=3"}]
    state = {"heartbeat": node, "automatic": True, "joints": joints}
    with pytest.raises(ValueError, match="heartbeat"):
        OpcUaClientSettings(name="s", host="h", nodes=state)
