"""Sends the topics of a recording to Foxglove while the node runs.

The loop's thread creates items, as for a recording, but only while a client has subscribed. A
separate thread encodes them and passes them to Foxglove's server, whose own threads run outside
Python. If the thread is slow, the oldest items are dropped and counted; if a client is slow, the
server drops its oldest messages. The node reads nothing from clients.
"""

import logging
import os
import resource
import socket
import stat
import threading
import time
from collections import deque
from collections.abc import Callable, Iterable
from typing import Any

from hri_predict.base.errors import ConfigError, failure
from hri_predict.contracts.link import Received
from hri_predict.contracts.scene import Scene
from hri_predict.node.listeners import Tick
from hri_predict.operation.foxglove.settings import FoxgloveSettings
from hri_predict.recording import RecordingInfo
from hri_predict.recording.mcap.clocks import Clocks
from hri_predict.recording.mcap.format import to_json
from hri_predict.recording.mcap.items import Counters, Item, Items
from hri_predict.recording.mcap.schemas import schemas

log = logging.getLogger(__name__)

LEFT_OUT = ("/sent", "/clock")
"""Topics that exist only in recordings."""
QUEUE_ITEMS = 256
"""Maximum number of items queued for the thread: about one second."""
CLIENT_MESSAGES = 64
"""Maximum number of messages queued for one client."""
LOOK_NS = 1_000_000_000
"""Interval at which UTC is compared with the node's clock."""
END_S = 2.0
SHED_S, SAY_S = 0.25, 10.0
"""Intervals of counting connections, and of logging that there are too many.
"""


def foxglove_sdk() -> Any:
    """Return Foxglove's package.

    Raises:
        ConfigError: it is not installed.
    """
    try:
        import foxglove
    except ImportError as error:
        raise ConfigError(
            "foxglove needs a package that is not installed: foxglove-sdk; "
            "install it with: pip install 'hri-predict[foxglove]'"
        ) from error
    # Its threads must not log: each failed handshake would be a line, so that strangers could fill
    # the log, and a thread that ends while it holds the lock of a handler would hold up the exit.
    logging.getLogger("foxglove").setLevel(logging.CRITICAL + 1)
    logging.getLogger("tungstenite").setLevel(logging.CRITICAL + 1)
    return foxglove


