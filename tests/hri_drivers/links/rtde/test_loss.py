"""The last word of a lost connection, on a virtual clock and a wire of our own."""

import struct

import pytest

from hri_drivers.links.rtde.link import RtdeLink, RtdeLinkSettings
from hri_drivers.links.rtde.packets import Packet
from hri_drivers.links.rtde.robot import OUTPUTS
from hri_drivers.links.rtde.transport import RtdeTransport
from hri_predict.base.clock import VirtualClock
from hri_predict.base.errors import LinkError
from hri_predict.operation.monitoring.summary import _link_row, _link_trouble
from hri_predict.protocol.messages import Advice, Level
from hri_predict.protocol.reasons import Reason

CLEAR = Advice(robot=0, level=Level.CLEAR, reason=Reason.NONE, speed_limit_m_s=1.0, age_s=0.05)
CYCLE_NS = 8_000_000


class Wire:
    """Keeps what is written; fails to read when it is asked to."""

    def __init__(self) -> None:
        self.written: list[tuple[int, float, int, int]] = []
        self.lost = False

    def open(self) -> None:
        pass

    def close(self) -> None:
        pass

    def write(self, unit: Packet) -> None:
        self.written.append(struct.unpack(">Idii", unit.data))

    def read(self, timeout_s: float) -> list[Packet]:
        if self.lost:
            raise LinkError("bytes that are not RTDE")
        return []


def test_a_controller_that_is_not_understood_hears_a_stop_as_the_last_word():
    wire, clock = Wire(), VirtualClock(0)
    settings = RtdeLinkSettings(
        name="arm", host="127.0.0.1", full_speed_m_s=1.0, max_age_s=0.4, hold_s=0.0, rise_per_s=2.0
    )
    link = RtdeLink(settings, clock, wire)
    for now_ns in range(CYCLE_NS, 100 * CYCLE_NS, CYCLE_NS):
        link.post(CLEAR)
        link.service(now_ns)
    assert wire.written[-1][1] == 1.0
    wire.lost = True
    link.service(100 * CYCLE_NS)
    assert not link.connected
    assert link.last_error == "bytes that are not RTDE"
    _, fraction, _, level = wire.written[-1]
    assert (fraction, level) == (0.0, Level.UNKNOWN)


def test_the_counters_show_that_the_link_stopped_the_robot_by_itself():
    wire = Wire()
    settings = RtdeLinkSettings(name="arm", host="127.0.0.1", full_speed_m_s=1.0, max_age_s=0.4)
    link = RtdeLink(settings, VirtualClock(0), wire)
    for cycle in range(1, 100):
        if cycle < 10 or 50 <= cycle < 60:
            link.post(CLEAR)
        link.service(cycle * CYCLE_NS)
    assert link.counters.advice_timeouts == 2
    assert _link_trouble(_link_row(link, True)) == "arm: advice_timeouts 2"


def test_nothing_follows_a_packet_that_was_cut():
    class Full:
        """A socket whose buffer is full in the middle of a packet."""

        def __init__(self) -> None:
            self.heard = b""

        def sendall(self, data: bytes) -> None:
            self.heard += data[:9]
            raise TimeoutError

        def shutdown(self, how: int) -> None:
            pass

        def close(self) -> None:
            pass

    wire = RtdeTransport(("127.0.0.1", 1), OUTPUTS, OUTPUTS, 125.0)
    full = Full()
    wire._socket = full  # type: ignore[assignment]
    for said in ("connection lost", "is closed"):
        with pytest.raises(LinkError, match=said):
            wire.write(Packet(ord("U"), bytes(20)))
    assert len(full.heard) == 9


@pytest.mark.parametrize("host", ["a" * 70 + ".b", "a..b", "a\0b"])
def test_a_host_that_none_can_be_is_one_line(host):
    with pytest.raises(LinkError, match=r"cannot connect: .*; .* correct 'host'"):
        RtdeTransport((host, 1), OUTPUTS, OUTPUTS, 125.0).open()
