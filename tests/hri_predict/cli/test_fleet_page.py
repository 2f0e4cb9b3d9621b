"""``hri-predict fleet --operator`` with real links, its page in a real browser: one goes silent,
the program hangs, the program is killed."""

import os
import re
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager

import pytest

from hri_drivers.links.zenoh.link import ZenohLink, ZenohLinkSettings
from hri_predict.base.clock import MonotonicClock
from hri_predict.base.errors import ConfigError
from hri_predict.cli.fleet import fleet
from hri_predict.protocol.codec import SCHEMA_HASH, SCHEMA_VERSION
from hri_predict.protocol.messages import Advice, Level, Schema
from hri_predict.protocol.reasons import Reason
from tests.browser import CHROMIUM, Browser, wait_for
from tests.messages import make_status
from tests.waiting import free_port

WORDS = "[...document.querySelectorAll('.tile .word')].map(word => word.textContent).join()"


class Speaker:
    """A cell that sends 25 times a second, over a link of its own."""

    def __init__(self, cell: str, end: str) -> None:
        settings = ZenohLinkSettings(name="fleet", site="plant", cell=cell, connect=[end])
        self.level, self.reason = Level.CLEAR, Reason.NONE
        self._link = ZenohLink(settings, MonotonicClock(), rate_hz=25.0)
        self._link.start()
        self._end = threading.Event()
        self._thread = threading.Thread(target=self._speak, daemon=True)
        self._thread.start()

    def stop(self) -> None:
        self._end.set()
        self._thread.join()
        self._link.stop()

    def _speak(self) -> None:
        cycle = 0
        while not self._end.wait(0.04):
            now_ns = time.monotonic_ns()
            advice = Advice(robot=0, level=self.level, reason=self.reason, capture_ns=now_ns)
            status = make_status(people=1, cycle=cycle % 256, capture_ns=now_ns)
            for message in (advice, status):
                self._link.post(message)
            if cycle % 25 == 0:
                self._link.post(Schema(SCHEMA_VERSION, SCHEMA_HASH))
            cycle += 1


@contextmanager
def watching(end: str) -> Iterator[tuple["subprocess.Popen[str]", str]]:
    """``hri-predict fleet`` and its page's address."""
    command = [sys.executable, "-m", "hri_predict", "fleet", "--listen", end, "--operator", "0"]
    process = subprocess.Popen(
        command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True
    )
    assert process.stderr is not None
    try:
        found = next(filter(None, (re.match("operator: (http.*)", x) for x in process.stderr)))
        yield process, found[1]
    finally:
        process.kill()
        process.wait()
        process.stderr.close()


@pytest.mark.long
@pytest.mark.realtime
@pytest.mark.skipif(CHROMIUM is None, reason="chromium is not installed")
def test_a_cell_falls_silent_the_program_hangs_and_is_killed() -> None:
    end = f"tcp/127.0.0.1:{free_port()}"
    with watching(end) as (process, url), Browser(1200, 700) as browser:
        speakers = [Speaker(name, end) for name in ("mill", "press", "weld")]
        try:
            browser.open(url)
            wait_for(lambda: browser.evaluate(WORDS) == "CLEAR,CLEAR,CLEAR")
            assert browser.evaluate("document.querySelectorAll('li').length") == 0

            speakers[2].level, speakers[2].reason = Level.STOP, Reason.PERSON_NEAR
            wait_for(lambda: browser.evaluate(WORDS) == "CLEAR,CLEAR,STOP", 5)
            assert "STOP\nplant/weld\na person is too close" in browser.text()

            speakers[0].stop()
            wait_for(lambda: browser.evaluate(WORDS) == "NO CONTACT,CLEAR,STOP", 5)
            assert "NO CONTACT\nplant/mill" in browser.text()

            os.kill(process.pid, signal.SIGSTOP)
            wait_for(lambda: is_gone(browser), 10)
            assert "Nothing here is current." in browser.text()
            os.kill(process.pid, signal.SIGCONT)
            wait_for(lambda: browser.evaluate(WORDS) == "NO CONTACT,CLEAR,STOP")

            os.kill(process.pid, signal.SIGKILL)  # its page ends with it
            browser.wait_for_text("this page lost hri-predict fleet", 15)
            assert is_gone(browser)
            assert browser.console == []
        finally:
            for speaker in speakers:
                speaker.stop()


def is_gone(browser: Browser) -> bool:
    return bool(browser.evaluate(WORDS) == "NO CONTACT,NO CONTACT,NO CONTACT")


def test_a_port_that_is_none_is_one_line_before_anything_starts() -> None:
    with pytest.raises(ConfigError, match="--operator 70000: give a port from 0 to 65535"):
        fleet(operator=70000)
