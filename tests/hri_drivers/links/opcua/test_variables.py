"""The register map as variables: every register once, and nothing stale that looks good."""

import asyncio
import time
from datetime import UTC, datetime
from types import SimpleNamespace
from typing import Any

import pytest

pytest.importorskip("asyncua", reason="asyncua is not installed: the link cannot be used")
from asyncua import ua

from hri_drivers.links.opcua import limits, messages
from hri_drivers.links.opcua.variables import Variables
from hri_drivers.links.plant.codec import RegisterCodec
from hri_drivers.links.plant.image import Block, Image
from hri_predict.protocol.registers import NEAREST, NODE, ROBOT, SETS
from hri_predict.protocol.variables import LEFT_OUT, variables
from tests.hri_drivers.links.plant.test_codec import ADVICE, STATUS

MS = 1_000_000


def test_each_register_of_the_node_is_one_variable():
    found = [(each.node_id, each.type) for each in variables([2])]
    names = [f"Node.{r.name}" for r in NODE + SETS if r.name not in LEFT_OUT]
    names += [f"Robots.2.{r.name}" for r in ROBOT + NEAREST]
    assert [name for name, _ in found] == names
    types = dict(found)
    assert types["Robots.2.LEVEL"] == "UInt16"
    assert types["Robots.2.POSTED"] == "UInt32"
    assert types["Robots.2.NEAREST_ANGLE"] == "Int16"


class Written:
    """asyncua's server, as far as values are written."""

    def __init__(self) -> None:
        self.values: dict[str, Any] = {}

    async def write_attribute_value(self, node_id: Any, value: Any) -> None:
        self.values[node_id.Identifier] = value


@pytest.fixture
def shown():
    """Blocks of STATUS and ADVICE, put at a time; what is shown ``later_ms`` after it."""
    codec = RegisterCodec()
    codec.stand([1], [None])
    blocks = [block for message in (STATUS, ADVICE) for block in codec.encode(message)]

    def show(later_ms: float, posted: bool = True) -> dict[str, Any]:
        server = Written()
        made = Variables(server, Image(silence_s=0.06, max_age_s=0.4), [1])
        now_ns = time.monotonic_ns()
        for block in blocks if posted else ():
            made.put(block, now_ns)
        asyncio.run(made.refresh(now_ns + round(later_ms * MS)))
        return server.values

    return show


def test_fresh_values_are_good_and_dated_by_the_capture(shown):
    found = shown(1.0)
    level = found["Robots.1.LEVEL"]
    assert (level.StatusCode.name, level.Value.Value) == ("Good", 3)
    age_s = (datetime.now(UTC) - level.SourceTimestamp).total_seconds()
    assert 0.0801 <= age_s < 0.5  # the advice's age, and what the test took
    assert found["Robots.1.SPEED_LIMIT"].Value.VariantType == ua.VariantType.UInt16
    assert found["Node.HEARTBEAT"].StatusCode.name == "Good"


@pytest.mark.parametrize("later_ms", [60.0, 61.0, 1e6])
def test_silent_values_are_bad_and_counters_stand_still(shown, later_ms):
    found = shown(later_ms)
    assert found["Robots.1.LEVEL"].StatusCode.name == "BadNoCommunication"
    assert found["Robots.1.LEVEL"].Value.Value == 0
    assert found["Robots.1.SPEED_LIMIT"].Value.Value == 0
    for name in ("Node.HEARTBEAT", "Robots.1.ADVICE_COUNTER"):
        assert found[name].StatusCode.name == "UncertainLastUsableValue"
        assert found[name].Value.Value == 1
    assert not [n for n, v in found.items() if v.StatusCode.is_good()]


def test_before_the_first_message_nothing_is_good(shown):
    found = shown(0.0, posted=False)
    assert {v.StatusCode.name for v in found.values()} == {"BadWaitingForInitialData"}


def test_an_old_capture_is_bad_though_the_node_speaks(shown):
    codec = RegisterCodec()
    codec.stand([1], [None])
    server = Written()
    made = Variables(server, Image(silence_s=60.0, max_age_s=0.4), [1])
    now_ns = time.monotonic_ns()
    for block in codec.encode(ADVICE):
        made.put(block, now_ns)
    asyncio.run(made.refresh(now_ns + 330 * MS))  # the advice was 81 ms old
    assert server.values["Robots.1.LEVEL"].StatusCode.is_bad()


def test_a_message_between_the_processes_is_the_block_and_its_time():
    block = Block.of(100, [1, 2, 65535])
    assert messages.unpacked_block(messages.packed_block(block, 12345)) == (block, 12345)
    counts = messages.COUNTS + messages.number(7) + messages.number(9)
    assert (messages.number_of(counts), messages.number_of(counts, 1)) == (7, 9)


