"""Interface of a kind of hook: send one alert within a time limit, or raise the reason."""

import contextlib
import os
import socket
import ssl
import threading
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from hri_predict.base.errors import ConfigError
from hri_predict.operation.alerting.alert import AnyAlert

ANSWER_BYTES = 65_536


class SendError(Exception):
    """An alert was not delivered; the message is one line without secrets.

    Attributes:
        permanent: a further attempt would fail the same way.
        again_s: minimum wait requested by the receiver; ``None`` if it did not request any.
    """

    def __init__(self, text: str, *, permanent: bool = False, again_s: float | None = None) -> None:
        super().__init__(text)
        self.permanent = permanent
        self.again_s = again_s


@dataclass(frozen=True, kw_only=True)
class HookContext:
    """Environment of hooks.

    Attributes:
        base_dir: the configuration's folder.
        cell: name of the cell, for receivers of alerts from several cells.
        live: whether a node is running; a test must not announce a node.
    """

    base_dir: Path
    cell: str
    live: bool = True


class Sender:
    """Sends alerts of one hook; the hook's thread alone calls it, except for ``abort``.

    Attributes:
        tend_s: interval at which to call ``tend`` while there is nothing to send; ``None``: never.
        secrets: texts that must not appear in any message.
    """

    tend_s: float | None = None
    secrets: tuple[str, ...] = ()

    def send(self, alert: AnyAlert, more_changes: int) -> str:
        """Deliver one alert; return the receiver's answer in a few words.

        Raises:
            SendError: it was not delivered.
        """
        raise NotImplementedError

    def tend(self) -> None:
        """Keep a connection up.

        Raises:
            SendError: it is down and cannot be restored.
        """

    def close(self) -> None:
        """Release everything; called when the node stops."""

    def abort(self) -> None:
        """Abort an attempt in progress; called from another thread when the node can wait no
        longer.
        """


@contextlib.contextmanager
def cut_after(seconds: float, sock: Callable[[], socket.socket | None]) -> Iterator[None]:
    """Shut a connection down after ``seconds``.

    A socket's own timeout restarts with every byte, so a server that sends a byte now and then
    would block the hook forever.

    Raises:
        TimeoutError: instead of the error that the shutdown caused.
    """
    was_cut = False

    def cut() -> None:
        nonlocal was_cut
        was_cut = True
        open_socket = sock()
        if open_socket is not None:
            with contextlib.suppress(OSError):  # TLS's own shutdown would wait for the other side
                socket.socket.shutdown(open_socket, socket.SHUT_RDWR)

    timer = threading.Timer(seconds, cut)
    timer.daemon = True
    timer.start()
    try:
        yield
    except Exception as error:
        if was_cut:
            raise TimeoutError from error
        raise
    finally:
        timer.cancel()


class Answer:
    """A receiver's answer as a file, limited to ``ANSWER_BYTES`` because it may be endless.

    Reading takes memory, and time of the interpreter that also runs the loop.
    """

    def __init__(self, file: Any) -> None:
        self._file, self._left = file, ANSWER_BYTES

    def readline(self, limit: int) -> bytes:
        """Return the next line, or as much of it.

        Raises:
            SendError: the answer is too long.
        """
        line: bytes = self._file.readline(limit)
        self._left -= len(line)
        if self._left < 0:
            raise SendError(f"sends more than {ANSWER_BYTES} bytes as an answer")
        return line

    def __getattr__(self, name: str) -> Any:
        return getattr(self._file, name)


def tls_context(ca_file: str | None, base_dir: Path) -> ssl.SSLContext:
    """Return a TLS context that checks the server's certificate and name, using the system's
    certificate authorities or those in a file.

    Raises:
        ConfigError: the file cannot be used.
    """
    if ca_file is None:
        return ssl.create_default_context()
    path = base_dir / ca_file
    try:
        if not os.path.isfile(path):
            raise FileNotFoundError("no such file")
        return ssl.create_default_context(cafile=str(path))
    except OSError as error:  # ssl.SSLError is one
        reason = "no certificate in PEM format" if isinstance(error, ssl.SSLError) else error
        raise ConfigError(f"ca_file {path}: {reason}; check the path") from error


def said(error: BaseException) -> str:
    """Describe the failure of a connection in a few words."""
    if isinstance(error, ssl.SSLCertVerificationError):
        return f"the server's certificate is not trusted: {error.verify_message}"
    if isinstance(error, TimeoutError):
        return "no answer in time"
    if isinstance(error, socket.gaierror):
        return "host name not found"
    if isinstance(error, OSError) and error.strerror:
        return error.strerror
    return str(error) or type(error).__name__
