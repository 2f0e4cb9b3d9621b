"""A start may take minutes: that is said, and it can be broken off."""

import contextlib
import logging
import signal
import threading
from collections.abc import Iterator
from types import FrameType

from hri_predict.node.listeners import Listener, Tick

log = logging.getLogger(__name__)

LONG_S = 8.0
"""A start whose loops were compiled before is shorter."""


class SlowStart(Listener):
    """Says once that the start takes long; the first tick ends the start.

    Args:
        after_s: how long a start may take until that is said.
    """

    def __init__(self, after_s: float = LONG_S) -> None:
        self._timer = threading.Timer(after_s, self._say)
        self._timer.daemon = True
        self._timer.start()

    def _say(self) -> None:
        log.warning(
            "still starting: the first start on a machine compiles and converts for up to a "
            "minute; later ones take seconds"
        )

    def on_tick(self, tick: Tick) -> None:
        """The start is over."""
        self.over()

    def over(self) -> None:
        """No more is said."""
        self._timer.cancel()


@contextlib.contextmanager
def ended_by_signals(stop: threading.Event) -> Iterator[None]:
    """Within, what sets ``stop`` by a signal ends the program: a start may take minutes.

    For what comes before the links are opened: no controller has heard of the node yet.

    Raises:
        KeyboardInterrupt, SystemExit: SIGINT, or another signal, asked the node to end.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = {n: signal.getsignal(n) for n in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)}

    def handler(number: int, frame: FrameType | None) -> None:
        inner = before[signal.Signals(number)]
        if callable(inner):
            inner(number, frame)
        if stop.is_set():
            raise KeyboardInterrupt if number == signal.SIGINT else SystemExit(0)

    for number, inner in before.items():
        if callable(inner):
            signal.signal(number, handler)
    try:
        yield
    finally:
        for number, inner in before.items():
            if callable(inner):
                signal.signal(number, inner)
