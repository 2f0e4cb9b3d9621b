"""Plays a recording in the 3D view: a timeline of levels, play, pause, speed."""

import time
from collections.abc import Callable

from hri_predict.viewing.recorded import RecordedPictures
from hri_predict.viewing.scene3d.panel import STRIP_PARTS, page, strip
from hri_predict.viewing.scene3d.server import address, serve
from hri_predict.viewing.scene3d.stage import Stage

DRAWN_HZ = 10.0
SPEEDS = ("0.25", "0.5", "1", "2", "5", "20")


class Playback:
    """A recording in a browser, at a position that plays on or stands."""

    def __init__(self, recorded: RecordedPictures, host: str, port: int) -> None:
        self._recorded = recorded
        self.server = serve(host, port)
        self._stage = Stage(self.server)
        gui = self.server.gui
        self._page = gui.add_html("")
        self._end_s = max(0.1, round(recorded.duration_s, 1))
        self._at = gui.add_slider("seconds", 0.0, self._end_s, 0.1, 0.0)
        gui.add_html(strip(recorded.levels(STRIP_PARTS)))
        self._play = gui.add_checkbox("play", False)
        self._speed = gui.add_dropdown("speed", SPEEDS, initial_value="1")
        self._ahead = gui.add_slider("zones ahead (s)", 0.0, 3.0, 0.05, 0.5)
        self._position_s, self._set_s, self._last_s = 0.0, 0.0, 0.0
        self._shown: object = None

    @property
    def url(self) -> str:
        """Where a browser finds it."""
        return address(self.server)

    def go(self, position_s: float, *, play: bool = False) -> None:
        """Go to a position, seconds from the start."""
        self._position_s = min(max(position_s, 0.0), self._recorded.duration_s)
        self._play.value = play  # type: ignore[misc]

    def draw(self, now_s: float) -> None:
        """Move on by the time since the last call, and draw."""
        since_s, self._last_s = now_s - self._last_s, now_s
        if abs(self._at.value - self._set_s) > 0.01:  # somebody moved it
            self._position_s = self._at.value
        elif self._play.value:
            self._position_s += min(since_s, 1.0) * float(self._speed.value)
            if self._position_s >= self._recorded.duration_s:
                self._position_s = self._recorded.duration_s
                self._play.value = False  # type: ignore[misc]
        self._set_s = round(min(self._position_s, self._end_s), 1)
        if abs(self._at.value - self._set_s) > 0.01:
            self._at.value = self._set_s  # type: ignore[misc]
        self._show(self._recorded.start_ns + round(self._position_s * 1e9))

    def _show(self, ns: int) -> None:
        picture = self._recorded.at(ns)
        if picture is None:
            self._page.content = "nothing was recorded here"
            return
        shown = (picture, self._ahead.value)
        if shown == self._shown:
            return
        self._shown = shown
        when = picture.facts["utc"] if self._recorded.info.has_utc else ""
        self._page.content = page(picture.facts, when=when)
        self._stage.draw(picture, self._ahead.value)


def play(recorded: RecordedPictures, host: str, port: int, told: Callable[[str], None]) -> None:
    """Show a recording until the user interrupts it; ``told`` is given the address."""
    shown = Playback(recorded, host, port)
    told(shown.url)
    try:
        while True:
            shown.draw(time.monotonic())
            time.sleep(1.0 / DRAWN_HZ)
    except KeyboardInterrupt:
        pass
    finally:
        shown.server.stop()
