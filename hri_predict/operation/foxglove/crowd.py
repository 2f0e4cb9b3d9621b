"""Connection limit for a server without one, such as foxglove-sdk's.

Without a limit, clients that never close their connections would use up the file descriptors of the
node's process. The server's sockets belong to this process: they are found by their address, and
connections above the limit are shut down, which the server treats as closed by the client.
"""

import os
import resource
import socket
import stat
from collections.abc import Callable, Iterable

MOST_FILES = 4096
"""Number of descriptors to try if the system does not list the open ones."""
IDLE_S, INTERVAL_S, PROBES = 20, 5, 3
"""A client without power is detected after 35 s (tcp(7), TCP_KEEPIDLE and related options)."""


class Crowd:
    """The connections to one port of this process.

    Args:
        port: the server's port.
        most: maximum number of open connections; the latest ones above it are closed.

    Attributes:
        ended: number of connections closed.
    """

    def __init__(self, port: int, most: int) -> None:
        self.ended = 0
        self._port, self._most = port, most
        self._known: set[tuple[int, int]] = set()  # descriptor and inode of those that may stay

    def shed(self) -> int:
        """Close the connections above the limit; return their number. Does not open any file."""
        found = self._connections()
        self._known &= set(found)
        fresh = [each for each in found if each not in self._known]
        room = self._most - len(self._known)
        for each in fresh[:room]:
            self._known.add(each)
            _keep_alive(each[0])
        for each in fresh[max(0, room) :]:
            _on(each[0], self._end)
        count = max(0, len(fresh) - max(0, room))
        self.ended += count
        return count

    def _end(self, opened: socket.socket) -> None:
        if self._is_client(opened):  # the number may be another socket's by now
            opened.shutdown(socket.SHUT_RDWR)

    def _connections(self) -> list[tuple[int, int]]:
        """Return descriptor and inode of each connection to the port."""
        found = []
        for descriptor in _descriptors():
            try:
                status = os.fstat(descriptor)
            except OSError:
                continue
            if stat.S_ISSOCK(status.st_mode) and _on(descriptor, self._is_client):
                found.append((descriptor, status.st_ino))
        return found

    def _is_client(self, opened: socket.socket) -> bool:
        if opened.family not in (socket.AF_INET, socket.AF_INET6):
            return False
        here = opened.getsockname()
        return here[1] == self._port and bool(opened.getpeername())  # the listener has no peer


def _descriptors() -> Iterable[int]:
    """Return all open descriptors, and perhaps some that are not open."""
    try:
        return [int(name) for name in os.listdir("/proc/self/fd")]
    except (OSError, ValueError):  # no such folder, or no file may be opened any more
        limit, _ = resource.getrlimit(resource.RLIMIT_NOFILE)
        return range(min(limit, MOST_FILES) if limit > 0 else MOST_FILES)


def _on(descriptor: int, act: Callable[[socket.socket], object]) -> bool:
    """Call ``act`` with a descriptor's socket, which stays open; return ``False`` if it failed."""
    try:
        opened = socket.socket(fileno=descriptor)
    except OSError:  # closed in between, or not a socket any more
        return False
    try:
        return act(opened) is not False
    except OSError:
        return False
    finally:
        opened.detach()


def _keep_alive(descriptor: int) -> None:
    def ask(opened: socket.socket) -> None:
        opened.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
        if hasattr(socket, "TCP_KEEPIDLE"):
            opened.setsockopt(socket.IPPROTO_TCP, socket.TCP_KEEPIDLE, IDLE_S)
            opened.setsockopt(socket.IPPROTO_TCP, socket.TCP_KEEPINTVL, INTERVAL_S)
            opened.setsockopt(socket.IPPROTO_TCP, socket.TCP_KEEPCNT, PROBES)

    _on(descriptor, ask)
