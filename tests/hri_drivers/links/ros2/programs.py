"""ROS 2 nodes in processes of their own."""

import json
import os
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path
from typing import Any

HERE = Path(__file__).parent
LISTENER, ADVISOR = HERE / "ros_listener.py", HERE / "ros_advisor.py"
FOLLOWER = HERE.parents[3] / "drivers" / "ros2" / "speed_follower.py"


class Program:
    """A program in a process of its own, and the lines that it printed, with times."""

    def __init__(self, domain: int, script: Path, *arguments: str) -> None:
        environment = os.environ | {
            "ROS_DOMAIN_ID": str(domain), "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
        }  # fmt: skip
        self.process = subprocess.Popen(
            [sys.executable, str(script), *arguments],
            env=environment,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        self.lines: list[tuple[float, str]] = []
        self.errors: list[str] = []
        assert self.process.stderr is not None
        threading.Thread(target=self._read, daemon=True).start()
        threading.Thread(
            target=self.errors.extend, args=(self.process.stderr,), daemon=True
        ).start()

    def _read(self) -> None:
        assert self.process.stdout is not None
        for line in self.process.stdout:
            self.lines.append((time.monotonic(), line.strip()))

    def heard(self, topic: str) -> list[Any]:
        """Data of the messages of a topic."""
        rows = [json.loads(line) for _, line in list(self.lines)]
        return [row["data"] for row in rows if row["topic"] == topic]

    def end(self, number: int = signal.SIGKILL) -> None:
        self.process.send_signal(number)
        self.process.wait(10)