# -- what clients may do and cost ------------------------------------------------------------------


def test_only_trusted_certificates_have_a_session():
    open_, closed = limits.Clients(None), limits.Clients([b"known"])
    server: Any = None
    assert open_.get_user(server, username="admin") == limits.User(limits.UserRole.User)
    assert closed.get_user(server, certificate=b"known") == limits.User(limits.UserRole.User)
    for unknown in (None, b"", b"other"):  # no certificate: a channel without security
        assert closed.get_user(server, username="admin", certificate=unknown) is None


def test_nothing_may_be_written():
    rules = limits.Rules()
    user = limits.User(role=limits.UserRole.User)
    ids = ua.ObjectIds
    for name in ("Write", "AddNodes", "DeleteNodes"):
        asked = ua.NodeId(getattr(ids, f"{name}Request_Encoding_DefaultBinary"))
        assert not rules.check_validity(user, asked, None)
    assert rules.refused == 3
    assert rules.check_validity(user, ua.NodeId(ids.CallRequest_Encoding_DefaultBinary), None)
    assert rules.check_validity(user, ua.NodeId(ids.ReadRequest_Encoding_DefaultBinary), None)
    assert rules.refused == 3


def asked_items(count: int, **changes: Any) -> Any:
    asked = SimpleNamespace(QueueSize=0, Filter=None, SamplingInterval=1.0, **changes)
    item = SimpleNamespace(RequestedParameters=asked, MonitoredItemId=1)
    return SimpleNamespace(
        SubscriptionId=1, ItemsToCreate=[item] * count, ItemsToModify=[item] * count
    )


def test_items_of_a_subscription_are_limited():
    async def ask() -> None:
        service = limits.LimitedServer(None).subscription_service
        await service.create_monitored_items(asked_items(limits.MOST_ITEMS + 1))

    with pytest.raises(limits.ServiceError) as refused:
        asyncio.run(ask())
    assert refused.value.code == ua.StatusCodes.BadTooManyMonitoredItems


def test_a_deadband_would_hide_a_bad_status_and_is_refused():
    asked = asked_items(1)
    asked.ItemsToCreate[0].RequestedParameters.Filter = ua.DataChangeFilter(
        DeadbandType=ua.DeadbandType.Absolute, DeadbandValue=10.0
    )
    for way in ("create_monitored_items", "modify_monitored_items"):

        async def ask(way: str = way) -> None:
            found = getattr(limits.LimitedServer(None).subscription_service, way)(asked)
            await found

        with pytest.raises(limits.ServiceError) as refused:
            asyncio.run(ask())
        assert refused.value.code == ua.StatusCodes.BadMonitoredItemFilterUnsupported


@pytest.mark.parametrize("asked_ms", [0.0, -1.0, 0.001, float("nan")])
def test_no_publishing_interval_is_too_short(asked_ms):
    async def ask() -> Any:
        server = limits.LimitedServer(None)
        params = ua.CreateSubscriptionParameters(RequestedPublishingInterval=asked_ms)
        made = await server.subscription_service.create_subscription(params, None, ua.NodeId(1))
        await server.subscription_service.delete_subscriptions([made.SubscriptionId])
        return made

    assert asyncio.run(ask()).RevisedPublishingInterval == limits.SHORTEST_MS


def test_a_connection_has_one_session_and_no_one_registers_servers():
    async def ask() -> None:
        server = limits.LimitedServer(None)
        server.create_session("1.2.3.4:5", external=True)
        with pytest.raises(limits.ServiceError):
            server.create_session("1.2.3.4:5", external=True)
        server.create_session("1.2.3.4:6", external=True)
        with pytest.raises(limits.ServiceError):
            server.register_server(None)

    asyncio.run(ask())


def a_client(unread: int = 0, sent: int = 0, active_s: float | None = None) -> Any:
    ended: list[int] = []
    transport = SimpleNamespace(get_write_buffer_size=lambda: unread, abort=lambda: ended.append(1))
    processor = SimpleNamespace(session_last_activity=active_s)
    return SimpleNamespace(
        transport=transport, processor=processor, _buffer=b"x" * sent, ended=ended
    )


def test_connections_that_cost_too_much_end():
    slow, large = a_client(limits.MOST_BYTES + 1), a_client(sent=limits.MOST_BYTES + 1)
    active = [a_client(active_s=10.0 + k) for k in range(limits.MOST)]
    assert limits.shed([slow, *active, large]) == (2, 0)
    assert slow.ended
    assert large.ended
    idle = [a_client() for _ in range(3)]
    assert limits.shed([*active, *idle]) == (0, 3)
    assert all(each.ended for each in idle)  # those that never asked go first
    assert not any(each.ended for each in active)
    assert limits.shed([*active, a_client(active_s=99.0)]) == (0, 1)
    assert active[0].ended
