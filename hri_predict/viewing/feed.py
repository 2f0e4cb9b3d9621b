"""Hands the newest tick to screens: processes of their own that never hold up the node.

The loop's thread only stores the tick. A thread packs the newest one at most ``PICTURES_HZ`` times
a second and writes it to each screen's pipe, as much as the pipe takes. While a screen does not
read, what was begun waits and what comes meanwhile is dropped and counted. A screen ends when its
pipe does: with the node, however the node ends.
"""

import contextlib
import importlib.util
import logging
import os
import select
import socket
import subprocess
import sys
import threading
import time
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from types import TracebackType
from typing import Any

from hri_predict.errors import ConfigError
from hri_predict.node.listeners import Tick
from hri_predict.protocol.messages import Level
from hri_predict.run.assemble import Assembly
from hri_predict.run.coverage import zones_text
from hri_predict.run.session import View
from hri_predict.viewing.packing import picture_of
from hri_predict.viewing.picture import pack

log = logging.getLogger(__name__)

PICTURES_HZ = 15.0
CHANGES = 64
"""So many changes of level go with each picture: one that came between two pictures is in it."""
END_S = 3.0
"""A screen that has not ended so long after its pipe is killed."""
LOOPBACK = "127.0.0.1"


@dataclass(frozen=True, slots=True)
class ScreenSettings:
    """A process that shows pictures.

    Attributes:
        name: as people call it.
        module: what runs, as ``python -m``; it takes ``--host`` and ``--port``.
        port: 0: any free one.
        host: the address that it listens on.
    """

    name: str
    module: str
    port: int
    host: str = LOOPBACK


VIEWER = "hri_predict.viewing.scene3d.live"
OPERATOR = "hri_predict.viewing.operator.page"


def check_viser() -> None:
    """Raise a ``ConfigError`` unless the 3D view's library is installed; it is not imported."""
    if importlib.util.find_spec("viser") is None:
        raise ConfigError("the 3D view needs viser: pip install 'hri-predict[viewer]'")


def check_port(settings: ScreenSettings) -> None:
    """Raise a ``ConfigError`` if a screen cannot listen where it should."""
    if not 0 <= settings.port <= 65535:
        raise ConfigError(f"--{settings.name} {settings.port}: give a port from 0 to 65535")
    family = socket.AF_INET6 if ":" in settings.host else socket.AF_INET
    with socket.socket(family) as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind((settings.host, settings.port))
        except OSError as error:
            raise ConfigError(
                f"--{settings.name} {settings.port}: cannot listen on {settings.host}: "
                f"{error.strerror or error}; name another port, or 0 for any free one"
            ) from error


class Screen:
    """One screen's process and its pipe. Used by one thread, except ``dropped``.

    Attributes:
        dropped: pictures that it was too slow for, or that came after its end.
    """

    def __init__(self, settings: ScreenSettings) -> None:
        self.settings = settings
        self.dropped = 0
        self._rest = memoryview(b"")
        command = [sys.executable, "-m", settings.module]
        command += ["--host", settings.host, "--port", str(settings.port)]
        self.process = subprocess.Popen(
            command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, close_fds=True
        )
        assert self.process.stdin is not None
        self._pipe = self.process.stdin.fileno()
        os.set_blocking(self._pipe, False)
        self._open = True
        threading.Thread(target=self._tell, name=settings.name, daemon=True).start()

    def show(self, packed: bytes) -> None:
        """Write a picture, or count it as dropped; never waits."""
        self.go_on()
        if not self._open or len(self._rest):
            self.dropped += 1
            return
        self._rest = memoryview(packed)
        self.go_on()

    def go_on(self) -> None:
        """Write more of what was begun."""
        while self._open and len(self._rest):
            try:
                written = os.write(self._pipe, self._rest)
            except BlockingIOError:
                return
            except OSError:
                self._open = False
                log.warning("the %s ended; the node goes on without it", self.settings.name)
                return
            self._rest = self._rest[written:]

    @property
    def is_waiting(self) -> bool:
        """Whether a picture is begun and not written."""
        return self._open and len(self._rest) > 0

    @property
    def pipe(self) -> int:
        """The file number of its pipe."""
        return self._pipe

    def end(self) -> None:
        """Close its pipe; it ends by itself, or is killed."""
        assert self.process.stdin is not None
        with contextlib.suppress(OSError):
            self.process.stdin.close()
        try:
            self.process.wait(END_S)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.wait()

    def _tell(self) -> None:
        """Print what the screen says: its address."""
        assert self.process.stdout is not None
        for line in self.process.stdout:
            text = line.decode("utf-8", "replace").strip()
            print(f"{self.settings.name}: {text}", file=sys.stderr, flush=True)


