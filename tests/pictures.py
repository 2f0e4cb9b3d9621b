"""Makes the pictures of pages in the documentation: ``python -m tests.pictures docs``.

Real ticks of the demo's cell, with a named zone and a field of view, and real messages of forty
cells, in a real browser.
"""

import argparse
import tempfile
import time
from pathlib import Path

from hri_predict.run.session import Options, run
from hri_predict.viewing.feed import OPERATOR, VIEWER
from hri_predict.viewing.fleet_feed import FLEET
from hri_predict.viewing.picture import Picture
from hri_predict.viewing.recorded import RecordedPictures
from tests.browser import Browser, wait_for
from tests.hri_predict.viewing.many import forty
from tests.hri_predict.viewing.shown import Shown
from tests.hri_predict.viewing.staged import cell, pictures

_CLOSE = "document.querySelectorAll('.mantine-Notification-closeButton').forEach(e => e.click())"


def faded_in(browser: Browser) -> bool:
    """Whether viser shows its scene wholly: it does so slowly."""
    script = "Math.min(1, ...[...document.querySelectorAll('canvas')].map("
    return bool(browser.evaluate(script + "c => +getComputedStyle(c).opacity))") > 0.99)


def shot(module: str, picture: Picture, size: tuple[int, int]) -> bytes:
    """A screen's page with this picture, as PNG."""
    with Shown(module) as screen, Browser(*size) as browser:
        screen.show(picture)
        return _drawn(browser, screen.url, picture.facts["robots"][0]["reason"], size)


def shot_of_recording(path: Path, at_s: float, size: tuple[int, int]) -> bytes:
    """A recording in the 3D view, so many seconds after its start, as PNG."""
    from hri_predict.viewing.scene3d.playback import Playback

    shown = Playback(RecordedPictures(path), "127.0.0.1", 0)
    shown.go(at_s)
    shown.draw(0.0)
    try:
        with Browser(*size) as browser:
            return _drawn(browser, shown.url, "RECORDED", size)
    finally:
        shown.server.stop()


def _drawn(browser: Browser, url: str, text: str, size: tuple[int, int]) -> bytes:
    """The page when it shows a text and its scene wholly, without the browser's own notes."""
    width, height = size
    browser.ask(
        "Emulation.setDeviceMetricsOverride",
        **{"width": width, "height": height, "deviceScaleFactor": 1, "mobile": False},
    )
    browser.open(url)
    browser.wait_for_text(text)
    wait_for(lambda: faded_in(browser), 240)
    browser.evaluate(_CLOSE)
    time.sleep(3.0)  # software draws about one frame a second
    return browser.screenshot()


def shot_of_many(picture: Picture, size: tuple[int, int]) -> bytes:
    """The page of many cells with this picture, as PNG of just this size."""
    width, height = size
    with Shown(FLEET) as screen, Browser(*size) as browser:
        browser.ask(
            "Emulation.setDeviceMetricsOverride",
            width=width,
            height=height,
            deviceScaleFactor=1,
            mobile=False,
        )
        screen.show(picture)
        browser.open(screen.url)
        browser.wait_for_text(picture.facts["cells"][0]["name"])
        return browser.screenshot()


def main() -> None:
    """Make all of them."""
    parser = argparse.ArgumentParser()
    parser.add_argument("folder", type=Path)
    folder = parser.parse_args().folder
    far, near = pictures([5.2, 6.5], "sinn")
    folder.joinpath("viewer.png").write_bytes(shot(VIEWER, far, (1400, 900)))
    folder.joinpath("operator.png").write_bytes(shot(OPERATOR, near, (1200, 780)))
    folder.joinpath("fleet.png").write_bytes(shot_of_many(forty(), (1920, 1080)))
    with tempfile.TemporaryDirectory() as name:
        path = Path(name, "monday.mcap")
        options = Options(factor=None, duration_s=20.0, record=path)
        run(cell(Path(name), "sinn").quiet(), options)
        recording = shot_of_recording(path, 7.4, (1400, 900))
    folder.joinpath("guides", "recording-view.png").write_bytes(recording)


if __name__ == "__main__":
    main()
