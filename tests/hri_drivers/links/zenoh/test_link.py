"""The zenoh link over real sessions on loopback: keys, taking, cut and healed connections."""

import json
import subprocess
import sys
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from pydantic import ValidationError

from hri_drivers.links.zenoh.link import ZenohLink, ZenohLinkSettings
from hri_drivers.wires.transport import pipe
from hri_drivers.wires.zenoh import ZenohTransport
from hri_drivers.wires.zenoh_session import ZenohSettings, open_session, session_config
from hri_predict.base.clock import MonotonicClock, VirtualClock
from hri_predict.base.errors import ConfigError, LinkError
from hri_predict.protocol.keyed import Keyed, KeyedReceiver, KeyedSender
from hri_predict.protocol.messages import (
    Acknowledge,
    Advice,
    Level,
    Message,
    NodeState,
    Schema,
    Status,
)
from hri_predict.protocol.reasons import Reason
from hri_sim.faults.link_faults import FaultyTransport
from tests.messages import make_state
from tests.waiting import eventually, free_port

STATUS = Status(node_state=NodeState.RUNNING, reason=Reason.NONE, people=1, predictor=0, cycle=7)
STATE = make_state((0.5,) * 6, counter=4711)


def posted_until(link: ZenohLink, message: Message, condition: Callable[[], Any]) -> None:
    """Post as a node does, again and again: a subscription takes a moment to become known."""

    def posted() -> Any:
        link.post(message)
        return condition()

    eventually(posted)


@pytest.fixture
def endpoint() -> str:
    return f"tcp/127.0.0.1:{free_port()}"


@pytest.fixture
def router(endpoint: str) -> Iterator[Any]:
    session = open_session(ZenohSettings(mode="router", listen=[endpoint]))
    yield session
    session.close()


def make_link(endpoint: str, **settings: Any) -> ZenohLink:
    model = ZenohLinkSettings(name="fleet", cell="press", connect=[endpoint], **settings)
    return ZenohLink(model, MonotonicClock())


class Peer:
    """What is at the other end: a controller, or whoever looks."""

    def __init__(self, endpoint: str, *heard: str) -> None:
        self.transport = ZenohTransport(
            ZenohSettings(connect=[endpoint]), "hri/site/press/", heard or ("**",)
        )
        self.transport.open()
        self.receiver = KeyedReceiver()
        self.messages: list[Message] = []

    def say(self, *units: Keyed) -> None:
        """Write, once it is known that somebody else hears."""
        zenoh, session = pytest.importorskip("zenoh"), self.transport._session
        assert session is not None
        for unit in units:
            publisher = session.declare_publisher(
                f"hri/site/press/{unit.key}", allowed_destination=zenoh.Locality.REMOTE
            )
            eventually(lambda p=publisher: p.matching_status.matching)  # type: ignore[misc]
            self.transport.write(unit)

    def heard(self, kind: type) -> bool:
        for unit in self.transport.read(0.05):
            self.messages += self.receiver.feed(unit)
        return any(isinstance(m, kind) for m in self.messages)


def test_what_is_posted_is_heard_and_what_controllers_say_is_taken(
    router: Any, endpoint: str
) -> None:
    link, peer, sender = make_link(endpoint, take=True), Peer(endpoint), KeyedSender()
    link.start()
    try:
        peer.say(sender.encode(STATE), sender.encode(Acknowledge(5, 9)))
        eventually(lambda: link.counters.messages_received == 2)
        assert [r.message for r in link.take()] == [STATE, Acknowledge(5, 9)]
        for told in (
            Schema(1, 2),
            STATUS,
            Advice(robot=0, level=Level.SLOW, reason=Reason.PERSON_NEAR),
        ):
            posted_until(link, told, lambda m=told: peer.heard(type(m)))  # type: ignore[misc]
        advice = next(m for m in peer.messages if isinstance(m, Advice))
        assert advice.echo == STATE.counter
    finally:
        link.stop()
        peer.transport.close()


def test_nothing_is_taken_unless_configured(router: Any, endpoint: str) -> None:
    link, peer, sender = make_link(endpoint), Peer(endpoint), KeyedSender()
    link.start()
    try:
        peer.transport.write(sender.encode(STATE))
        posted_until(
            link, STATUS, lambda: peer.heard(Status)
        )  # so what was sent before has had its time
        assert link.take() == []
        assert link.counters.bytes_received == 0
    finally:
        link.stop()
        peer.transport.close()


def test_what_is_no_message_of_its_key_is_counted(router: Any, endpoint: str) -> None:
    link, peer, sender = make_link(endpoint, take=True), Peer(endpoint), KeyedSender()
    link.start()
    try:
        state = sender.encode(STATE).data
        junk = (Keyed("state/0", data) for data in (b"junk" * 9, b"\0", b"x" * 40_000))
        peer.say(Keyed("ack", state), *junk, Keyed("state/0", state))
        eventually(lambda: link.counters.messages_received == 1)
        assert link.counters.malformed == 4
    finally:
        link.stop()
        peer.transport.close()


@pytest.mark.realtime
def test_a_router_that_goes_and_comes_is_lost_and_found(endpoint: str) -> None:
    link = make_link(endpoint)
    link.start()  # nobody is there yet: no cell waits for a router
    try:
        assert not link.connected
        assert link.last_error is not None
        assert endpoint in link.last_error
        for times in (0, 1):
            router = open_session(ZenohSettings(mode="router", listen=[endpoint]))
            eventually(lambda: link.connected)
            assert link.counters.reconnects == times
            peer = Peer(endpoint)
            posted_until(link, STATUS, lambda p=peer: p.heard(Status))  # type: ignore[misc]
            peer.transport.close()
            router.close()
            eventually(lambda: not link.connected)
            assert link.counters.disconnects == times + 1
    finally:
        link.stop()


