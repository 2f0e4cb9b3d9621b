"""Hands what is known of all cells to their page: a process of its own that holds up nothing.

A thread asks for the facts five times a second, and at once after ``wake``, and writes them to the
page's pipe. What the page does not take is dropped and counted; changes go again until it has.
"""

import threading
import time
from collections.abc import Callable
from types import TracebackType
from typing import Any

from hri_predict.viewing.picture import Picture, empty_shapes, pack
from hri_predict.viewing.screen import Screen, ScreenSettings, check_port, write_until

FLEET = "hri_predict.viewing.operator.fleet"
PERIOD_S = 0.2
SOONEST_S = 0.05
"""Minimum interval between two pictures, however often ``wake`` is called."""


class FleetFeed:
    """Feeds one page until it is closed; use it as a context manager.

    Args:
        settings: the page's.
        facts: gives what is shown now, with the changes after the one with this number under
            "changes", oldest first.
    """

    def __init__(self, settings: ScreenSettings, facts: Callable[[int], dict[str, Any]]) -> None:
        self._settings = settings
        self._facts = facts
        self._stop, self._wake = threading.Event(), threading.Event()
        self._screen: Screen | None = None
        self._thread = threading.Thread(target=self._feed, name="feed", daemon=True)

    @property
    def dropped(self) -> int:
        """Pictures that the page did not take."""
        return self._screen.dropped if self._screen is not None else 0

    def wake(self) -> None:
        """Show what is known now, soon."""
        self._wake.set()

    def __enter__(self) -> "FleetFeed":
        """Start the page.

        Raises:
            ConfigError: it cannot listen where it should.
        """
        check_port(self._settings)
        self._screen = Screen(self._settings)
        self._thread.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._stop.set()
        self._wake.set()
        self._thread.join(timeout=2.0)
        assert self._screen is not None
        self._screen.end()

    def _feed(self) -> None:
        screen, sent, starts = self._screen, 0, 0
        assert screen is not None
        while not self._stop.is_set():
            now_s = time.monotonic()
            self._wake.clear()
            screen.keep_alive()
            if screen.starts != starts:  # a new page knows no change yet
                sent, starts = 0, screen.starts
            facts = self._facts(sent) | {"made_s": now_s}
            if screen.show(pack(Picture(facts, **empty_shapes()))) and facts["changes"]:
                sent = facts["changes"][-1]["number"]
            write_until([screen], now_s + SOONEST_S, self._stop)
            write_until([screen], now_s + PERIOD_S, self._wake)
