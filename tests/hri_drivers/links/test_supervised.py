"""What every link does, over every transport: the same checks back to back."""

import itertools
from asyncio import CancelledError
from dataclasses import replace
from typing import Any

import pytest

from hri_drivers.links.can.link import CanLinkSettings
from hri_drivers.links.serial.link import SerialLink, SerialLinkSettings
from hri_drivers.wires.transport import pipe
from hri_predict.base.clock import MonotonicClock, VirtualClock
from hri_predict.protocol.messages import (
    Acknowledge,
    Advice,
    NodeState,
    Schema,
    Status,
    Zone,
)
from hri_predict.protocol.reasons import Reason
from hri_predict.protocol.serial import SerialReceiver, SerialSender
from tests.hri_drivers.links.pairs import (
    REAL_TIME,
    STATUS,
    VIRTUAL_TIME,
    Pair,
    Peer,
    advice,
    make,
    robot_state,
    take_into,
    zone,
)
from tests.messages import make_status
from tests.waiting import eventually


@pytest.fixture(params=REAL_TIME)
def pair(request):
    pair = make(request.param, MonotonicClock())
    pair.peer.start()
    pair.link.start()
    if request.param.startswith("slcan"):
        eventually(lambda: pair.peer.transport.channel_open)
    yield pair
    pair.link.stop()
    pair.peer.stop()


# -- real time, real threads ----------------------------------------------------------------------


def test_messages_pass_both_ways(pair):
    pair.link.post(advice(5))
    pair.link.post(STATUS)
    pair.link.post(Schema(1, 2))
    eventually(lambda: len(pair.peer.heard) >= 3)
    assert {type(m) for m in pair.peer.heard} == {Advice, Status, Schema}
    assert pair.peer.heard_of(Advice)[0].latch_id == 5

    received: list[Any] = []
    pair.peer.say(robot_state(9))
    pair.peer.say(Acknowledge(5, 77))
    eventually(lambda: take_into(received, pair.link) == 2)
    assert received[0].message == robot_state(9)
    assert received[1].message == Acknowledge(5, 77)
    assert 0 < received[0].received_ns <= received[1].received_ns
    counters = pair.link.counters
    assert (counters.messages_sent, counters.messages_received) == (3, 2)
    assert counters.crc_errors == counters.counter_errors == counters.malformed == 0
    assert counters.write_errors == 0


def test_advice_echoes_the_last_robot_state_of_its_robot(pair):
    pair.peer.say(robot_state(41, robot=0))
    pair.peer.say(robot_state(42, robot=1))
    received: list[Any] = []
    eventually(lambda: take_into(received, pair.link) == 2)
    for robot in range(3):
        pair.link.post(advice(robot=robot))
    eventually(lambda: len(pair.peer.heard_of(Advice)) == 3)
    echoes = {m.robot: m.echo for m in pair.peer.heard_of(Advice)}
    assert echoes == {0: 41, 1: 42, 2: None}


def test_the_age_is_that_at_encoding(pair):
    captured_ns = MonotonicClock().now_ns() - 300_000_000
    pair.link.post(advice(capture_ns=captured_ns))
    eventually(lambda: pair.peer.heard)
    waited_s = (MonotonicClock().now_ns() - captured_ns) * 1e-9
    assert 0.3 <= pair.peer.heard[0].age_s <= waited_s + 0.001


def test_the_last_word_leaves_before_the_link_closes(pair):
    last = make_status(node_state=NodeState.STOPPING, reason=Reason.STOPPING)
    pair.link.post(last)
    pair.link.post(advice(1))
    pair.link.stop()
    pair.link.stop()
    assert not pair.link.connected
    eventually(lambda: len(pair.peer.heard) == 2)
    assert pair.peer.heard_of(Status)[0].node_state is NodeState.STOPPING


def test_many_messages_arrive_in_order_or_are_counted(pair):
    """Newest wins: nothing arrives twice or out of order, and what is missing was superseded."""
    for latch_id in range(1, 301):
        pair.link.post(advice(latch_id))
    eventually(lambda: pair.peer.heard and pair.peer.heard[-1].latch_id == 300)
    got = [m.latch_id for m in pair.peer.heard]
    assert got == sorted(set(got))
    assert len(got) + pair.link.counters.superseded == 300
    assert pair.link.counters.messages_sent == len(got)


