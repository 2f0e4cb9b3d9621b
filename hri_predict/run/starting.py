"""A start can be broken off: it may take minutes, and no controller has heard of the node yet."""

import contextlib
import signal
import threading
from collections.abc import Iterator
from types import FrameType


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
