"""Starting a node: it may take minutes and can be interrupted, and links start independently.

The state file, with which the node restores the state of an earlier run, is also found here.
"""

import contextlib
import hashlib
import json
import logging
import queue
import signal
import sys
import threading
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from types import FrameType
from typing import Any, Self

from hri_predict.base.errors import LinkError, LinkErrors, failure
from hri_predict.base.machine.compiled import why_not_kept
from hri_predict.contracts.link import Link
from hri_predict.contracts.source import SourceSettings
from hri_predict.node.listeners import Listener, Tick
from hri_predict.node.memory import Memory, StateSettings
from hri_predict.node.node import Node
from hri_predict.protocol.reasons import Reason
from hri_predict.run.config import Config

log = logging.getLogger(__name__)

LONG_S = 8.0
"""A start with already compiled loops takes less than this."""

OPEN_LIMIT_S = 60.0
"""Maximum time for a link to start; the links of ``hri_drivers`` fail much sooner, with the reason.
"""
OTHERS_S = 5.0
"""Maximum time for the next link to start or fail once one has failed: all that are absent are
reported together.
"""


class SlowStart(Listener):
    """Logs once that the start takes long; the first tick, or the end of a ``with`` block, ends it.

    Args:
        after_s: duration of a start after which it is reported.
    """

    def __init__(self, after_s: float = LONG_S) -> None:
        self._timer = threading.Timer(after_s, self._say)
        self._timer.daemon = True
        self._timer.start()

    def _say(self) -> None:
        if why := why_not_kept():
            log.warning("still starting: every start takes this long, because %s", why)
            return
        log.warning(
            "still starting: the first start after an installation or an update compiles and "
            "converts for up to a minute; other starts take seconds, more on a busy machine"
        )

    def on_tick(self, tick: Tick) -> None:
        """Mark the start as finished."""
        self.over()

    def over(self) -> None:
        """Stop without logging."""
        self._timer.cancel()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.over()


@contextlib.contextmanager
def ended_by_signals(stop: threading.Event) -> Iterator[None]:
    """In this context, a signal that would set ``stop`` exits the program, because a start may take
    minutes.

    Use it only before the links are opened, while no controller has received any message from the
    node.

    Raises:
        KeyboardInterrupt, SystemExit: SIGINT, or another signal, requested the exit.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = {n: signal.getsignal(n) for n in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)}

    asked: list[BaseException] = []

    def handler(number: int, frame: FrameType | None) -> None:
        inner = before[signal.Signals(number)]
        if callable(inner):
            inner(number, frame)
        if stop.is_set():
            asked.append(KeyboardInterrupt() if number == signal.SIGINT else SystemExit(0))
            raise asked[-1]

    for number, inner in before.items():
        if callable(inner):
            signal.signal(number, handler)
    swallowed = sys.unraisablehook
    sys.unraisablehook = lambda what: what.exc_value in asked or swallowed(what)
    try:
        yield
    except Exception:  # of a part whose start was ended
        if not asked:
            raise
    finally:
        sys.unraisablehook = swallowed
        for number, inner in before.items():
            if callable(inner):
                signal.signal(number, inner)
    if asked:  # callbacks of the compiler and parts of third parties swallow what is raised in them
        raise asked[-1]


class Starting:
    """Starts all links at the same time, each in its own thread.

    Attributes:
        started: the links that have started, in the configuration's order.
    """

    def __init__(self, links: Sequence[Link]) -> None:
        self._links = links
        self._started: list[Link] = []
        self._ended: queue.SimpleQueue[tuple[Link, Exception | None]] = queue.SimpleQueue()
        self._lock = threading.Lock()
        self._given_up = False

    @property
    def started(self) -> list[Link]:
        """See the class."""
        return [link for link in self._links if link in self._started]

    def start(self) -> None:
        """Start all links and wait for them; if some fail, stop the others.

        Raises:
            LinkError: devices of links are absent or do not open; each has its line.
        """
        for link in self._links:
            threading.Thread(
                target=self._start, args=(link,), name=f"{link.name}-start", daemon=True
            ).start()
        try:
            failed = self._wait()
            errors = [failed[link.name] for link in self._links if link.name in failed]
            if errors:
                absent = [error for error in errors if isinstance(error, LinkError)]
                if len(absent) == len(errors) > 1:
                    raise LinkErrors(absent)
                raise next((e for e in errors if not isinstance(e, LinkError)), errors[0])
        except BaseException:  # nothing was sent yet, and silence means stop
            with self._lock:
                self._given_up = True
            for link in self.started:
                link.stop()
            raise

    def _wait(self) -> dict[str, Exception]:
        """Wait for all links, but not long for the others once one has failed.

        Returns:
            Name of a link that failed -> why.

        Raises:
            LinkError: a link does not open.
        """
        failed: dict[str, Exception] = {}
        for _ in self._links:
            try:
                link, error = self._ended.get(timeout=OTHERS_S if failed else OPEN_LIMIT_S)
            except queue.Empty:
                if failed:
                    break
                late = [link.name for link in self._links if link not in self._started]
                raise LinkError(
                    f"link '{late[0]}': does not open within {OPEN_LIMIT_S:g} s; check its device"
                ) from None
            if error is not None:
                failed[link.name] = error
        return failed

    def _start(self, link: Link) -> None:
        try:
            link.start()
        except BaseException as error:
            self._ended.put((link, failure(error)))
            return
        with self._lock:
            self._started.append(link)
            late = self._given_up
        if late:
            link.stop()
        self._ended.put((link, None))


def memory_of(
    config: Config, node: Node, *, instead: Path | None, keep: bool, threaded: bool
) -> Memory | None:
    """Return the state file of ``node``, not yet open; ``None`` if this run has none.

    Args:
        config: its ``state`` is used if ``keep`` is set.
        node: reports in Status that the file cannot be written, while this is so.
        instead: file to use instead of the configured one.
        keep: use the configured file, if one is configured.
        threaded: see ``Memory``.
    """
    settings = config.node.state if keep else None
    if instead is not None:
        settings = StateSettings(path=str(instead.absolute()))
    if settings is None:
        return None
    memory = Memory(
        settings, config.base_dir, node.remembering, cell=cell_of(config), threaded=threaded
    )
    node.conditions = lambda: (Reason.STATE_UNTRUSTED,) if memory.failing else ()
    return memory


def cell_of(config: Config) -> str:
    """Return the identity of this cell: its configuration's path, and the positions of its parts.

    If a robot or the source has been moved, the stored positions of lost people are no longer
    valid.
    """
    node = config.node
    robots = [
        (robot.name, robot.model_dump(mode="json", include={"model", "room_from_robot"}))
        for robot in node.robots
    ]
    source = _posed(config.source)
    told = [str(config.path.absolute()), source, robots]
    parts: Mapping[str, SourceSettings] = getattr(config.source, "parts", {})
    if parts:  # the sensors of a merged source
        told.append({name: _posed(part) for name, part in parts.items()})
    return hashlib.sha256(json.dumps(told, sort_keys=True).encode()).hexdigest()[:16]


def _posed(source: SourceSettings) -> dict[str, Any]:
    return source.model_dump(mode="json", include={"kind", "room_from_source"})
