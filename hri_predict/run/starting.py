"""The start: it may take minutes and can be broken off, and it recalls what an earlier run left."""

import contextlib
import hashlib
import json
import logging
import signal
import threading
from collections.abc import Iterator
from pathlib import Path
from types import FrameType

from hri_predict.node.listeners import Listener, Tick
from hri_predict.node.memory import Memory, StateSettings
from hri_predict.node.node import Node
from hri_predict.protocol.reasons import Reason
from hri_predict.run.config import Config

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


def memory_of(
    config: Config, node: Node, *, instead: Path | None, keep: bool, threaded: bool
) -> Memory | None:
    """The state file of ``node``, not yet open; ``None`` if this run has none.

    Args:
        config: its ``state`` is used if ``keep`` is set.
        node: it says so in Status while the file cannot be written.
        instead: use this file.
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
    """What tells this cell from others: its configuration's path, and where its parts are.

    Where a robot or the source has been moved, the places of lost people mean others.
    """
    node = config.node
    robots = [
        (robot.name, robot.model_dump(mode="json", include={"model", "room_from_robot"}))
        for robot in node.robots
    ]
    source = config.source.model_dump(mode="json", include={"kind", "room_from_source"})
    told = [str(config.path.absolute()), source, robots]
    return hashlib.sha256(json.dumps(told, sort_keys=True).encode()).hexdigest()[:16]
