"""The camera's process: it sends scenes to a local port and reports why it exited."""

import contextlib
import secrets
import select
import socket
import subprocess
import sys
import tempfile
import threading
import time
from collections import deque
from collections.abc import Callable, Sequence
from pathlib import Path
from types import TracebackType

from hri_predict.base.errors import SourceError

COMMAND = [sys.executable, "-m", "hri_predict.cli.tryout.beside", "camera"]
LOOPBACK = "127.0.0.1"
START_S = 60.0
"""Maximum time to the first scene: loading a network and opening a camera may take seconds."""
END_S = 3.0
"""Time after which a process that was asked to exit is killed."""
_KEY_BYTES = 32


class Camera:
    """The process of ``hri-predict camera``, ended when the context manager is left.

    Its scenes are authenticated by a key that is created for this process and deleted with it.

    Args:
        arguments: arguments of the command, besides host, port and key.
        ended: called in a separate thread if the process exits before it is closed.

    Attributes:
        port: the UDP port to which the process sends.
        key_file: the file with the key.
    """

    def __init__(self, arguments: Sequence[str], ended: Callable[[], None]) -> None:
        self._ended = ended
        self._closing = False
        self._lines: deque[str] = deque(maxlen=20)
        self._folder = tempfile.TemporaryDirectory(prefix="hri-predict-")
        self.key_file = Path(self._folder.name, "camera.key")
        self.key_file.touch(mode=0o600)
        self.key_file.write_text(secrets.token_hex(_KEY_BYTES), encoding="utf-8")
        self._probe = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._probe.bind((LOOPBACK, 0))
        self.port = int(self._probe.getsockname()[1])
        where = ["--host", LOOPBACK, "--port", str(self.port), "--key-file", str(self.key_file)]
        self.process = subprocess.Popen(
            [*COMMAND, *arguments, *where],
            stdin=subprocess.PIPE,
            stdout=subprocess.DEVNULL,  # a summary
            stderr=subprocess.PIPE,
            process_group=0,  # Ctrl-C is for the node, which ends this process in its turn
        )
        self._reader = threading.Thread(target=self._read, name="camera", daemon=True)
        self._reader.start()

    def wait(self) -> None:
        """Wait for the first scene; afterwards the port is free for the node.

        Raises:
            SourceError: the process exited first (the message is its own error), or sent nothing
                for ``START_S``.
        """
        end_s = time.monotonic() + START_S
        with self._probe:
            while not select.select([self._probe], [], [], 0.1)[0]:
                if self.process.poll() is not None:
                    raise SourceError(self.reason())
                if time.monotonic() > end_s:
                    raise SourceError(f"the camera sent nothing in {START_S:.0f} s")

    def reason(self) -> str:
        """Return why the process exited: its printed error, or its traceback's last line."""
        self._reader.join(END_S)
        lines = [line for line in self._lines if line]
        errors = [line.removeprefix("error: ") for line in lines if line.startswith("error: ")]
        if errors:
            return errors[-1]
        faulty = any(line.startswith("Traceback ") for line in lines)
        status = f"the camera's process ended (status {self.process.wait()})"
        return f"{status}: {lines[-1]}" if faulty else f"{status} without a reason"

    def _read(self) -> None:
        """Keep the last lines of the process; print all except errors and library messages."""
        assert self.process.stderr is not None
        for line in self.process.stderr:
            text = "".join(c for c in line.decode("utf-8", "replace") if c.isprintable()).strip()
            self._lines.append(text)
            if text and not text.startswith(("error: ", "INFO: ")):
                print(f"camera: {text.removeprefix('camera: ')}", file=sys.stderr, flush=True)
        self.process.wait()
        if not self._closing:
            self._ended()

    def __enter__(self) -> "Camera":
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._closing = True
        assert self.process.stdin is not None
        with contextlib.suppress(OSError):
            self.process.stdin.close()
        try:
            self.process.wait(END_S)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.wait()
        self._reader.join(END_S)
        self._probe.close()
        self._folder.cleanup()
