"""The made-up controller as a process of its own, and what it prints."""

import json
import subprocess
import sys
import threading
from typing import Any

PATIENCE_S = 20.0


class Robot:
    """``python -m hri_sim.rtde`` on loopback.

    Attributes:
        port: the port that it listens at.
        lines: what it has printed of its registers, oldest first.
    """

    def __init__(self, *options: str, port: int = 0) -> None:
        command = [sys.executable, "-m", "hri_sim.rtde", "--port", str(port), *options]
        self._process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
        assert self._process.stdout is not None
        self.lines: list[dict[str, Any]] = []
        self.port: int = json.loads(self._process.stdout.readline())["port"]
        threading.Thread(target=self._read, daemon=True).start()

    def _read(self) -> None:
        assert self._process.stdout is not None
        for line in self._process.stdout:
            self.lines.append(json.loads(line))

    def kill(self) -> None:
        """End it as a power failure would."""
        self._process.kill()
        self._process.wait()

    def pause(self, signal: int) -> None:
        """Send it a signal."""
        self._process.send_signal(signal)
