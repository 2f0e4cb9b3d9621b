"""Makes the pictures of pages in the documentation: ``python -m tests.pictures docs``.

Real ticks of the demo's cell, with a named zone and a field of view, and real messages of forty
cells, in a real browser.
"""

import argparse
import time
from pathlib import Path

from hri_predict.viewing.feed import OPERATOR, VIEWER
from hri_predict.viewing.fleet_feed import FLEET
from hri_predict.viewing.picture import Picture
from tests.browser import Browser, wait_for
from tests.hri_predict.viewing.many import forty
from tests.hri_predict.viewing.shown import Shown
from tests.hri_predict.viewing.staged import pictures

_CLOSE = "document.querySelectorAll('.mantine-Notification-closeButton').forEach(e => e.click())"


def faded_in(browser: Browser) -> bool:
    """Whether viser shows its scene wholly: it does so slowly."""
    script = "Math.min(...[...document.querySelectorAll('canvas')].map("
    return bool(browser.evaluate(script + "c => +getComputedStyle(c).opacity))") > 0.99)


def shot(module: str, picture: Picture, size: tuple[int, int]) -> bytes:
    """A screen's page with this picture, as PNG."""
    with Shown(module) as screen, Browser(*size) as browser:
        screen.show(picture)
        browser.open(screen.url)
        browser.wait_for_text(picture.facts["robots"][0]["reason"])
        wait_for(lambda: module != VIEWER or faded_in(browser), 240)
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
    folder.joinpath("viewer.png").write_bytes(shot(VIEWER, far, (1200, 780)))
    folder.joinpath("operator.png").write_bytes(shot(OPERATOR, near, (1200, 780)))
    folder.joinpath("fleet.png").write_bytes(shot_of_many(forty(), (1920, 1080)))


if __name__ == "__main__":
    main()
