"""Plays a recording in the 3D view: a timeline of levels, play, pause, speed."""

import time
from collections import deque
from collections.abc import Callable
from functools import partial
from typing import Any

from hri_predict.base.errors import RecordingError
from hri_predict.viewing.picture import Picture
from hri_predict.viewing.recorded import RecordedPictures
from hri_predict.viewing.scene3d.panel import STRIP_PARTS, details, head, note, strip
from hri_predict.viewing.scene3d.server import MAX_AHEAD_S, add_legend, address, bounded, serve
from hri_predict.viewing.scene3d.stage import Stage

DRAWN_HZ = 10.0
PLAY = "play or stop"
_STEPS = {
    "< level": (RecordedPictures.change_beside, -1),
    "< step": (RecordedPictures.picture_beside, -1),
    "step >": (RecordedPictures.picture_beside, 1),
    "level >": (RecordedPictures.change_beside, 1),
}
_KEYS: tuple[tuple[Any, str], ...] = (
    ("P", "< level"),
    ("J", "< step"),
    ("K", PLAY),
    ("L", "step >"),
    ("N", "level >"),
)
NOTHING = "no picture was recorded here; with view_hz: 0 there are none"
SPEEDS = ("0.25", "0.5", "1", "2", "5", "20")


class Playback:
    """A recording in a browser, playing or paused at a position."""

    def __init__(self, recorded: RecordedPictures, host: str, port: int) -> None:
        self._recorded = recorded
        self.server = serve(host, port)
        self._stage = Stage(self.server)
        gui = self.server.gui
        self._head = gui.add_html("")
        self._end_s = max(0.1, round(recorded.duration_s, 1))
        self._ahead = gui.add_slider("zones ahead (s)", 0.0, MAX_AHEAD_S, 0.05, 0.5)
        gui.add_html(strip(recorded.levels(STRIP_PARTS)))
        self._at = gui.add_slider("seconds", 0.0, self._end_s, 0.1, 0.0)
        self._play = gui.add_checkbox("play", False)
        self._speed = gui.add_dropdown("speed", SPEEDS, initial_value="1")
        self._asked: deque[str] = deque(maxlen=20)
        self._buttons = gui.add_button_group("go to", tuple(_STEPS))
        self._buttons.on_click(lambda _: self._asked.append(self._buttons.value))
        for key, what in _KEYS:
            gui.add_command(what, hotkey=key).on_trigger(partial(self._ask, what))
        self._details = gui.add_html("")
        add_legend(gui)
        self._position_s = (recorded.opening_ns() - recorded.start_ns) * 1e-9
        self._set_s, self._last_s = 0.0, 0.0
        self._shown: object = None
        self._last: Picture | None = None

    @property
    def url(self) -> str:
        """Address for a browser."""
        return address(self.server)

    def go(self, position_s: float, *, play: bool = False) -> None:
        """Go to a position, seconds from the start."""
        self._position_s = min(max(position_s, 0.0), self._recorded.duration_s)
        self._play.value = play  # type: ignore[misc]

    def draw(self, now_s: float) -> None:
        """Advance by the time since the last call, and draw."""
        since_s, self._last_s = now_s - self._last_s, now_s
        asked_s = bounded(self._at.value, 0.0, self._end_s)
        if abs(asked_s - self._set_s) > 0.01:  # somebody moved it
            self._position_s = asked_s
        elif self._play.value:
            self._position_s += min(since_s, 1.0) * _factor(self._speed.value)
            if self._position_s >= self._recorded.duration_s:
                self._position_s = self._recorded.duration_s
                self._play.value = False  # type: ignore[misc]
        while self._asked:
            self._do(self._asked.popleft())
        self._set_s = round(min(self._position_s, self._end_s), 1)
        if abs(self._at.value - self._set_s) > 0.01:
            self._at.value = self._set_s  # type: ignore[misc]
        self._show(self._recorded.start_ns + round(self._position_s * 1e9))

    def _ask(self, what: str, _: Any) -> None:
        self._asked.append(what)

    def _do(self, what: str) -> None:
        """Do what a button or a key requests."""
        if what == PLAY:
            self._play.value = not self._play.value  # type: ignore[misc]
            return
        if what not in _STEPS:
            return
        find, by = _STEPS[what]
        ns = find(self._recorded, self._recorded.start_ns + round(self._position_s * 1e9), by)
        self.go((ns - self._recorded.start_ns) * 1e-9)

    def _show(self, ns: int) -> None:
        why = NOTHING
        try:
            picture = self._recorded.at(ns)
        except RecordingError as error:
            picture, why = None, str(error)
        if picture is None:
            self._show_nothing(why)
            return
        ahead_s = self._limited(picture)
        shown = (picture, ahead_s)
        if shown == self._shown:
            return
        self._shown, self._last = shown, picture
        when = picture.facts["utc"] if self._recorded.info.has_utc else "without UTC"
        self._head.content = head(picture.facts, when=when)
        self._details.content = details(picture.facts)
        self._stage.draw(picture, ahead_s)

    def _show_nothing(self, why: str) -> None:
        """Show why there is no picture, and grey out the last one."""
        if self._shown == why:
            return
        self._shown = why
        self._head.content, self._details.content = note(why), ""
        if self._last is not None:
            self._stage.draw(self._last, 0.0, known=False)

    def _limited(self, picture: Picture) -> float:
        """Return the time ahead of the drawn zones; the slider ends where the horizon does."""
        ahead_s = bounded(self._ahead.value, 0.0, MAX_AHEAD_S)
        horizon_s = max(picture.facts["times_s"], default=0.0)
        if horizon_s > 0 and abs(self._ahead.max - horizon_s) > 0.01:
            self._ahead.value = ahead_s = min(ahead_s, horizon_s)  # type: ignore[misc]
            self._ahead.max = round(horizon_s, 2)
        return ahead_s


def _factor(speed: str) -> float:
    """Return a speed from the list; any client of the port can send any text."""
    return float(speed) if speed in SPEEDS else 1.0


def play(recorded: RecordedPictures, host: str, port: int, told: Callable[[str], None]) -> None:
    """Show a recording until the user interrupts it; call ``told`` with the address."""
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
