"""Limits of the server on the resources and rights of unknown clients.

asyncua's own server accepts any number of subscriptions, items and sessions on one connection,
sends as fast as a client requests, lets anyone register servers, and has an administrator account
without a password.
"""

from collections.abc import Collection
from typing import Any

from asyncua import ua
from asyncua.common.utils import ServiceError
from asyncua.crypto.permission_rules import SimpleRoleRuleset, User, UserRole
from asyncua.server.binary_server_asyncio import OPCUAProtocol
from asyncua.server.internal_server import InternalServer
from asyncua.server.internal_session import InternalSession
from asyncua.server.subscription_service import SubscriptionService

MOST = 16
"""Maximum number of open connections. A further one closes the connection silent for the
longest."""
MOST_SUBSCRIPTIONS = 2 * MOST
MOST_ITEMS = 512
"""Maximum number of monitored items in one subscription; two for each variable of eight robots."""
MOST_WAITING = 64  # changes of an item, and messages of a subscription, that were not fetched
SHORTEST_MS = 10.0
"""Shortest publishing interval."""
MOST_BYTES = 262_144
"""Maximum number of bytes that a client may leave unread, or send in one message."""
ACTIVATED_S, SESSION_MS = 5.0, 30_000.0
NOBODY = User()
_WRITE = ua.NodeId(ua.ObjectIds.WriteRequest_Encoding_DefaultBinary)


class Rules(SimpleRoleRuleset):
    """Clients may read, subscribe and call methods; nothing is written.

    Attributes:
        refused: number of refused write requests.
    """

    def __init__(self) -> None:
        super().__init__()
        self.refused = 0

    def check_validity(self, user: User, action_type_id: ua.NodeId, body: Any) -> bool:
        """See asyncua."""
        allowed = action_type_id != _WRITE and super().check_validity(user, action_type_id, body)
        self.refused += not allowed
        return bool(allowed)


class Clients:
    """Identifies clients by the certificate of their channel, if certificates are configured.

    Args:
        trusted: certificates as DER; ``None``: every client is served.
    """

    def __init__(self, trusted: Collection[bytes] | None) -> None:
        self._trusted = trusted

    def get_user(
        self,
        iserver: InternalServer,
        username: str | None = None,
        password: str | None = None,
        certificate: Any = None,
    ) -> User | None:
        """See asyncua: ``None`` refuses the session. A channel without security has no certificate.

        asyncua opens one even where only encrypted ones are offered, and does not check requests on
        it.
        """
        if self._trusted is not None and certificate not in self._trusted:
            return None
        return User(role=UserRole.User)


class Subscriptions(SubscriptionService):
    """Subscriptions whose number, rate, items and queues are limited."""

    async def create_subscription(self, params: Any, *of: Any, **named: Any) -> Any:
        """See asyncua."""
        interval_ms = params.RequestedPublishingInterval
        if not interval_ms >= SHORTEST_MS:  # 0, too: as fast as values change
            params.RequestedPublishingInterval = SHORTEST_MS
        return await super().create_subscription(params, *of, **named)

    async def create_monitored_items(self, params: Any) -> Any:
        """See asyncua."""
        subscription = self.subscriptions.get(params.SubscriptionId)
        held = len(subscription.monitored_item_srv._monitored_items) if subscription else 0
        if held + len(params.ItemsToCreate) > MOST_ITEMS:
            raise ServiceError(ua.StatusCodes.BadTooManyMonitoredItems)
        for item in params.ItemsToCreate:
            _check_filter(item)
        return await super().create_monitored_items(params)

    def modify_monitored_items(self, params: Any) -> Any:
        """See asyncua, which accepts any queue size here."""
        for item in params.ItemsToModify:
            _check_filter(item)
            asked = item.RequestedParameters
            asked.QueueSize = min(asked.QueueSize or MOST_WAITING, MOST_WAITING)
        return super().modify_monitored_items(params)


def _check_filter(item: Any) -> None:
    """Refuse deadbands, with which asyncua drops the change to a bad status without a value."""
    found = item.RequestedParameters.Filter
    if getattr(found, "DeadbandType", ua.DeadbandType.None_) != ua.DeadbandType.None_:
        raise ServiceError(ua.StatusCodes.BadMonitoredItemFilterUnsupported)


class LimitedServer(InternalServer):
    """asyncua's server with these limits.

    Args:
        trusted: see ``Clients``.
    """

    def __init__(self, trusted: Collection[bytes] | None) -> None:
        super().__init__(user_manager=Clients(trusted))
        self.supported_tokens = (ua.AnonymousIdentityToken,)
        self.allow_remote_admin = False
        self.subscription_service = Subscriptions(self.aspace, iserver=self)
        self.isession.subscription_service = self.subscription_service
        self.max_connections = 2 * MOST  # until ``shed`` has looked
        self.max_subscriptions = MOST_SUBSCRIPTIONS
        self.max_pending_activation_seconds = ACTIVATED_S
        self.max_session_timeout_ms = SESSION_MS
        self.max_unacked_messages_per_subscription = MOST_WAITING
        self.max_monitored_item_queue_size = MOST_WAITING
        self.max_pending_messages_per_connection = MOST_WAITING

    def create_session(
        self,
        name: str,
        user: User = NOBODY,
        external: bool = False,
    ) -> InternalSession:
        """See asyncua; allow one session for each connection, named after its address."""
        if external and any(name == each.name for each in self._external_sessions.values()):
            raise ServiceError(ua.StatusCodes.BadTooManySessions)
        return super().create_session(name, user, external)

    def register_server(self, server: Any, conf: Any = None) -> None:
        """Refuse: this is not a discovery server."""
        raise ServiceError(ua.StatusCodes.BadServiceUnsupported)


def shed(clients: list[OPCUAProtocol]) -> tuple[int, int]:
    """Close connections with too much unread or sent data, and those above ``MOST``.

    Returns:
        Numbers of closed connections for these two reasons.
    """
    slow = [each for each in clients if _held(each) > MOST_BYTES]
    rest = sorted((each for each in clients if each not in slow), key=_active_s)
    over = rest[: max(0, len(rest) - MOST)]
    for each in (*slow, *over):
        if each.transport is not None:
            each.transport.abort()
    return len(slow), len(over)


def _held(client: OPCUAProtocol) -> int:
    """Number of bytes that the server buffers for a client."""
    unread = client.transport.get_write_buffer_size() if client.transport is not None else 0
    return max(unread, len(client._buffer))


def _active_s(client: OPCUAProtocol) -> float:
    """Sort key: time of the last request; connections without one come first, oldest first."""
    return getattr(client.processor, "session_last_activity", None) or 0.0