@pytest.mark.parametrize("method", ["read", "write"])
def test_a_driver_that_raises_whatever_it_likes_is_opened_again(monkeypatch, method):
    pair = make("serial pty", MonotonicClock())
    raised: list[bool] = []
    own = getattr(pair.link._transport, method)

    def fails_once(*arguments):
        if not raised:
            raised.append(True)
            raise CancelledError("in its own loop")
        return own(*arguments)

    monkeypatch.setattr(pair.link._transport, method, fails_once)
    pair.peer.start()
    pair.link.start()
    pair.link.post(STATUS)
    eventually(lambda: raised and pair.link.connected)
    pair.link.post(advice(1))
    eventually(lambda: pair.peer.heard_of(Advice))
    assert pair.link.last_error == "CancelledError: in its own loop"
    pair.link.stop()
    pair.peer.stop()


# -- the virtual clock ----------------------------------------------------------------------------


@pytest.mark.parametrize("kind", VIRTUAL_TIME)
def test_on_the_virtual_clock_service_does_it_all(kind):
    clock = VirtualClock(1_000_000_000)
    pair = make(kind, clock)
    pair.peer.transport.open()
    link = pair.link
    link.service(clock.now_ns())
    assert link.connected
    pair.peer.say(robot_state(3))
    link.post(advice(1, capture_ns=900_000_000))
    link.post(advice(2, capture_ns=900_000_000))
    link.service(clock.now_ns())
    pair.peer.listen()
    assert [(m.latch_id, m.echo, m.age_s) for m in pair.peer.heard] == [(2, 3, 0.1)]
    assert [r.received_ns for r in link.take()] == [1_000_000_000]
    assert link.counters.superseded == 1
    link.post(STATUS)
    link.stop()
    pair.peer.listen()
    assert isinstance(pair.peer.heard[-1], Status)


@pytest.mark.parametrize("kind", ["serial pipe", "can pipe fd"])
def test_zones_take_only_the_room_that_is_left(kind):
    clock = VirtualClock()
    pair = make(kind, clock)
    link = pair.link
    pair.peer.transport.open()
    ticks, steps = 100, 25
    for tick in range(ticks):
        clock.advance_to(tick * 40_000_000)
        link.post(advice(tick % 60_000))
        for person, step in itertools.product(range(8), range(steps)):
            link.post(zone(person, step, clock.now_ns(), segments=17))
        link.service(clock.now_ns())
        pair.peer.listen()
        assert isinstance(pair.peer.heard_of(Advice)[-1], Advice)
        assert pair.peer.heard_of(Advice)[-1].latch_id == tick
    zones = pair.peer.heard_of(Zone)
    load = type(link).load(link_settings(kind), 25.0, (0,))
    codec = link._codec
    per_zone = codec.worst_s(zone(segments=17))
    frames_of_zone = 6
    sent_s = len(zones) / frames_of_zone * per_zone
    assert sent_s <= load.spare * ticks * 0.04 + link._bulk.budget.depth_s
    assert sent_s >= 0.8 * load.spare * ticks * 0.04
    assert len({(z.person, z.step) for z in zones}) == 8 * steps  # everybody's turn comes
    assert link.counters.decimated > 0
    assert link.counters.superseded == 0
    # Whatever was posted was written, displaced, or still waits.
    posted = ticks * (1 + 8 * steps)
    counters = link.counters
    assert counters.messages_sent + counters.decimated + len(link._slots) == posted


def test_a_link_without_zones_carries_none_and_is_never_blocked_by_one():
    clock = VirtualClock()
    settings = SerialLinkSettings(name="cell", port="pipe", zones=False)
    near, far = pipe()  # type: ignore[var-annotated]
    pair = Pair(SerialLink(settings, clock, near), Peer(far, SerialSender(), SerialReceiver()))
    pair.peer.transport.open()
    pair.link.post(zone())
    pair.link.post(advice())
    pair.link.service(clock.now_ns())
    pair.peer.listen()
    assert [type(message) for message in pair.peer.heard] == [Advice]
    assert pair.link.counters.decimated == 1
    assert settings.blocking_s == 0.0 < settings.model_copy(update={"zones": True}).blocking_s


def test_in_real_time_an_advice_waits_for_one_frame_of_a_zone_at_most():
    """At 115200 baud a whole Zone takes 37 ms of wire; nothing urgent may wait that long."""
    clock, (near, far) = VirtualClock(), pipe()  # type: ignore[var-annotated]
    settings = SerialLinkSettings(name="cell", port="pipe", baudrate=115_200)
    link = SerialLink(settings, clock, near)
    far.open()
    link.service(0)
    receiver, wire_free_ms, waits, zones = SerialReceiver(), 0.0, [], 0
    for ms in range(2000):
        clock.advance_to(ms * 1_000_000)
        if ms % 40 == 0:
            for step in range(25):
                link.post(zone(0, step, clock.now_ns(), segments=17))
        if ms % 40 == 13:
            link.post(advice(ms))
        link._drain(clock.now_ns, paced=True)
        for unit in far.read(0.0):
            for message in receiver.feed(unit):
                if isinstance(message, Advice):
                    waits.append(max(0.0, wire_free_ms - ms))
                zones += isinstance(message, Zone)
            wire_free_ms = max(ms, wire_free_ms) + len(unit) * 10 / 115.2
    longest = len(SerialSender().encode(zone(segments=3))) * 10 / 115.2
    assert len(waits) == 50
    assert max(waits) > 0
    assert max(waits) <= 2 + longest
    assert zones > 100  # and yet zones are carried
    assert link.counters.messages_sent >= 50 + zones // 6


