"""The page of many cells: what it is told, and a real browser that shows it."""

import http.client
import json
import signal
import threading
import time
from dataclasses import replace

import pytest

from hri_predict.protocol.messages import Level, NodeState
from hri_predict.protocol.reasons import Reason
from hri_predict.viewing.fleet_feed import FLEET
from hri_predict.viewing.operator.fleet import FleetState
from hri_predict.viewing.operator.server import Server
from tests.browser import CHROMIUM, Browser, wait_for
from tests.hri_predict.operation.monitoring.said import CLEAR, OURS, RUNNING
from tests.hri_predict.viewing.many import Cells, forty
from tests.hri_predict.viewing.shown import Shown

HOSTILE = [
    "<img src=x onerror=alert(1)>",
    "x" * 5000,
    "\u202eevil",
    "مصنع/خلية",
    "",
    "",
    "twice",
    "twice",
    "__proto__",
    "constructor",
    "\n\t\0",
    '"><script>alert(1)</script>',
]
TILES = "[...document.querySelectorAll('.tile')]"


def two() -> Cells:
    cells = Cells()
    cells.advise("press", Level.CLEAR)
    cells.advise("weld", Level.STOP, Reason.PERSON_NEAR, speed_limit_m_s=0.0)
    return cells


def test_the_page_is_told_every_cell_with_its_age_as_it_is_now():
    state, cells = FleetState(), two()
    cells.pass_s(0.1)
    state.take(cells.picture(), time.monotonic() - 0.5)
    told = state.told()
    assert told["known"]
    assert [(c["name"], c["level"]) for c in told["cells"]] == [
        ("plant/press", "CLEAR"),
        ("plant/weld", "STOP"),
    ]
    assert all(0.6 <= cell["heard_s"] < 5.0 for cell in told["cells"])
    assert [row["cell"] for row in told["history"]] == ["plant/weld"]


def test_without_fresh_pictures_names_are_told_and_no_level():
    state = FleetState()
    assert state.told()["why"] == "waiting for hri-predict fleet"
    state.take(two().picture(), time.monotonic() - 1.5)
    told = state.told()
    assert not told["known"]
    assert "cells" not in told
    assert told["names"] == ["plant/press", "plant/weld"]
    assert "nothing from hri-predict fleet" in told["why"]


def test_its_files_come_from_the_same_server():
    server = Server(host="127.0.0.1", port=0, state=FleetState(), name="fleet")
    threading.Thread(target=server.serve_forever, args=(0.05,), daemon=True).start()
    try:
        for path in ("/", "/fleet.js", "/fleet.css", "/common.js", "/common.css"):
            connection = http.client.HTTPConnection("127.0.0.1", server.server_port, timeout=10)
            connection.request("GET", path)
            answer = connection.getresponse()
            body = answer.read()
            assert answer.status == 200, path
            assert b"://" not in body.replace(b"http://www.w3.org/2000/svg", b"")
    finally:
        server.shutdown()
        server.server_close()


def words(browser: Browser) -> list[str]:
    found: list[str] = browser.evaluate(
        TILES + ".map(tile => tile.querySelector('.word').textContent)"
    )
    return found


@pytest.mark.long
@pytest.mark.realtime
@pytest.mark.skipif(CHROMIUM is None, reason="chromium is not installed")
def test_a_browser_shows_tiles_alerts_and_details_and_never_an_old_green():
    cells = two()
    with Shown(FLEET) as page, Browser(1600, 900) as browser:
        page.show(cells.picture())
        browser.open(page.url)
        browser.wait_for_text("plant/press")
        assert words(browser) == ["CLEAR", "STOP"]
        look = "getComputedStyle(document.querySelector('.tile')).background"
        green = browser.evaluate(look)
        first = browser.evaluate("document.getElementById('first').textContent")
        assert first == "Look first at ■plant/weld"

        browser.evaluate(TILES + "[1].click()")
        browser.wait_for_text("robot 0: STOP")
        assert "0.00 m/s allowed" in browser.text()
        unread = "document.querySelectorAll('li button').length"
        assert browser.evaluate(unread) == 1
        browser.evaluate("document.querySelector('li button').click()")
        wait_for(lambda: browser.evaluate(unread) == 0, 5)
        assert words(browser)[1] == "STOP"  # the stop stands

        cells.pass_s(0.3)
        cells.advise("weld", Level.CLEAR)
        cells.pass_s(0.3)  # press says nothing for 0.6 s
        page.show(cells.picture())
        wait_for(lambda: words(browser) == ["NO CONTACT", "CLEAR"], 5)
        assert browser.evaluate(look) != green
        assert "NO CONTACT\nplant/press\nno messages" in browser.text()  # its alert

        cells.advise("press", Level.CLEAR)
        cells.advise("weld", Level.CLEAR)
        page.show(cells.picture())
        wait_for(lambda: words(browser) == ["CLEAR", "CLEAR"], 5)
        page.process.send_signal(signal.SIGSTOP)  # the page's own process hangs
        since = time.monotonic()
        wait_for(lambda: words(browser) == ["NO CONTACT", "NO CONTACT"], 10)
        assert time.monotonic() - since < 2.5  # 1.5 s, and the browser's answer
        assert "this page lost hri-predict fleet" in browser.text()
        page.process.send_signal(signal.SIGCONT)
        wait_for(lambda: words(browser) == ["CLEAR", "CLEAR"], 5)
        page.show(None)  # hri-predict fleet hangs
        browser.wait_for_text("nothing from hri-predict fleet", 5)
        assert words(browser) == ["NO CONTACT", "NO CONTACT"]
        assert browser.console == []


