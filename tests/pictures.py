"""Makes the pictures of pages in the documentation: ``python -m tests.pictures docs``.

Real ticks of the demo's cell, with a named zone and a field of view, and real messages of forty
cells, in a real browser.
"""

import argparse
import io
import tempfile
import time
from pathlib import Path

from rich.console import Console
from rich.terminal_theme import SVG_EXPORT_THEME

from hri_predict.cli.tryout.command import Place, with_person
from hri_predict.run.session import Options, run
from hri_predict.viewing.feed import OPERATOR, VIEWER
from hri_predict.viewing.fleet_feed import FLEET
from hri_predict.viewing.picture import Picture
from hri_predict.viewing.recorded import RecordedPictures
from tests.browser import Browser, wait_for
from tests.hri_predict.cli.terminal.shown import demo, view_after
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


def _sized(browser: Browser, size: tuple[int, int]) -> None:
    width, height = size
    browser.ask(
        "Emulation.setDeviceMetricsOverride",
        **{"width": width, "height": height, "deviceScaleFactor": 1, "mobile": False},
    )


def _drawn(browser: Browser, url: str, text: str, size: tuple[int, int]) -> bytes:
    """The page when it shows a text and its scene wholly, without the browser's own notes."""
    _sized(browser, size)
    browser.open(url)
    browser.wait_for_text(text)
    wait_for(lambda: faded_in(browser), 240)
    browser.evaluate(_CLOSE)
    time.sleep(3.0)  # software draws about one frame a second
    return browser.screenshot()


def shot_of_many(picture: Picture, size: tuple[int, int]) -> bytes:
    """The page of many cells with this picture, as PNG of just this size."""
    with Shown(FLEET) as screen, Browser(*size) as browser:
        _sized(browser, size)
        screen.show(picture)
        browser.open(screen.url)
        browser.wait_for_text(picture.facts["cells"][0]["name"])
        return browser.screenshot()


_TERMINAL = """<!doctype html><meta charset="utf-8"><style>{stylesheet}
body {{ margin: 0; padding: 14px; background: #1e1e1e; color: #d8d8d8; }}
pre {{ font: 16px/19px "DejaVu Sans Mono", monospace; margin: 0; }}</style><pre>{code}</pre>"""


def shot_of_terminal(size: tuple[int, int]) -> bytes:
    """The demo in a terminal when a person is near, as PNG."""
    columns, rows = 120, 33
    _, shown = view_after(demo(), 7.0, (columns, rows))
    console = Console(
        file=io.StringIO(), width=columns, height=rows, record=True, force_terminal=True
    )
    console.print(shown)
    text = console.export_html(code_format=_TERMINAL, theme=SVG_EXPORT_THEME)
    with tempfile.TemporaryDirectory() as name, Browser(*size) as browser:
        _sized(browser, size)
        page = Path(name, "terminal.html")
        page.write_text(text, encoding="utf-8")
        browser.open(page.as_uri())
        browser.wait_for_text("STOP")
        return browser.screenshot()


def main() -> None:
    """Make all of them."""
    parser = argparse.ArgumentParser()
    parser.add_argument("folder", type=Path)
    folder = parser.parse_args().folder
    folder.joinpath("demo.png").write_bytes(shot_of_terminal((1180, 640)))
    far, near = pictures([6.0, 6.5], "sinn")
    (walking,) = pictures([6.7], config=with_person(Place(0.0, 0.0)))
    folder.joinpath("try.png").write_bytes(shot(VIEWER, walking, (1400, 900)))
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
