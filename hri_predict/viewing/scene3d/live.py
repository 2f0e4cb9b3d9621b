"""The process of the live 3D view, which reads pictures from standard input.

It exits when they end. Run by ``feed``: ``python -m hri_predict.viewing.scene3d.live``.
"""

import argparse
import math
import os
import signal
import sys
import threading
import time
from collections import deque

from hri_predict.viewing.levels import worst
from hri_predict.viewing.picture import Picture, read
from hri_predict.viewing.scene3d.panel import BEAT_S, STRIP_PARTS, details, head, strip
from hri_predict.viewing.scene3d.server import MAX_AHEAD_S, add_legend, address, bounded, serve
from hri_predict.viewing.scene3d.stage import Stage

KEPT_S = 60.0
DRAWN_HZ = 15.0
SILENT_S = 1.0
"""Maximum age of the picture; after that, the view is grey."""
NOW_S = 0.7
"""Slider positions closer to the end than this count as live: one pixel is a third of a second,
so a click at the end may land one short.
"""
FAREWELL_S = 1.0
"""Time after the end in which browsers can load the last, grey picture."""


class Kept:
    """The pictures of the last minute, with arrival times."""

    def __init__(self) -> None:
        self._kept: deque[tuple[float, Picture]] = deque()
        self._lock = threading.Lock()
        self.ended = False

    def add(self, picture: Picture, now_s: float) -> None:
        """Store a picture, and drop those that are too old."""
        with self._lock:
            self._kept.append((now_s, picture))
            while now_s - self._kept[0][0] > KEPT_S:
                self._kept.popleft()

    def newest(self) -> tuple[float, Picture] | None:
        """Return the newest picture and its arrival time."""
        with self._lock:
            return self._kept[-1] if self._kept else None

    def copy(self) -> "Kept":
        """Return a copy of the history, from which no picture is dropped."""
        other = Kept()
        with self._lock:
            other._kept = self._kept.copy()
        return other

    def at(self, then_s: float) -> tuple[float, Picture] | None:
        """Return the newest picture that had arrived by that time, otherwise the oldest."""
        with self._lock:
            before = [each for each in self._kept if each[0] <= then_s]
            return before[-1] if before else self._kept[0] if self._kept else None

    def levels(self, now_s: float) -> list[str]:
        """Return the worst level in each part of the last minute; "" where nothing was known.

        A level holds until the next picture, or until the node has been silent for too long.
        """
        parts: list[list[str]] = [[] for _ in range(STRIP_PARTS)]
        with self._lock:
            kept = list(self._kept)
        ends = [*(then_s for then_s, _ in kept[1:]), now_s]
        for (then_s, picture), end_s in zip(kept, ends, strict=True):
            level = worst(robot["level"] for robot in picture.facts["robots"])
            first = _part(now_s - then_s)
            last = _part(now_s - min(end_s, then_s + SILENT_S))
            for part in range(max(0, first), last + 1):
                parts[part].append(level)
        return [worst(levels) if levels else "" for levels in parts]


def _part(ago_s: float) -> int:
    """Return the index of the part of the last minute this long ago; negative: too long ago."""
    return min(math.floor((1.0 - ago_s / KEPT_S) * STRIP_PARTS), STRIP_PARTS - 1)


class LiveView:
    """Browser view of the stored pictures."""

    def __init__(self, host: str, port: int, kept: Kept) -> None:
        self._kept = kept
        self.server = serve(host, port)
        self._stage = Stage(self.server)
        gui = self.server.gui
        self._head = gui.add_html("waiting for the node's first tick")
        self._ahead = gui.add_slider("zones ahead (s)", 0.0, MAX_AHEAD_S, 0.05, 0.5)
        self._strip = gui.add_html("")
        self._back = gui.add_slider("seconds back", -KEPT_S, 0.0, 0.1, 0.0)
        self._pause = gui.add_checkbox("pause", False)
        self._details = gui.add_html("")
        add_legend(gui)
        self._held: tuple[float, Kept] | None = None
        self._strip_s = 0.0
        self._shown: object = None

    def draw(self, now_s: float) -> None:
        """Draw the picture due at ``now_s``, if it is not already shown."""
        newest = self._kept.newest()
        if newest is None:
            return
        paused, back_s = self._pause.value, bounded(self._back.value, -KEPT_S, 0.0)
        ahead_s = bounded(self._ahead.value, 0.0, MAX_AHEAD_S)
        self._held = (self._held or (now_s, self._kept.copy())) if paused else None
        base_s, kept = self._held or (now_s, self._kept)
        is_now = not paused and back_s > -NOW_S
        found = newest if is_now else kept.at(base_s + back_s)
        assert found is not None
        stale = self._stale(now_s, newest[0], None if is_now else found[0])
        if now_s - self._strip_s > 0.5:
            self._strip_s = now_s
            self._strip.content = strip(kept.levels(base_s))
        horizon_s = max(found[1].facts["times_s"], default=0.0)
        if horizon_s > 0 and abs(self._ahead.max - horizon_s) > 0.01:
            self._ahead.value = ahead_s = min(ahead_s, horizon_s)  # type: ignore[misc]
            self._ahead.max = round(horizon_s, 2)
        beat = int(now_s / BEAT_S)
        shown = (found[0], stale, ahead_s, "" if stale else beat)
        if shown == self._shown:
            return
        self._shown = shown
        picture = found[1]
        self._head.content = head(picture.facts, stale=stale, beat=beat)
        self._details.content = details(picture.facts)
        self._stage.draw(picture, ahead_s, known=not stale or not is_now)

    def _stale(self, now_s: float, newest_s: float, shown_s: float | None) -> str:
        """Return why the picture is not current; "" if it is."""
        if self._kept.ended:
            return "the node exited"
        if now_s - newest_s > SILENT_S:
            return f"nothing from the node for {now_s - newest_s:.0f} s"
        if shown_s is not None:
            return f"{now_s - shown_s:.1f} s ago"
        return ""


def _take(kept: Kept) -> None:
    try:
        while (picture := read(sys.stdin.buffer)) is not None:
            now_s = time.monotonic()  # one that waited in the pipe is as old as it is
            kept.add(picture, min(now_s, picture.facts.get("made_s", now_s)))
    except (ValueError, TypeError) as error:
        print(f"the view exits: {error}", file=sys.stderr)
    kept.ended = True


def main() -> None:
    """Show pictures until their pipe ends."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--host", required=True)
    parser.add_argument("--port", type=int, required=True)
    args = parser.parse_args()
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the node gets it too; its end is our end
    os.nice(10)  # the node goes first
    kept = Kept()
    threading.Thread(target=_take, args=(kept,), name="pictures", daemon=True).start()
    view = LiveView(args.host, args.port, kept)
    print(address(view.server), flush=True)
    try:
        while not kept.ended:
            view.draw(time.monotonic())
            time.sleep(1.0 / DRAWN_HZ)
        view.draw(time.monotonic())
    except Exception as error:  # rather no view than one that stands still
        print(f"the view exits: {type(error).__name__}: {error}", file=sys.stderr, flush=True)
        os._exit(1)
    time.sleep(FAREWELL_S)
    os._exit(0)  # viser's threads may wait for browsers


if __name__ == "__main__":
    main()