class FoxgloveLive(Items):
    """The server; listens as soon as it is constructed.

    Args:
        settings: address, and rates of bulky data.
        info: names of the robots and of their capsules, and the frames of their bases.
        clocks: gives the UTC of each message.
        counters: called once a second.

    Attributes:
        dropped: items that the thread did not process in time.
        failed: items that could not be encoded.

    Raises:
        ConfigError: foxglove-sdk is not installed, the port is in use, or the address does not
            belong to this machine.
    """

    def __init__(
        self,
        settings: FoxgloveSettings,
        info: RecordingInfo,
        *,
        clocks: Clocks,
        counters: Counters | None = None,
    ) -> None:
        super().__init__(info, settings.rates, counters)
        self.dropped = self.failed = 0
        self._clocks = clocks
        sdk = foxglove_sdk()
        self._context = context = sdk.Context()  # kept: without it no channel is advertised
        self._channels = {
            topic: sdk.Channel(topic, schema=schema, message_encoding="json", context=context)
            for topic, schema in schemas([name for name, _ in info.robots]).items()
            if topic not in LEFT_OUT
        }
        self._server = _serve(sdk, settings, context)
        self._crowd = Crowd(self.port, settings.max_clients)
        self._shed_s = self._said_s = -SAY_S
        self._waiting: deque[Item] = deque()
        self._change = threading.Condition()
        self._closed = False
        self._thread = threading.Thread(target=self._run, name="foxglove", daemon=True)
        self._thread.start()

    @property
    def port(self) -> int:
        """Port on which the server listens."""
        return int(self._server.port)

    @property
    def is_watched(self) -> bool:
        """Whether a client has subscribed to any topic."""
        return any(map(self.wants, self._channels))

    def wants(self, topic: str) -> bool:
        """Whether a client has subscribed to this topic."""
        channel = self._channels.get(topic)
        return channel is not None and bool(channel.has_sinks())

    def on_scene(self, scene: Scene, receipt_ns: int) -> None:
        """Send a received scene."""
        if self.is_watched:
            super().on_scene(scene, receipt_ns)

    def on_received(self, link: str, received: Received) -> None:
        """Send a controller's message received on ``link``."""
        if self.is_watched:
            super().on_received(link, received)

    def on_tick(self, tick: Tick) -> None:
        """Send the results of a tick; do nothing without a client."""
        if self.is_watched:
            super().on_tick(tick)

    def take(self, item: Item) -> None:
        """Queue the item for the thread; if the queue is full, drop the oldest."""
        if not self.wants(item.topic):
            return
        with self._change:
            if self._closed:
                return
            if len(self._waiting) >= QUEUE_ITEMS:
                self._waiting.popleft()
                self.dropped += 1
            self._waiting.append(item)
            self._change.notify()

    def counts(self) -> dict[str, int]:
        """Return the counters, keyed by their names in the summary."""
        return {
            "foxglove_dropped": self.dropped,
            "foxglove_failed": self.failed,
            "foxglove_refused": self._crowd.ended,
        }

    def close(self) -> None:
        """Close all connections; safe to call twice."""
        with self._change:
            if self._closed:
                return
            self._closed = True
            self._change.notify()
        self._thread.join(END_S)
        # the server waits for a client that reads nothing, and would for ever
        ending = threading.Thread(target=self._server.stop, name="foxglove end", daemon=True)
        ending.start()
        ending.join(END_S)

    def _run(self) -> None:
        look_ns, offset_ns = -LOOK_NS, 0
        while True:
            self._shed()
            with self._change:
                if not self._waiting and not self._closed:
                    self._change.wait(SHED_S)
                if self._closed:
                    return
                if not self._waiting:
                    continue
                item = self._waiting.popleft()
            try:
                if item.log_ns - look_ns >= LOOK_NS:
                    look_ns, offset_ns = item.log_ns, self._clocks.read(item.log_ns).offset_ns
                self._send(item, max(item.log_ns + offset_ns, 0))
            except BaseException as error:  # one item that cannot be encoded must not end the view
                failure(error)
                self.failed += 1

    def _shed(self) -> None:
        """Close connections above the limit, and log it at a limited rate."""
        now_s = time.monotonic()
        if now_s - self._shed_s < SHED_S:
            return
        self._shed_s = now_s
        if self._crowd.shed() and now_s - self._said_s >= SAY_S:
            self._said_s = now_s
            log.warning(
                "foxglove: more than max_clients connections: %d closed since the start; close "
                "some clients, or increase foxglove.max_clients",
                self._crowd.ended,
            )

    def _send(self, item: Item, utc_ns: int) -> None:
        said = item.encode(*item.args, utc_ns) if item.wants_utc else item.encode(*item.args)
        data = said if isinstance(said, bytes) else to_json(said)
        self._channels[item.topic].log(data, log_time=utc_ns)


def _serve(sdk: Any, settings: FoxgloveSettings, context: Any) -> Any:
    try:
        return sdk.start_server(
            name="hri-predict",
            host=settings.host,
            port=settings.port,
            context=context,
            message_backlog_size=CLIENT_MESSAGES,
        )
    except (RuntimeError, ValueError, OverflowError) as error:
        why = (str(error).splitlines() or [""])[0].rpartition(": ")[2].partition(" (os error")[0]
        raise ConfigError(
            f"foxglove: {settings.host} port {settings.port}: {why}; choose another port or host"
        ) from error


MOST_FILES = 4096
"""Number of descriptors to try if the system does not list the open ones."""
IDLE_S, INTERVAL_S, PROBES = 20, 5, 3
"""A client without power is detected after 35 s (tcp(7), TCP_KEEPIDLE and related options)."""


class Crowd:
    """The connections to one port of this process.

    Limits them for a server that does not, such as foxglove-sdk's: clients that never close their
    connections would use up the file descriptors of the node's process. The server's sockets belong
    to this process: they are found by their address, and connections above the limit are shut down,
    which the server treats as closed by the client.

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
