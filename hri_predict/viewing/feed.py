"""Passes the newest tick to screens: separate processes that never delay the node.

The loop's thread only stores the tick. A thread packs the newest one at most ``PICTURES_HZ`` times
a second and writes as much of it to each screen's pipe as fits (``screen``).
"""

import importlib.util
import logging
import threading
import time
from collections import deque
from collections.abc import Callable, Sequence
from functools import partial
from types import TracebackType
from typing import Any

from hri_predict.base.errors import ConfigError
from hri_predict.node.listeners import Tick
from hri_predict.protocol.messages import Level
from hri_predict.run.assemble import Assembly
from hri_predict.run.coverage import zones_text
from hri_predict.run.session import View
from hri_predict.viewing.packing import picture_of, said_of
from hri_predict.viewing.picture import pack
from hri_predict.viewing.screen import Screen, ScreenSettings, check_port, write_until

log = logging.getLogger(__name__)

PICTURES_HZ = 15.0
CHANGES = 64
"""Number of level changes sent with each picture, so that none between two pictures is missed."""
VIEWER = "hri_predict.viewing.scene3d.live"
OPERATOR = "hri_predict.viewing.operator.page"


def has_viser() -> bool:
    """Return whether the 3D view's library is installed, without importing it."""
    return importlib.util.find_spec("viser") is not None


def check_viser() -> None:
    """Raise a ``ConfigError`` unless the 3D view's library is installed."""
    if not has_viser():
        raise ConfigError(
            "the 3D view needs viser; install it with: pip install 'hri-predict[viewer]'"
        )


class Feed(View):
    """Feeds screens with the newest tick until it is closed; use it as a context manager.

    Args:
        settings: the screens.
        opened: called with a screen's address when it listens for the first time.

    Attributes:
        addresses: addresses of the listening screens, by name.
        dropped: number of pictures that could not be created, or that a screen missed; each counts
            once, however many screens missed it.
    """

    def __init__(
        self, settings: Sequence[ScreenSettings], opened: Callable[[str], None] | None = None
    ) -> None:
        self._settings = tuple(settings)
        self._opened = opened
        self.screens: list[Screen] = []
        self.addresses: dict[str, str] = {}
        self._assembly: Assembly | None = None
        self._coverage = ""
        self._band_m: float | None = None
        self._newest: Tick | None = None
        self._ticks = 0
        self._levels: dict[int, Level] = {}
        self._changes: deque[dict[str, Any]] = deque(maxlen=CHANGES)
        self._changed = 0
        self.dropped = 0
        self._is_failing = False
        self._rated = (0, 0, 0.0)  # ticks, node time, rate
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._feed, name="feed", daemon=True)

    def bind(self, assembly: Assembly) -> None:
        """Accept the assembly whose ticks are shown."""
        self._coverage = zones_text(assembly.config)
        self._band_m = assembly.config.node.risk.band_m
        self._assembly = assembly

    def on_tick(self, tick: Tick) -> None:
        """Store the newest tick, and level changes."""
        self._ticks += 1
        for advice in tick.advices:
            if self._levels.get(advice.robot) is not advice.level:
                self._levels[advice.robot] = advice.level
                self._changed += 1
                self._changes.append(
                    {
                        "number": self._changed,
                        "utc_s": time.time(),
                        "robot": advice.robot,
                        **said_of(advice, self._band_m),
                    }
                )
        self._newest = tick

    def __enter__(self) -> "Feed":
        """Start the screens.

        Raises:
            ConfigError: a screen cannot listen on its address.
        """
        for settings in self._settings:
            check_port(settings)
        ports = [settings.port for settings in self._settings if settings.port]
        if len(set(ports)) < len(ports):
            raise ConfigError(f"--viewer, --operator {ports[0]}: give each its own port")
        self.screens = [Screen(each, partial(self._heard, each.name)) for each in self._settings]
        self._thread.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._stop.set()
        self._thread.join(timeout=2.0)
        for screen in self.screens:
            screen.end()

    def _heard(self, name: str, url: str) -> None:
        if name not in self.addresses and self._opened is not None:
            self._opened(url)
        self.addresses[name] = url

    def _feed(self) -> None:
        shown: Tick | None = None
        next_s = time.monotonic()
        while not self._stop.is_set():
            write_until(self.screens, next_s, self._stop)
            next_s = max(next_s + 1.0 / PICTURES_HZ, time.monotonic())
            tick = self._newest
            if tick is None or tick is shown or self._assembly is None:
                continue
            shown = tick
            try:
                packed = self._pack(tick, self._assembly)
            except Exception:
                self.dropped += 1
                if not self._is_failing:
                    self._is_failing = True
                    log.exception(
                        "a picture could not be created; further failures are only counted"
                    )
                continue
            missed = 0
            for screen in self.screens:
                screen.keep_alive()
                missed += not screen.show(packed)
            self.dropped += missed > 0

    def _pack(self, tick: Tick, assembly: Assembly) -> bytes:
        picture = picture_of(tick, assembly)
        ticks, then_ns, rate_hz = self._rated
        if tick.now_ns - then_ns > 1_000_000_000:
            rate_hz = (self._ticks - ticks) / ((tick.now_ns - then_ns) * 1e-9) if then_ns else 0.0
            self._rated = (self._ticks, tick.now_ns, rate_hz)
        picture.facts.update(
            utc_s=time.time(),
            made_s=time.monotonic(),
            rate_hz=rate_hz or None,
            coverage=self._coverage,
            dropped=self.dropped,
            changes=list(self._changes.copy()),
        )
        return pack(picture)
