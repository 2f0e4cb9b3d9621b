import threading
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hri_drivers.links.slots import MAX_EDGES, Budget, Slots
from hri_drivers.wires.serial import SerialTransport
from hri_drivers.wires.transport import PipeEnd, pipe
from hri_predict.base.errors import LinkError
from hri_predict.protocol.messages import (
    Acknowledge,
    Advice,
    Level,
    Pose,
    Schema,
    Status,
    Zone,
)
from hri_predict.protocol.reasons import Reason
from tests.messages import make_status


def advice(robot=0, latch=0):
    return Advice(robot=robot, level=Level.SLOW, reason=Reason.PERSON_NEAR, latch_id=latch)


def status(cycle=0):
    return make_status(people=1, cycle=cycle)


def zone(person=0, step=0):
    return Zone(person=person, step=step, horizon_s=0.1, capsules=())


def byte_pipe(capacity: int = 4096) -> tuple[PipeEnd[bytes], PipeEnd[bytes]]:
    return pipe(capacity)


# -- pipe -----------------------------------------------------------------------------------------


@given(st.lists(st.binary(min_size=1)))
def test_a_pipe_keeps_order_and_loses_nothing_it_has_room_for(units):
    a, b = byte_pipe()
    a.open()
    b.open()
    for unit in units:
        a.write(unit)
    assert b.read(0.0) == units
    assert b.read(0.0) == []
    assert (a.written, a.overflowed, a.unheard) == (len(units), 0, 0)


def test_a_full_pipe_loses_the_oldest_and_counts_them():
    a, b = byte_pipe(capacity=3)
    a.open()
    b.open()
    for unit in b"abcde":
        a.write(bytes([unit]))
    assert b.read(0.0) == [b"c", b"d", b"e"]
    assert a.overflowed == 2


def test_what_is_written_to_nobody_is_counted():
    a, b = byte_pipe()
    a.open()
    a.write(b"x")
    b.open()
    assert b.read(0.0) == []
    assert a.unheard == 1


def test_a_closed_pipe_refuses():
    a, _ = byte_pipe()
    with pytest.raises(LinkError, match="closed"):
        a.write(b"x")
    with pytest.raises(LinkError, match="closed"):
        a.read(0.0)


def test_a_pipe_wakes_the_reader():
    a, b = byte_pipe()
    a.open()
    b.open()
    got = []
    reader = threading.Thread(target=lambda: got.extend(b.read(30.0)))
    reader.start()
    a.write(b"x")
    reader.join(20.0)
    assert got == [b"x"]


# -- slots ----------------------------------------------------------------------------------------


def test_the_newest_wins_its_slot_and_returns_what_it_displaced():
    slots = Slots()
    assert slots.post(advice(0, 1)) is None
    assert slots.post(advice(1, 2)) is None
    assert slots.post(advice(0, 3)) == advice(0, 1)
    assert slots.pop() == advice(0, 3)
    assert slots.pop() == advice(1, 2)
    assert slots.pop() is None


def test_the_most_urgent_goes_first_whatever_the_order_of_posting():
    slots = Slots()
    for message in (
        Pose(person=0, step=0, horizon_s=0.1, joints=()),
        zone(),
        Schema(1, 2),
        status(),
        advice(),
    ):
        slots.post(message)
    order = [type(slots.pop()) for _ in range(5)]
    assert order == [Advice, Status, Schema, Pose, Zone]


def test_bulk_waits_when_it_may_not_go():
    slots = Slots()
    slots.post(zone())
    assert slots.pop(with_bulk=False) is None
    assert slots.pop() == zone()


def test_every_person_and_step_gets_its_turn_however_few_fit():
    slots = Slots()
    seen: list[Any] = []
    for _ in range(10):
        for person in range(2):
            for step in range(5):
                slots.post(zone(person, step))
        seen += [slots.pop() for _ in range(1)]
    assert len({(z.person, z.step) for z in seen}) == 10


def test_acknowledgements_never_displace_one_another():
    slots = Slots()
    edges = [Acknowledge(1, i) for i in range(1, MAX_EDGES + 1)]
    assert [slots.post(e) for e in edges] == [None] * MAX_EDGES
    assert [slots.pop() for _ in edges] == edges


def test_a_message_put_back_goes_next_unless_a_newer_one_is_there():
    slots = Slots()
    slots.post(advice(0, 1))
    slots.post(advice(1))
    taken = slots.pop()
    assert taken is not None
    assert slots.put_back(taken)
    assert slots.pop() == taken
    slots.post(advice(0, 2))
    assert not slots.put_back(taken)
    assert len(slots) == 2


@given(st.lists(st.tuples(st.integers(0, 3), st.integers(0, 100)), max_size=60))
def test_slots_hold_the_last_of_each_subject(posts):
    slots, displaced = Slots(), 0
    for robot, latch in posts:
        displaced += slots.post(advice(robot, latch)) is not None
    newest = dict(posts)
    held: list[Any] = [slots.pop() for _ in range(len(slots))]
    assert {m.robot: m.latch_id for m in held} == newest
    assert displaced == len(posts) - len(newest)


# -- the bulk's budget ----------------------------------------------------------------------------


@given(st.lists(st.floats(0.0001, 0.02), min_size=1, max_size=200))
def test_bulk_never_takes_more_than_its_share(sizes):
    """Over any time since the start: at most one burst plus the rate times the time."""
    budget, used = Budget(rate=0.2, depth_s=0.03), 0.0
    for tick, size in enumerate(sizes):
        now_ns = tick * 10_000_000
        if budget.fits(size, now_ns):
            budget.spend(size)
            used += size
        assert used <= 0.03 + 0.2 * now_ns * 1e-9 + 1e-9


def test_a_link_without_room_carries_no_bulk():
    assert not Budget(rate=0.0, depth_s=0.03).fits(0.001, 0)


# -- serial transport -----------------------------------------------------------------------------


def test_serial_over_a_url_carries_bytes():
    transport = SerialTransport("loop://", 115_200)
    transport.open()
    transport.write(b"abc\0")
    data = b""
    while len(data) < 5:
        chunks = transport.read(5.0)
        assert chunks
        data += b"".join(chunks)
    assert data == b"\0abc\0"  # whatever the other side holds ends first
    assert transport.read(0.0) == []
    transport.close()
    transport.close()
    with pytest.raises(LinkError, match="closed"):
        transport.write(b"x")


@pytest.mark.parametrize(
    ("port", "words"),
    [
        ("/dev/no_such_port", "not found; plug it in or correct 'port'"),
        ("lop://", "pyserial does not support"),
        ("socket://127.0.0.1:1", "refused"),
        ("/etc/hostname", "not a serial device; correct 'port'"),
    ],
)
def test_a_port_that_does_not_open_gets_one_line_with_the_remedy(port, words):
    with pytest.raises(LinkError) as caught:
        SerialTransport(port, 115_200).open()
    text = str(caught.value)
    assert text.startswith(f"serial port {port}: ")
    assert words in text
    assert "\n" not in text
