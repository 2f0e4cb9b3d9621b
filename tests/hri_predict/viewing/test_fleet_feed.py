import os
import signal
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from hri_predict.viewing import screen as screens
from hri_predict.viewing.fleet_feed import FleetFeed
from hri_predict.viewing.screen import ScreenSettings
from tests.browser import wait_for

READS = """
import sys
from hri_predict.viewing.picture import read
while (picture := read(sys.stdin.buffer)) is not None:
    for change in picture.facts["changes"]:
        print(change["number"], flush=True)
"""


class Said:
    """Facts with as many changes as somebody made."""

    def __init__(self, size: int = 0) -> None:
        self.newest, self.asked, self.text = 0, 0, size * "x"

    def __call__(self, after: int) -> dict[str, Any]:
        self.asked += 1
        changes = [{"number": n} for n in range(after + 1, self.newest + 1)]
        return {"cells": [], "changes": changes, "text": self.text}


@contextmanager
def feeding(tmp_path: Path, monkeypatch: Any, code: str, said: Said) -> Iterator[FleetFeed]:
    (tmp_path / "own_screen.py").write_text(code)
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(tmp_path), *sys.path]))
    with FleetFeed(ScreenSettings("operator", "own_screen", 0), said) as feed:
        yield feed


def numbers(capfd: Any, enough: Callable[[list[int]], bool]) -> list[int]:
    said: list[int] = []

    def read() -> bool:
        lines = capfd.readouterr().err.splitlines()
        said.extend(int(line.split()[-1]) for line in lines if line.startswith("operator: "))
        return enough(said)

    wait_for(read)
    return said


def test_each_change_reaches_the_page_once(tmp_path, monkeypatch, capfd):
    said = Said()
    with feeding(tmp_path, monkeypatch, READS, said) as feed:
        for _ in range(5):
            said.newest += 2
            feed.wake()
            time.sleep(0.08)
        assert numbers(capfd, lambda all: len(all) >= 10) == list(range(1, 11))


def test_what_a_page_that_hangs_did_not_take_comes_later(tmp_path, monkeypatch, capfd):
    said = Said(size=300_000)  # more than a pipe holds: a picture is not taken until one was read
    with feeding(tmp_path, monkeypatch, READS, said) as feed:
        screen = feed._screen
        assert screen is not None
        said.newest = 1
        assert numbers(capfd, bool) == [1]
        screen.process.send_signal(signal.SIGSTOP)
        wait_for(lambda: feed.dropped > 1)
        said.newest = 9
        dropped = feed.dropped
        wait_for(lambda: feed.dropped > dropped)
        screen.process.send_signal(signal.SIGCONT)
        assert numbers(capfd, lambda all: 9 in all) == list(range(2, 10))


def test_a_page_that_starts_again_hears_of_all_changes(tmp_path, monkeypatch, capfd):
    monkeypatch.setattr(screens, "PAUSE_S", 0.01)
    said = Said()
    with feeding(tmp_path, monkeypatch, READS, said) as feed:
        screen = feed._screen
        assert screen is not None
        said.newest = 3
        feed.wake()
        assert numbers(capfd, lambda all: len(all) == 3) == [1, 2, 3]
        screen.process.kill()
        again = numbers(capfd, lambda all: len(all) == 3)
    assert (again, screen.starts) == ([1, 2, 3], 2)


def test_waking_often_makes_no_more_than_twenty_pictures_a_second(tmp_path, monkeypatch):
    said = Said()
    with feeding(tmp_path, monkeypatch, READS, said) as feed:
        began_s, before = time.monotonic(), said.asked
        while time.monotonic() - began_s < 0.5:
            feed.wake()
            time.sleep(0.001)
        asked, took_s = said.asked - before, time.monotonic() - began_s
    assert asked <= took_s / 0.05 + 2  # one at each end; a busy machine takes longer than 0.5 s


@pytest.mark.parametrize("code", ["pass", "import time\ntime.sleep(60)"])
def test_a_page_that_died_or_hangs_costs_pictures_alone(tmp_path, monkeypatch, code):
    monkeypatch.setattr(screens, "END_S", 0.2)
    with feeding(tmp_path, monkeypatch, code, Said(size=300_000)) as feed:
        wait_for(lambda: feed.dropped > 1)
