"""A screen's process that is fed by hand."""

import contextlib
import subprocess
import sys
import threading
from types import TracebackType

from hri_predict.viewing.picture import Picture, pack


class Shown:
    """Runs a screen's module and repeats the newest picture ten times a second."""

    def __init__(self, module: str) -> None:
        command = [sys.executable, "-m", module, "--host", "127.0.0.1", "--port", "0"]
        self.process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE)
        assert self.process.stdout is not None
        self.url = self.process.stdout.readline().decode().strip()
        self._packed = b""
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._repeat, daemon=True)
        self._thread.start()

    def show(self, picture: Picture | None) -> None:
        """Show this from now on; ``None``: send nothing, as a node that hangs."""
        self._packed = b"" if picture is None else pack(picture)

    def _repeat(self) -> None:
        assert self.process.stdin is not None
        while not self._stop.wait(0.1):
            if self._packed:
                with contextlib.suppress(BrokenPipeError):
                    self.process.stdin.write(self._packed)
                    self.process.stdin.flush()

    def __enter__(self) -> "Shown":
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._stop.set()
        self._thread.join()
        assert self.process.stdin is not None
        assert self.process.stdout is not None
        with contextlib.suppress(BrokenPipeError):  # a test killed it
            self.process.stdin.close()
        self.process.wait(10)
        self.process.stdout.close()