def test_peers_need_no_router(endpoint: str) -> None:
    settings = ZenohLinkSettings(
        name="fleet", cell="press", mode="peer", listen=[endpoint], connect=[]
    )
    link = ZenohLink(settings, MonotonicClock())
    link.start()
    peer = Peer(endpoint)
    try:
        assert link.connected  # who listens waits for nobody
        posted_until(link, STATUS, lambda: peer.heard(Status))
    finally:
        link.stop()
        peer.transport.close()


def test_nobody_there_is_an_error_that_names_the_endpoint(endpoint: str) -> None:
    link = make_link(endpoint, wait_for_device=False)
    with pytest.raises(LinkError, match=rf"link 'fleet': zenoh {endpoint}: no answer; start"):
        link.start()


def test_a_missing_file_of_zenohs_own_is_an_error_that_names_it(tmp_path: Path) -> None:
    settings = ZenohLinkSettings(name="f", cell="c", zenoh_config="no.json5")
    with pytest.raises(ConfigError, match=r"zenoh_config .*/no.json5: .*; check the path"):
        settings.resolved(tmp_path)


def test_a_file_of_zenohs_own_that_never_ends_is_refused(tmp_path: Path) -> None:
    settings = ZenohLinkSettings(name="f", cell="c", zenoh_config="/dev/zero")
    with pytest.raises(ConfigError, match=r"zenoh_config /dev/zero: longer than"):
        settings.resolved(tmp_path)


@pytest.mark.parametrize(
    ("data", "words"),
    [
        ({"cell": "a/b"}, "cell"),
        ({"cell": "a*"}, "cell"),
        ({"cell": "a", "connect": ["127.0.0.1:7447"]}, "connect"),
        ({"cell": "a", "listen": ["tcp/127.0.0.1:7447"]}, "set 'mode: peer'"),
        ({"cell": "a", "simulate": {}}, "leave 'simulate' out"),
    ],
)
def test_wrong_settings_are_refused(data: dict[str, Any], words: str) -> None:
    with pytest.raises(ValidationError, match=words):
        ZenohLinkSettings.model_validate({"name": "f"} | data)


def test_nothing_is_open_and_nobody_searched_for_unless_it_is_configured(tmp_path: Path) -> None:
    config = session_config(ZenohSettings())
    assert json.loads(config.get_json("listen/endpoints")) == []
    assert json.loads(config.get_json("connect/endpoints")) == ["tcp/127.0.0.1:7447"]
    scouting = json.loads(config.get_json("scouting"))
    assert scouting["multicast"]["enabled"] is scouting["gossip"]["enabled"] is False


def test_a_file_of_zenohs_own_is_taken_where_it_says_something(tmp_path: Path) -> None:
    file = tmp_path / "zenoh.json5"
    file.write_text(
        "{mode: 'peer', listen: {endpoints: ['tls/[::]:7447']},"
        " scouting: {gossip: {enabled: true}},"
        " transport: {link: {tls: {enable_mtls: true}}}}"
    )
    config = session_config(ZenohSettings(zenoh_config=str(file), connect=["tls/10.0.0.5:7447"]))
    assert json.loads(config.get_json("mode")) == "peer"
    assert json.loads(config.get_json("listen/endpoints")) == ["tls/[::]:7447"]
    assert json.loads(config.get_json("connect/endpoints")) == ["tls/10.0.0.5:7447"]
    assert json.loads(config.get_json("scouting/gossip/enabled")) is True
    assert json.loads(config.get_json("scouting/multicast/enabled")) is False
    assert json.loads(config.get_json("transport/link/tls/enable_mtls")) is True


def test_without_the_extra_the_error_names_it() -> None:
    code = (
        "import sys; sys.modules['zenoh'] = None\n"
        "from hri_predict import registry\n"
        "try: registry.load('links', 'zenoh')\n"
        "except Exception as error: print(error)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60)
    assert "pip install 'hri-predict[fleet]'" in done.stdout


def test_faults_can_be_injected() -> None:
    near, far = pipe()  # type: ignore[var-annotated]
    faults = [{"kind": "bit_errors", "rate": 0.01}]
    wire: FaultyTransport[Keyed] = FaultyTransport(
        inner=near, faults=faults, clock=VirtualClock(), seed=0
    )
    far.open()
    wire.open()
    sender, receiver = KeyedSender(), KeyedReceiver()
    for _ in range(20):
        wire.write(sender.encode(STATUS))
    assert 0 < sum(len(receiver.feed(unit)) for unit in far.read(0.0)) < 20
    assert receiver.counters.crc_errors > 0


def test_two_nodes_under_one_name_tell_each_other(endpoint: str, router: Any) -> None:
    one, other = make_link(endpoint), make_link(endpoint)
    alone = make_link(endpoint, take=True)
    alone._transport._prefix = "hri/site/another/"  # type: ignore[attr-defined]
    try:
        for link in (one, other, alone):
            link.start()

        def both() -> bool:
            for link, cycle in ((one, 1), (other, 2), (alone, 3)):
                link.post(replace(STATUS, cycle=cycle))
            return one.foreign_ns is not None and other.foreign_ns is not None

        eventually(both)
        assert one.counters.foreign
        assert alone.foreign_ns is None, "its own messages do not come back"
    finally:
        for link in (one, other, alone):
            link.stop()
