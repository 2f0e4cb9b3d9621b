"""The 3D view in a real browser: it is up, the scene changes, the panel says the level."""

import io
import time

import matplotlib.image
import numpy as np
import pytest

from hri_predict.viewing.feed import VIEWER
from hri_predict.viewing.picture import Picture
from tests.browser import CHROMIUM, Browser, wait_for
from tests.hri_predict.viewing.shown import Shown
from tests.hri_predict.viewing.staged import pictures
from tests.pictures import faded_in

pytest.importorskip("viser", reason="the extra viewer is not installed")


def scene(browser: Browser) -> np.ndarray:
    """The screen left of the panel, 0 to 1."""
    image = matplotlib.image.imread(io.BytesIO(browser.screenshot()))
    return image[:, : image.shape[1] - 420, :3]


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
        browser.wait_for_text("a person is too close")
        browser.wait_for_text(f"{stop.facts['robots'][0]['separation_m']:.2f} m")
        time.sleep(2.0)  # software draws about one frame a second
        changed = np.abs(scene(browser) - before).max(axis=-1) > 0.1
        assert changed.mean() > 0.02  # a person and zones came: more than a fiftieth of the room

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