def link_settings(kind: str) -> Any:
    if kind.startswith("serial"):
        return SerialLinkSettings(name="cell", port="pipe", baudrate=921_600)
    return CanLinkSettings(name="cell", interface="virtual", channel="x", fd=True)


def test_classic_can_does_not_carry_zones_and_counts_them():
    clock = VirtualClock()
    link = make("can pipe", clock).link
    link.post(zone())
    link.service(0)
    assert link.counters.decimated == 1
    assert link.counters.messages_sent == 0


def test_a_stale_zone_is_not_written():
    clock = VirtualClock(10_000_000_000)
    link = make("serial pipe", clock).link
    link.post(zone(capture_ns=9_000_000_000))
    link.service(clock.now_ns())
    assert (link.counters.decimated, link.counters.messages_sent) == (1, 0)


def test_a_value_that_no_field_holds_costs_that_message_alone():
    link = make("serial pipe", VirtualClock()).link
    link.post(advice(robot=9))
    link.post(STATUS)
    link.service(0)
    assert link.connected
    assert (link.counters.messages_sent, link.counters.write_errors) == (1, 1)
    assert "robot 9" in str(link.last_error)


@pytest.mark.parametrize("error", [ValueError("no room"), OverflowError("no room")])
def test_a_value_that_is_no_integer_costs_that_message_alone(monkeypatch, error):
    link = make("serial pipe", VirtualClock()).link
    encode = link._codec.encode

    def encoded(message):
        if isinstance(message, Advice):
            raise error
        return encode(message)

    monkeypatch.setattr(link._codec, "encode", encoded)
    link.post(advice())
    link.post(STATUS)
    link.service(0)
    assert link.connected
    assert (link.counters.messages_sent, link.counters.write_errors) == (1, 1)
    assert link.last_error == "no room"


def test_an_inbox_that_nobody_empties_keeps_every_acknowledge():
    pair = make("serial pipe", VirtualClock())
    pair.link.service(0)
    pair.peer.transport.open()
    pair.peer.say(Acknowledge(1, 1))
    for n in range(400):
        pair.peer.say(robot_state(n % 256))
    pair.link.service(0)
    received = [r.message for r in pair.link.take()]
    assert received[0] == Acknowledge(1, 1)
    assert received[-1] == robot_state(399 % 256)
    assert len(received) + pair.link.counters.overrun == 401


@pytest.mark.parametrize("kind", VIRTUAL_TIME)
def test_what_another_node_sends_with_our_ids_is_foreign_and_no_controllers(kind):
    pair = make(kind, VirtualClock())
    pair.link.service(0)
    assert pair.link.foreign_ns is None
    pair.peer.transport.open()
    for _ in range(2):
        pair.peer.say(advice())
    pair.link.service(7)
    assert pair.link.take() == []
    assert pair.link.counters.foreign >= 2
    assert pair.link.counters.unexpected == 0
    assert pair.link.foreign_ns == 7
    assert "another sender uses this node's ids" in str(pair.link.last_error)


@pytest.mark.parametrize("kind", VIRTUAL_TIME)
def test_an_echo_of_what_we_sent_is_not_foreign(kind):
    pair = make(kind, VirtualClock())
    pair.peer.transport.open()
    for k in range(30):
        pair.link.post(replace(advice(), latch_id=k))
        pair.link.service(k)
        for unit in pair.peer.transport.read(0.0):
            pair.peer.transport.write(unit)
    pair.link.service(30)
    assert pair.link.take() == []
    assert pair.link.counters.echoes >= 30
    assert pair.link.counters.unexpected == 0
    assert pair.link.counters.foreign == 0
    assert pair.link.foreign_ns is None


def test_the_recorder_hears_every_unit_that_was_written():
    pair = make("can pipe", VirtualClock())
    heard = []
    pair.link.on_sent = lambda name, raw, now_ns: heard.append((name, raw, now_ns))
    pair.link.post(advice())
    pair.link.service(5)
    assert [(name, len(raw), now_ns) for name, raw, now_ns in heard] == [("cell", 12, 5)] * 3
