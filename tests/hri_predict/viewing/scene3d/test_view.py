"""``hri-predict view FILE`` in a real browser: its timeline, its slider, its buttons and keys."""

import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from hri_predict.run.session import Options, run
from hri_predict.viewing.levels import COLOURS, css
from hri_predict.viewing.recorded import RecordedPictures
from tests.browser import CHROMIUM, Browser, wait_for
from tests.hri_predict.viewing.staged import cell

pytest.importorskip("viser", reason="the extra viewer is not installed")

TIMELINE = "document.querySelector('.levels')"
TRACK = "document.querySelectorAll('.mantine-Slider-track')[1]"


@pytest.fixture
def viewed(tmp_path) -> Iterator[tuple[Path, str]]:
    """A recording of the demo's cell, and where it is shown."""
    path = tmp_path / "cell.mcap"
    run(cell(tmp_path).quiet(), Options(factor=None, duration_s=9.0, record=path))
    command = [sys.executable, "-m", "hri_predict", "view", str(path)]
    process = subprocess.Popen(command, stderr=subprocess.PIPE, text=True)
    assert process.stderr is not None
    try:
        line = next(line for line in process.stderr if line.startswith("view: "))
        yield path, line.removeprefix("view: ").strip()
    finally:
        process.kill()
        process.wait()
        process.stderr.close()


@pytest.mark.long
@pytest.mark.realtime
@pytest.mark.timeout(300)
@pytest.mark.skipif(CHROMIUM is None, reason="chromium is not installed")
def test_the_timeline_the_slider_buttons_and_keys_go_through_a_recording(viewed):
    path, url = viewed
    recorded = RecordedPictures(path)
    with Browser(900, 800) as browser:
        browser.open(url)
        browser.wait_for_text("arm: ")
        bar = browser.evaluate(f"{TIMELINE}.style.background")
        for level in {level for _, level in recorded.changes}:
            assert css(COLOURS[level]).replace(",", ", ") in bar
        left, top, right, bottom = browser.box(TRACK)
        strip = browser.box(TIMELINE)
        assert (strip[0], strip[2]) == pytest.approx((left, right), abs=4)  # pixels
        assert strip[3] <= top + 4

        bars = "[...document.querySelectorAll('.mantine-ScrollArea-scrollbar')]"
        bar_left = browser.box(f"{bars}.find(e => e.offsetHeight > 100)")[0]
        last = "[...document.querySelectorAll('button')].find(b => b.innerText === 'level >')"
        assert browser.box(last)[2] <= bar_left  # it lies beside what it scrolls

        for share in (0.9, 0.3):  # a click on the slider: the level is that of the bar above
            browser.click(left + share * (right - left), 0.5 * (top + bottom))
            level = recorded.level_at(recorded.start_ns + round(share * recorded.duration_s * 1e9))
            browser.wait_for_text(f"arm: {level}", 20)

        def position_s() -> float:
            inputs = "[...document.querySelectorAll('input')].map(e => e.value)"
            return float(browser.evaluate(f"{inputs}.filter(v => v !== '' && !isNaN(v))[2]"))

        before = position_s()
        changes = [(ns - recorded.start_ns) * 1e-9 for ns, _ in recorded.changes]
        after = next(change for change in changes if change > before)
        browser.press("N")
        wait_for(lambda: position_s() == pytest.approx(after, abs=0.06), 10)
        buttons = "[...document.querySelectorAll('button')]"
        browser.evaluate(f"{buttons}.find(b => b.innerText === 'step >').click()")
        wait_for(lambda: after < position_s() <= after + 0.26, 10)
        browser.press("P")
        wait_for(lambda: position_s() == pytest.approx(after, abs=0.06), 10)
        browser.press("K")  # play
        wait_for(lambda: position_s() > after + 1.0, 20)
        browser.press("K")

        def stands() -> bool:
            then = position_s()
            time.sleep(1.0)
            return position_s() == then

        wait_for(stands, 20)  # a busy page shows for a while where it was before the key
        assert browser.console == []
