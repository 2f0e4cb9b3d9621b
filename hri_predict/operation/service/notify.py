"""Reports of a service to systemd: datagrams to the socket named by systemd, as in sd_notify(3).

Sending never blocks, because the loop itself sends some of the messages.
"""

import contextlib
import os
import socket
import time
from collections.abc import MutableMapping
from typing import Self

from hri_predict.base.quantities.whole import whole


class Notifier:
    """Reports the node's state to the service manager.

    Args:
        address: a path, or ``@`` and a name in Linux's abstract namespace.
        watchdog_s: time without ``alive`` after which systemd assumes that the node hangs;
            ``None``: never.

    Attributes:
        lost: messages that were not accepted.
    """

    def __init__(self, address: str, watchdog_s: float | None = None) -> None:
        self.watchdog_s = watchdog_s
        self.lost = 0
        self._address = "\0" + address[1:] if address.startswith("@") else address
        kind = socket.SOCK_DGRAM | socket.SOCK_CLOEXEC | socket.SOCK_NONBLOCK
        self._socket = socket.socket(socket.AF_UNIX, kind)

    @classmethod
    def from_environ(cls, environ: MutableMapping[str, str] = os.environ) -> Self | None:
        """Return the notifier that systemd configured for this process; ``None`` if it was not
        started as ``Type=notify``.

        The environment variables are removed, so that commands run by the node cannot report for
        it.
        """
        address = environ.pop("NOTIFY_SOCKET", "")
        usec, pid = environ.pop("WATCHDOG_USEC", ""), environ.pop("WATCHDOG_PID", "")
        if address[:1] not in ("/", "@") or len(address) < 2:
            return None
        ours = pid in ("", str(os.getpid()))
        watched = whole(usec) if ours else None
        return cls(address, watched * 1e-6 if watched else None)

    def ready(self, status: str) -> None:
        """Report that the node is running, or has finished reloading."""
        self._send("READY=1", _status(status))

    def says(self, status: str) -> None:
        """Set the line that ``systemctl status`` shows."""
        self._send(_status(status))

    def alive(self) -> None:
        """Report that the loop is alive."""
        self._send("WATCHDOG=1")

    def reloading(self) -> None:
        """Report that the node is reloading its configuration, until ``ready``."""
        self._send("RELOADING=1", f"MONOTONIC_USEC={time.monotonic_ns() // 1000}")

    def stopping(self) -> None:
        """Report that the node is stopping."""
        self._send("STOPPING=1", _status("stopping"))

    def close(self) -> None:
        """Send no more reports; safe to call twice."""
        self._socket.close()

    def _send(self, *lines: str) -> None:
        try:
            self._socket.sendto("\n".join(lines).encode(), self._address)
        except OSError:  # nobody is there, or the queue is full: the loop must not wait
            self.lost += 1


def _status(text: str) -> str:
    return "STATUS=" + "".join(c if c.isprintable() else " " for c in text)


def has_terminal() -> bool:
    """Whether a terminal controls this process: closing it then sends SIGHUP."""
    with contextlib.suppress(OSError):
        os.close(os.open("/dev/tty", os.O_RDWR | os.O_NOCTTY | os.O_CLOEXEC))
        return True
    return False
