"""Passes the state of all cells to their page, a separate process that delays nothing.

A thread requests the facts five times a second, and immediately after ``wake``, and writes them to
the page's pipe. Pictures that the page does not accept are dropped and counted; changes are resent
until it has them.
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
        settings: settings of the page.
        facts: returns the facts to show, with the changes after this number under "changes", oldest
            first.
    """

    def __init__(self, settings: ScreenSettings, facts: Callable[[int], dict[str, Any]]) -> None:
        self._settings = settings
        self._facts = facts
        self._stop, self._wake = threading.Event(), threading.Event()
        self._screen: Screen | None = None
        self._thread = threading.Thread(target=self._feed, name="feed", daemon=True)

    @property
    def dropped(self) -> int:
        """Number of pictures that the page did not accept."""
        return self._screen.dropped if self._screen is not None else 0

    def wake(self) -> None:
        """Show the current state soon."""
        self._wake.set()

    def __enter__(self) -> "FleetFeed":
        """Start the page.

        Raises:
            ConfigError: it cannot listen on its address.
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
