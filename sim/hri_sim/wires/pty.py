"""Pseudo-terminals: a serial line between two processes, without hardware."""

import contextlib
import errno
import os
import select
import tty

from hri_drivers.wires.transport import TransportBusy
from hri_predict.base.errors import LinkError

WRITE_TIMEOUT_S = 0.05
HUNG_UP_WAIT_S = 0.02


def open_pty() -> tuple[int, str]:
    """Open a raw pseudo-terminal.

    Returns:
        The master's file descriptor, and the path that the other side opens as its serial port.
        The caller closes the descriptor, and the path disappears with it.
    """
    master, slave = os.openpty()
    try:
        tty.setraw(slave)
        return master, os.ttyname(slave)
    finally:
        os.close(slave)


class PtyTransport:
    """``Transport[bytes]`` on the master side of a pseudo-terminal.

    While the other side is closed, written bytes wait or are lost, as on an unplugged cable. The
    other side may be opened and closed at any time.

    Args:
        fd: the master's descriptor; ``close`` closes it, which unplugs the other side's port.

    Attributes:
        hung_up: whether the other side was closed at the last ``read``.
    """

    def __init__(self, fd: int) -> None:
        self._fd = fd
        self._closed = False
        self.hung_up = False

    def open(self) -> None:
        """Check that the descriptor is still open.

        Raises:
            LinkError: it was closed.
        """
        self._check()
        os.set_blocking(self._fd, False)

    def write(self, unit: bytes) -> None:
        """Write all bytes; wait at most 50 ms for the other side to read."""
        self._check()
        try:
            while unit:
                if not select.select([], [self._fd], [], WRITE_TIMEOUT_S)[1]:
                    raise TransportBusy("pseudo-terminal: the other side does not read")
                with contextlib.suppress(BlockingIOError):
                    unit = unit[os.write(self._fd, unit) :]
        except OSError as error:
            raise LinkError(f"pseudo-terminal: lost ({error})") from error

    def read(self, timeout_s: float) -> list[bytes]:
        """Return the bytes that have arrived, as one chunk."""
        self._check()
        try:
            if not select.select([self._fd], [], [], timeout_s)[0]:
                self.hung_up = False
                return []
            data = os.read(self._fd, 65_536)
        except BlockingIOError:
            return []
        except OSError as error:
            if error.errno != errno.EIO:
                raise LinkError(f"pseudo-terminal: lost ({error})") from error
            self.hung_up = True
            if timeout_s > 0:  # otherwise a reader would spin until the other side opens
                select.select([], [], [], min(timeout_s, HUNG_UP_WAIT_S))
            return []
        self.hung_up = False
        return [data] if data else []

    def close(self) -> None:
        """Close the descriptor; safe to call twice."""
        if not self._closed:
            self._closed = True
            with contextlib.suppress(OSError):
                os.close(self._fd)

    def _check(self) -> None:
        if self._closed:
            raise LinkError("pseudo-terminal: closed; open a new one")
