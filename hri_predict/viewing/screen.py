"""A screen: a process that shows pictures. Its pipe never blocks the writer.

While a screen does not read, a partly written picture waits, and newer ones are dropped and
counted. A screen exits when its pipe closes, however the process at the other end exited. A screen
that exits before is restarted at the same address, after a growing pause.
"""

import contextlib
import errno
import logging
import math
import os
import select
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from urllib.parse import urlsplit

from hri_predict.base.errors import ConfigError, OsErrorAs

log = logging.getLogger(__name__)

END_S = 3.0
"""Time from closing its pipe until a screen is killed."""
PAUSE_S, LONGEST_PAUSE_S = 1.0, 60.0
"""Pause before a screen that exited is restarted; it doubles each time,"""
STEADY_S = 600.0
"""and is short again after a screen that ran for this long."""
MOST_STARTS = 10
"""Number of such exits after which a screen is given up: a start costs a second of CPU."""
LOOPBACK = "127.0.0.1"


@dataclass(frozen=True, slots=True)
class ScreenSettings:
    """A process that shows pictures.

    Attributes:
        name: name for users.
        module: module to run with ``python -m``; it accepts ``--host`` and ``--port``.
        port: port; 0: any free port.
        host: the address that it listens on.
        urls: addresses under which proxies serve it; given as ``--url``.
    """

    name: str
    module: str
    port: int
    host: str = LOOPBACK
    urls: tuple[str, ...] = ()


def check_port(settings: ScreenSettings) -> None:
    """Raise a ``ConfigError`` if a screen cannot listen on its address."""
    if not 0 <= settings.port <= 65535:
        raise ConfigError(f"--{settings.name} {settings.port}: give a port from 0 to 65535")
    if not settings.host.strip():  # the system takes it for all addresses
        raise ConfigError(f"--viewer-host: empty; give an address, such as {LOOPBACK}")
    family = socket.AF_INET6 if ":" in settings.host else socket.AF_INET
    with socket.socket(family) as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        what = f"--{settings.name} {settings.port}: cannot listen on {settings.host}"
        with OsErrorAs(ConfigError, what, "name another port, or 0 for any free one"):
            try:
                probe.bind((settings.host, settings.port))
            except (socket.gaierror, TypeError, UnicodeError) as error:
                raise _wrong_host(settings.host, error) from error
            except OSError as error:
                if error.errno != errno.EADDRNOTAVAIL:
                    raise
                raise _wrong_host(settings.host, error) from error


def _wrong_host(host: str, error: Exception) -> ConfigError:
    """Return the error for an address that no port can mend."""
    why = isinstance(error, OSError) and error.strerror
    return ConfigError(
        f"--viewer-host {host!r}: {why or 'not an address'}; give an address of this machine, "
        f"such as {LOOPBACK}"
    )


class Screen:
    """One screen's process and its pipe. Used by one thread, except ``dropped``.

    Attributes:
        dropped: number of pictures that arrived while the process was too slow or not running.
        starts: number of starts. A new process starts without the earlier pictures.

    Args:
        settings: its settings.
        heard: called with its address once it listens, in a separate thread.

    Raises:
        ConfigError: the system has no resources for its process.
    """

    def __init__(
        self, settings: ScreenSettings, heard: Callable[[str], None] = lambda url: None
    ) -> None:
        self.settings = settings
        self._heard = heard
        self.dropped = self.starts = 0
        self._port = settings.port
        self._in_a_row = 0
        self._again_s = math.inf
        what = f"--{settings.name}: its process cannot be started"
        remedy = "leave it out, or raise the limits of processes and open files (ulimit -u, -n)"
        with OsErrorAs(ConfigError, what, remedy):
            self._start()

    def _start(self) -> None:
        self._rest = memoryview(b"")
        command = [sys.executable, "-m", self.settings.module]
        command += ["--host", self.settings.host, "--port", str(self._port)]
        command += [word for url in self.settings.urls for word in ("--url", url)]
        self.process = subprocess.Popen(
            command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, close_fds=True
        )
        assert self.process.stdin is not None
        self._pipe = self.process.stdin.fileno()
        os.set_blocking(self._pipe, False)
        self._open, self._started_s = True, time.monotonic()
        self.starts += 1
        threading.Thread(target=self._tell, name=self.settings.name, daemon=True).start()

    def _ended(self) -> None:
        """Log that it exited, and when it restarts."""
        now_s, name = time.monotonic(), self.settings.name
        self._open = False
        self._in_a_row = 0 if now_s - self._started_s > STEADY_S else self._in_a_row + 1
        if self._in_a_row >= MOST_STARTS:
            self._again_s = math.inf
            log.warning("the %s exited %d times in a row and is given up", name, self._in_a_row)
            return
        pause_s = min(LONGEST_PAUSE_S, PAUSE_S * 2**self._in_a_row)
        self._again_s = now_s + pause_s
        log.warning("the %s exited; it restarts in %g s", name, pause_s)

    def show(self, packed: bytes) -> bool:
        """Write a picture, or count it as dropped; never waits.

        Returns:
            Whether it was accepted: it arrives complete unless the screen exits first.
        """
        self.go_on()
        if not self._open or len(self._rest):
            self.dropped += 1
            return False
        self._rest = memoryview(packed)
        self.go_on()
        return True

    def go_on(self) -> None:
        """Continue to write a partly written picture."""
        while self._open and len(self._rest):
            try:
                written = os.write(self._pipe, self._rest)
            except BlockingIOError:
                return
            except OSError:
                self._ended()
                return
            self._rest = self._rest[written:]

    def keep_alive(self) -> None:
        """Restart a screen that exited, once its pause is over."""
        if self._open or time.monotonic() < self._again_s:
            return
        self.end(0.0)
        try:
            self._start()
        except (OSError, RuntimeError) as error:  # no file, process or thread is left
            log.warning("the %s does not start: %s", self.settings.name, error)
            self._ended()

    @property
    def is_waiting(self) -> bool:
        """Return whether a picture is partly written."""
        return self._open and len(self._rest) > 0

    @property
    def pipe(self) -> int:
        """Return the file descriptor of its pipe."""
        return self._pipe

    def end(self, within_s: float | None = None) -> None:
        """Close its pipe; the process exits, or is killed."""
        assert self.process.stdin is not None
        with contextlib.suppress(OSError):
            self.process.stdin.close()
        try:
            self.process.wait(END_S if within_s is None else within_s)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.wait()

    def _tell(self) -> None:
        """Print the screen's output: its address."""
        assert self.process.stdout is not None
        for line in self.process.stdout:
            text = line.decode("utf-8", "replace").strip()
            with contextlib.suppress(ValueError):
                self._port = urlsplit(text).port or self._port
            print(f"{self.settings.name}: {text}", file=sys.stderr, flush=True)
            if text.startswith("http"):
                self._heard(text)


def write_until(screens: Sequence[Screen], end_s: float, stop: threading.Event) -> None:
    """Wait until a time of the monotonic clock or ``stop``; keep writing while screens read."""
    while (left_s := end_s - time.monotonic()) > 0 and not stop.is_set():
        waiting = [screen for screen in screens if screen.is_waiting]
        if not waiting:
            stop.wait(left_s)
            return
        ready = select.select([], [screen.pipe for screen in waiting], [], left_s)[1]
        for screen in waiting:
            if screen.pipe in ready:
                screen.go_on()