@pytest.mark.long
@pytest.mark.realtime
@pytest.mark.skipif(CHROMIUM is None, reason="chromium is not installed")
def test_what_to_look_at_first_is_legible_in_each_width_with_few_and_many_cells():
    whole = "(e => e.scrollHeight <= e.clientHeight + 1 && e.scrollWidth <= e.clientWidth)"
    picture = forty()
    with Shown(FLEET) as page, Browser(1920, 1080) as browser:
        page.show(picture)
        browser.open(page.url)
        browser.wait_for_text("plant/press-01")
        for count in (40, 6, 1):
            some = picture.facts["cells"][-count:]  # one of the last six is slowed
            page.show(replace(picture, facts=picture.facts | {"cells": some}))
            wait_for(lambda count=count: browser.evaluate(TILES + ".length") == count, 10)
            for width in (700, 900, 1280, 1920):
                size = {"width": width, "height": 800, "deviceScaleFactor": 1, "mobile": False}
                browser.ask("Emulation.setDeviceMetricsOverride", **size)
                where = f"{count} cells, {width} px"
                first = "document.getElementById('first')"
                assert browser.evaluate(f"{whole}({first})"), where
                left, top, right, _ = browser.box(first)
                assert right - left > 300, where
                counts = browser.box("document.getElementById('counts')")
                assert right <= counts[0] or left >= counts[2] or top >= counts[3], where
                assert browser.evaluate("document.body.scrollWidth <= innerWidth"), where
        assert browser.console == []


@pytest.mark.long
@pytest.mark.realtime
@pytest.mark.skipif(CHROMIUM is None, reason="chromium is not installed")
def test_a_degraded_cell_says_so_once():
    cells = Cells()
    status = replace(RUNNING, node_state=NodeState.DEGRADED, reason=Reason.PREDICTOR_LATE)
    cells.say("press", OURS, status, CLEAR)
    with Shown(FLEET) as page, Browser(1280, 800) as browser:
        page.show(cells.picture())
        browser.open(page.url)
        browser.wait_for_text("plant/press")
        browser.evaluate(TILES + "[0].click()")
        browser.wait_for_text("last message")
        facts = browser.evaluate("document.querySelector('#details dl').innerText")
        assert facts.count("degraded") == 1
        assert f"degraded: {Reason.PREDICTOR_LATE.text}" in facts


@pytest.mark.long
@pytest.mark.realtime
@pytest.mark.skipif(CHROMIUM is None, reason="chromium is not installed")
def test_a_page_whose_script_hangs_is_covered_by_the_browser():
    covered = "getComputedStyle(document.getElementById('still')).opacity"
    with Shown(FLEET) as page, Browser(800, 600) as browser:
        page.show(two().picture())
        browser.open(page.url)
        browser.wait_for_text("plant/press")
        time.sleep(3.5)
        assert float(browser.evaluate(covered)) == 0
        browser.evaluate("alive = () => {}")  # nothing is drawn from now on
        wait_for(lambda: float(browser.evaluate(covered)) == 1, 10)


@pytest.mark.long
@pytest.mark.realtime
@pytest.mark.skipif(CHROMIUM is None, reason="chromium is not installed")
def test_hostile_names_levels_and_reasons_are_shown_as_text():
    picture = forty()
    for cell, name in zip(picture.facts["cells"], HOSTILE, strict=False):
        cell["name"] = name
    picture.facts["cells"][1]["reason"] = "<h1>" + "y" * 4000
    picture.facts["cells"][2]["level"] = "__proto__"
    picture.facts["changes"][-1] |= {"cell": HOSTILE[0], "level": "<b>", "reason": HOSTILE[-1]}
    with Shown(FLEET) as page, Browser(1920, 1080) as browser:
        page.show(picture)
        browser.open(page.url)
        browser.wait_for_text(HOSTILE[0])
        assert browser.evaluate(TILES + ".length") == 40
        names = browser.evaluate(TILES + ".map(t => t.querySelector('.name').textContent)")
        assert names[4:8] == ["(no name)", "(no name)", "twice", "twice"]
        assert names[2] == "\ufffdevil"
        assert names[10] == "\ufffd\ufffd\ufffd"
        assert len(names[1]) < 400
        assert words(browser)[2] == "UNKNOWN"  # a level that nobody knows
        assert browser.evaluate("document.querySelectorAll('img, h1, b b, li script').length") == 0
        for i in range(len(HOSTILE)):
            browser.evaluate(TILES + f"[{i}].click()")
            assert browser.evaluate(TILES + ".filter(t => t.matches('.chosen')).length") == 1
        wide = f"{TILES}.every(t => t.scrollWidth <= t.clientWidth)"
        assert browser.evaluate(wide)
        assert browser.evaluate("document.body.scrollWidth <= innerWidth")
        assert browser.console == []
        assert json.dumps(browser.requested).count("http") <= 12  # from this server alone
        assert all(url.startswith(page.url) for url in browser.requested)
