"""Text messages from the controller in the log, on a virtual clock."""

from hri_drivers.links.configured import SAY_NS
from hri_drivers.links.rtde.link import RtdeLink, RtdeLinkSettings
from hri_drivers.links.rtde.packets import Kind, Packet
from hri_predict.base.clock import VirtualClock
from tests.hri_drivers.links.rtde.test_loss import CYCLE_NS, Wire


class TalkativeWire(Wire):
    """Brings one text with each reading."""

    def __init__(self) -> None:
        super().__init__()
        self.texts: list[bytes] = []

    def read(self, timeout_s: float) -> list[Packet]:
        texts, self.texts = self.texts, []
        return [Packet(Kind.TEXT, bytes((len(text),)) + text) for text in texts]


def test_texts_that_change_with_each_cycle_are_logged_each_ten_seconds(caplog):
    wire = TalkativeWire()
    settings = RtdeLinkSettings(name="arm", host="127.0.0.1", full_speed_m_s=1.0, max_age_s=0.4)
    link = RtdeLink(settings, VirtualClock(0), wire)
    cycles = 2 * SAY_NS // CYCLE_NS
    for k in range(1, cycles + 1):
        wire.texts = [b"overrun %d" % k]
        link.service(k * CYCLE_NS)
    assert caplog.messages == [
        f"link 'arm': message from the controller: overrun {k}" for k in (1, cycles // 2 + 1)
    ]
    assert link.counters.ignored == cycles


def test_a_text_that_repeats_is_logged_once(caplog):
    wire = TalkativeWire()
    settings = RtdeLinkSettings(name="arm", host="127.0.0.1", full_speed_m_s=1.0, max_age_s=0.4)
    link = RtdeLink(settings, VirtualClock(0), wire)
    for k in range(1, 5):
        wire.texts = [b"remote control is off"]
        link.service(k * SAY_NS)
    assert [line.rpartition(": ")[2] for line in caplog.messages] == ["remote control is off"]
