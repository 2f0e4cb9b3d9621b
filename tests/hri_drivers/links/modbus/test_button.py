"""The button that the page on restarts shows, at the link's own registers."""

from typing import Any

import pytest

pytest.importorskip("pymodbus", reason="pymodbus is not installed: the link cannot be used")
from hri_drivers.links.modbus.link import ModbusLink, ModbusLinkSettings
from hri_drivers.links.modbus.server import ModbusTransport
from hri_predict.base.clock import MonotonicClock
from hri_predict.protocol.messages import Acknowledge, Advice, Level
from hri_predict.protocol.reasons import Reason
from tests import pages
from tests.waiting import eventually

pytestmark = pytest.mark.realtime
PATIENT_S = 2.0  # silence on a machine that is busy with other things


@pytest.fixture
def link():
    settings = ModbusLinkSettings(name="plc", port=0, silence_timeout_s=PATIENT_S, max_age_s=5)
    made = ModbusLink(settings, MonotonicClock())
    made.start()
    assert isinstance(made._transport, ModbusTransport)
    yield made, made._transport.port
    made.stop()


def run(port, monkeypatch):
    """Run the page's program; return what it asked its person."""
    asked: list[str] = []

    def answer(text: str) -> str:
        asked.append(text)
        return ""

    monkeypatch.setattr("builtins.input", answer)
    code = pages.named("button.py", pages.ROOT / "docs" / "guides" / "restart.md").text
    exec(code.replace("5020", str(port)), {})
    return asked


def latched(latch_id):
    return Advice(robot=0, level=Level.STOP, reason=Reason.LATCHED, age_s=0.05, latch_id=latch_id)


def test_the_button_of_the_page_presses_and_lets_go(link, monkeypatch):
    served, port = link
    before = served.counters.messages_sent
    served.post(latched(77))
    eventually(lambda: served.counters.messages_sent > before)
    assert len(run(port, monkeypatch)) == 2
    heard: list[Any] = []

    def both() -> bool:
        heard.extend(r.message for r in served.take())
        return len(heard) == 2

    eventually(both)
    press, release = heard
    assert press == Acknowledge(77, press.ack_id)
    assert release == Acknowledge(0, press.ack_id)
    assert press.ack_id > 0


def test_while_nothing_is_latched_no_person_is_asked(link, monkeypatch):
    with pytest.raises(SystemExit, match="nothing to acknowledge"):
        run(link[1], monkeypatch)
