"""A server that accepts connections and then says nothing, and processes of the node that meet it.

Nothing of the node may wait for it without a limit.
"""

import contextlib
import os
import socket
import subprocess
import sys
import threading
from pathlib import Path

import yaml

from hri_predict.run import config as configuration


class SilentServer:
    """Accepts, and says nothing, or only a greeting."""

    def __init__(self, greeting: bytes = b"") -> None:
        self.socket = socket.create_server(("127.0.0.1", 0))
        self.port = self.socket.getsockname()[1]
        self.accepted: list[socket.socket] = []
        self._greeting = greeting
        threading.Thread(target=self._accept, daemon=True).start()

    def _accept(self) -> None:
        while True:
            try:
                connection = self.socket.accept()[0]
                connection.sendall(self._greeting)
            except OSError:
                return
            self.accepted.append(connection)

    def close(self) -> None:
        with contextlib.suppress(OSError):
            self.socket.shutdown(socket.SHUT_RDWR)  # wakes the thread
        self.socket.close()
        for each in self.accepted:
            each.close()


def cell_with(folder: Path, **changes) -> Path:
    """The demonstration's cell with the serial link alone, a quick predictor, and ``changes``."""
    config = yaml.safe_load(configuration.shipped("demo.yaml").read_text())
    config["predictor"] = {"name": "constant_velocity", "horizon_s": 1.2}
    config["links"] = config["links"][:1]
    path = folder / "cell.yaml"
    path.write_text(yaml.safe_dump(config | changes))
    return path


def started(*arguments: str) -> subprocess.Popen[str]:
    """The command as a process of its own."""
    return subprocess.Popen(
        [sys.executable, "-m", "hri_predict", *arguments],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=os.environ,
    )  # fmt: skip
