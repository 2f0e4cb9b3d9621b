"""The 3D view in a real browser: it is up, the scene changes, the panel says the level."""

import io
import signal
import time

import matplotlib.image
import numpy as np
import pytest

from hri_predict.viewing.feed import VIEWER
from hri_predict.viewing.picture import Picture
from hri_predict.viewing.scene3d.panel import STILL_S
from tests.browser import CHROMIUM, Browser, wait_for
from tests.hri_predict.viewing.shown import Shown
from tests.hri_predict.viewing.staged import pictures
from tests.pictures import faded_in

pytest.importorskip("viser", reason="the extra viewer is not installed")


def scene(browser: Browser) -> np.ndarray:
    """The screen left of the panel, 0 to 1."""
    image = matplotlib.image.imread(io.BytesIO(browser.screenshot()))
    return image[:, : image.shape[1] - 420, :3]


def changed(browser: Browser, before: np.ndarray) -> float:
    """The share of the screen that is not as before."""
    return float((np.abs(scene(browser) - before).max(axis=-1) > 0.1).mean())


def settled(browser: Browser) -> np.ndarray:
    """The screen once it stays as it is; software draws about one frame a second."""

    def stays() -> bool:
        before = scene(browser)
        time.sleep(2.0)
        return bool(np.abs(scene(browser) - before).max() < 0.02)

    wait_for(stays, 60)
    return scene(browser)


PAUSE = "[...document.querySelectorAll('input[type=checkbox]')].at(-1).click()"


def track(number: int) -> str:
    """The track of a slider, for JavaScript."""
    return f"document.querySelectorAll('.mantine-Slider-track')[{number}]"


@pytest.mark.long
@pytest.mark.realtime
@pytest.mark.timeout(300)
@pytest.mark.skipif(CHROMIUM is None, reason="chromium is not installed")
def test_the_sliders_move_the_forecast_and_go_back_in_time():
    clear, stop = pictures([3.0, 5.2])
    with Shown(VIEWER) as view, Browser(900, 800) as browser:
        view.show(clear)
        browser.open(view.url)
        browser.wait_for_text(f"arm: {clear.facts['robots'][0]['level']}")
        time.sleep(4.0)
        view.show(stop)
        browser.wait_for_text(stop.facts["robots"][0]["apart"])
        wait_for(lambda: faded_in(browser), 120)
        left, top, right, bottom = browser.box(track(0))
        middle = 0.5 * (top + bottom)
        browser.click(left + 1, middle)
        now = settled(browser)
        browser.click(right - 1, middle)
        # zones grow, and bodies are drawn ahead
        wait_for(lambda: changed(browser, now) > 0.01, 60)

        left, top, right, bottom = browser.box(track(1))
        browser.click(left + (right - left) * (1 - 6.0 / 60), 0.5 * (top + bottom))
        browser.wait_for_text("NOT LIVE", 10)
        assert "s ago" in browser.text()
        assert browser.box(track(1)) == (left, top, right, bottom)  # it did not move under a hand
        browser.click(right - 1, 0.5 * (top + bottom))
        wait_for(lambda: "NOT LIVE" not in browser.text(), 10)
        browser.evaluate(PAUSE)
        browser.wait_for_text("NOT LIVE", 10)
        view.show(clear)
        time.sleep(2.0)
        assert stop.facts["robots"][0]["apart"] in browser.text()  # held
        browser.evaluate(PAUSE)
        wait_for(lambda: stop.facts["robots"][0]["apart"] not in browser.text(), 10)
        assert browser.console == []


@pytest.mark.long
@pytest.mark.realtime
@pytest.mark.timeout(240)
@pytest.mark.skipif(CHROMIUM is None, reason="chromium is not installed")
def test_a_browser_shows_the_cell_as_it_changes():
    clear, stop = pictures([3.0, 6.5])
    assert stop.facts["robots"][0]["level"] == "STOP"
    with Shown(VIEWER) as view, Browser(820, 420) as browser:
        view.show(clear)
        browser.open(view.url)
        browser.wait_for_text(f"arm: {clear.facts['robots'][0]['level']}")
        assert "25.0 Hz" in browser.text()
        wait_for(lambda: faded_in(browser), 120)
        before = scene(browser)

        view.show(stop)
        browser.wait_for_text("arm: STOP")
        browser.wait_for_text(stop.facts["robots"][0]["reason"])
        browser.wait_for_text(f"{stop.facts['robots'][0]['separation_m']:.2f} m")
        # a person and zones came: more than a fiftieth of the room
        wait_for(lambda: changed(browser, before) > 0.02, 60)

        injected = Picture(
            {**stop.facts, "robots": [{**stop.facts["robots"][0], "reason": "<b>x</b> & y"}]},
            *(getattr(stop, name) for name in ("bodies", "forecast", "zones", "robots")),
        )
        view.show(injected)
        browser.wait_for_text("<b>x</b> & y")  # as text

        view.show(None)
        browser.wait_for_text("NOT LIVE", 10)
        assert browser.console == []
        elsewhere = [u for u in browser.requested if u.startswith("http") and view.url not in u]
        assert elsewhere == []


@pytest.mark.long
@pytest.mark.realtime
@pytest.mark.timeout(300)
@pytest.mark.skipif(CHROMIUM is None, reason="chromium is not installed")
@pytest.mark.parametrize("how", [signal.SIGSTOP, signal.SIGKILL])
def test_a_view_whose_process_hangs_or_dies_is_covered_by_the_browser(how):
    opacity = "Number(getComputedStyle(document.querySelector('.still')).opacity)"
    (clear,) = pictures([3.0])
    with Shown(VIEWER) as view, Browser(900, 800) as browser:
        view.show(clear)
        browser.open(view.url)
        browser.wait_for_text(f"arm: {clear.facts['robots'][0]['level']}")
        left, top, right, bottom = browser.box("document.querySelector('.still')")
        assert (left, top) == (0, 0)
        assert [right, bottom] == browser.evaluate("[innerWidth, innerHeight]")
        wait_for(lambda: browser.evaluate(opacity) == 0, 60)
        fold = "document.querySelector('[data-dock-region-handle]')"
        assert (
            browser.evaluate(f"getComputedStyle({fold}).visibility") == "hidden"
        )  # it would go too
        view.process.send_signal(how)
        wait_for(lambda: browser.evaluate(opacity) == 1, 3 * STILL_S)
        time.sleep(2.0)
        assert browser.evaluate(opacity) == 1
        if how is signal.SIGSTOP:
            view.process.send_signal(signal.SIGCONT)
            wait_for(lambda: browser.evaluate(opacity) == 0, 60)