class Feed(View):
    """Feeds screens with the newest tick until it is closed; use it as a context manager."""

    def __init__(self, settings: Sequence[ScreenSettings]) -> None:
        self._settings = tuple(settings)
        self.screens: list[Screen] = []
        self._assembly: Assembly | None = None
        self._coverage = ""
        self._newest: Tick | None = None
        self._ticks = 0
        self._levels: dict[int, Level] = {}
        self._changes: deque[dict[str, Any]] = deque(maxlen=CHANGES)
        self._changed = 0
        self._failed = 0
        self._rated = (0, 0, 0.0)  # ticks, node time, rate
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._feed, name="feed", daemon=True)

    @property
    def dropped(self) -> int:
        """Pictures that no screen, or not every screen, was shown."""
        return self._failed + sum(screen.dropped for screen in self.screens)

    def bind(self, assembly: Assembly) -> None:
        """Take the assembly whose ticks are shown."""
        self._coverage = zones_text(assembly.config)
        self._assembly = assembly

    def on_tick(self, tick: Tick) -> None:
        """Store the newest tick, and what changed."""
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
                        "level": advice.level.name,
                        "reason": advice.reason.text,
                        "clears": advice.reason.clears_when,
                        "detail": advice.detail,
                        "latch": advice.latch_id,
                    }
                )
        self._newest = tick

    def __enter__(self) -> "Feed":
        """Start the screens.

        Raises:
            ConfigError: one cannot listen where it should.
        """
        for settings in self._settings:
            check_port(settings)
        self.screens = [Screen(settings) for settings in self._settings]
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

    def _feed(self) -> None:
        shown: Tick | None = None
        next_s = time.monotonic()
        while not self._stop.is_set():
            self._write_until(next_s)
            next_s = max(next_s + 1.0 / PICTURES_HZ, time.monotonic())
            tick = self._newest
            if tick is None or tick is shown or self._assembly is None:
                continue
            shown = tick
            try:
                packed = self._pack(tick, self._assembly)
            except Exception:
                self._failed += 1
                if self._failed == 1:
                    log.exception("a picture could not be made; further ones are only counted")
                continue
            for screen in self.screens:
                screen.show(packed)

    def _write_until(self, end_s: float) -> None:
        """Wait, and write on as screens read."""
        while (left_s := end_s - time.monotonic()) > 0 and not self._stop.is_set():
            waiting = [screen for screen in self.screens if screen.is_waiting]
            if not waiting:
                self._stop.wait(left_s)
                return
            ready = select.select([], [screen.pipe for screen in waiting], [], left_s)[1]
            for screen in waiting:
                if screen.pipe in ready:
                    screen.go_on()

    def _pack(self, tick: Tick, assembly: Assembly) -> bytes:
        picture = picture_of(tick, assembly)
        ticks, then_ns, rate_hz = self._rated
        if tick.now_ns - then_ns > 1_000_000_000:
            rate_hz = (self._ticks - ticks) / ((tick.now_ns - then_ns) * 1e-9) if then_ns else 0.0
            self._rated = (self._ticks, tick.now_ns, rate_hz)
        picture.facts.update(
            utc_s=time.time(),
            rate_hz=rate_hz or None,
            coverage=self._coverage,
            dropped=self.dropped,
            changes=list(self._changes.copy()),
        )
        return pack(picture)
