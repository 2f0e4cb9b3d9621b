"""Payloads under keys over a zenoh session."""

import contextlib
import threading
import time
from collections import deque
from collections.abc import Sequence

import zenoh
from zenoh.handlers import Callback

from hri_drivers.wires.zenoh_session import (
    CONNECT_S,
    ZenohSettings,
    expects_neighbour,
    open_session,
    session_config,
    short,
)
from hri_predict.base.errors import LinkError
from hri_predict.protocol.keyed import MAX_PAYLOAD, Keyed

CAPACITY = 4096  # payloads that may wait to be read; the oldest are dropped
BULK_KEYS = ("zone", "pose")
LONE_S = 0.02  # how often a new session checks for a neighbour


class ZenohTransport:
    """``Transport[Keyed]``: writes and reads payloads whose keys begin with ``prefix``.

    If ``connect`` is configured and there is no connection, the transport counts as lost: zenoh
    would drop a message without an error.

    Args:
        settings: the session's.
        prefix: start of all keys; a unit's key is the rest.
        subscribed: keys to receive, after the prefix; zenoh's key expressions.

    Attributes:
        overflowed: number of payloads lost because they were not read in time.
    """

    def __init__(
        self,
        settings: ZenohSettings,
        prefix: str,
        subscribed: Sequence[str] = (),
    ) -> None:
        self.overflowed = 0
        self._settings = settings
        self._prefix = prefix
        self._subscribed = subscribed
        self._needs_neighbour = False
        self._session: zenoh.Session | None = None
        self._publishers: dict[str, zenoh.Publisher] = {}
        self._arrived = threading.Condition()
        self._inbox: deque[Keyed] = deque(maxlen=CAPACITY)

    def open(self) -> None:
        """Open the session; wait at most half a second for a neighbour.

        Raises:
            ConfigError: see ``open_session``.
            LinkError: there is no connection; the message names the endpoints and the remedy.
        """
        self.close()
        self._needs_neighbour = expects_neighbour(session_config(self._settings))
        self._session = open_session(self._settings)
        try:
            for key in self._subscribed:
                self._session.declare_subscriber(
                    self._prefix + key,
                    Callback(self._hear, indirect=False),
                    allowed_origin=zenoh.Locality.REMOTE,
                )
            self._wait_for_neighbour()
        except (zenoh.ZError, LinkError) as error:
            self.close()
            raise LinkError(f"zenoh: {short(error)}") from error

    def write(self, unit: Keyed) -> None:
        """Send one payload; blocks at most 0.2 s while a neighbour accepts nothing.

        Raises:
            LinkError: there is no connection.
        """
        session = self._opened()
        self._check_neighbour(session)
        try:
            publisher = self._publishers.get(unit.key)
            if publisher is None:
                publisher = self._publishers[unit.key] = _publisher(
                    session, self._prefix + unit.key, unit.key in BULK_KEYS
                )
            publisher.put(unit.data)
        except zenoh.ZError as error:
            raise LinkError(f"zenoh: {short(error)}; reopening") from error

    def read(self, timeout_s: float) -> list[Keyed]:
        """Return what has arrived.

        Raises:
            LinkError: there is no connection.
        """
        session = self._opened()
        with self._arrived:
            if not self._inbox and timeout_s > 0:
                self._arrived.wait(timeout_s)
            units = list(self._inbox)
            self._inbox.clear()
        if not units:
            self._check_neighbour(session)
        return units

    def close(self) -> None:
        """Close the session; never raises, safe to call twice."""
        session, self._session = self._session, None
        self._publishers.clear()
        if session is not None:
            with contextlib.suppress(Exception):
                session.close()
        with self._arrived:
            self._inbox.clear()
            self._arrived.notify_all()

    def _hear(self, sample: zenoh.Sample) -> None:
        """Called by zenoh, in its own thread."""
        payload = sample.payload
        content = bytes(payload) if len(payload) <= MAX_PAYLOAD else b""  # too long: not ours
        key = str(sample.key_expr).removeprefix(self._prefix)
        unit = Keyed(key, content, time.monotonic_ns())
        with self._arrived:
            self.overflowed += len(self._inbox) == CAPACITY
            self._inbox.append(unit)
            self._arrived.notify_all()

    def _opened(self) -> zenoh.Session:
        session = self._session
        if session is None:
            raise LinkError("the zenoh session is closed; open it first")
        return session

    def _wait_for_neighbour(self) -> None:
        deadline = time.monotonic() + CONNECT_S
        while self._lonely(self._opened()) and time.monotonic() < deadline:
            time.sleep(LONE_S)
        self._check_neighbour(self._opened())

    def _check_neighbour(self, session: zenoh.Session) -> None:
        if self._lonely(session):
            raise LinkError(
                "no connection; start the router or peer, or correct 'connect' "
                f"({', '.join(self._settings.connect or ['as in zenoh_config or the default'])})"
            )

    def _lonely(self, session: zenoh.Session) -> bool:
        return self._needs_neighbour and not session.info.transports()


def _publisher(session: zenoh.Session, key: str, bulk: bool) -> zenoh.Publisher:
    """A publisher; Zone and Pose get low priority, and are dropped if the network is full."""
    return session.declare_publisher(
        key,
        congestion_control=(
            zenoh.CongestionControl.DROP if bulk else zenoh.CongestionControl.BLOCK
        ),
        priority=zenoh.Priority.DATA_LOW if bulk else zenoh.Priority.REAL_TIME,
        express=not bulk,
    )
