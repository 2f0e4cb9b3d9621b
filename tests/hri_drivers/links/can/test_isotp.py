"""Zone and Pose by ISO-TP: what a peer may do to us, and what a listener makes of it."""

import dataclasses
import json
import re
import subprocess
import sys
import threading
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hri_drivers.links.can import isotp as can_isotp
from hri_drivers.links.can.isotp import IsoTpReceiver, IsoTpTransfer, isotp_bits
from hri_drivers.links.can.link import CanLink, CanLinkSettings
from hri_drivers.links.can.transport import CanTransport
from hri_drivers.wires.backoff import FIRST_S, LAST_S
from hri_drivers.wires.transport import pipe
from hri_predict.base.clock import VirtualClock
from hri_predict.base.errors import ConfigError, LinkError
from hri_predict.cli.listen import listen
from hri_predict.protocol.can import CanFrame, CanReceiver
from hri_predict.protocol.definition import SCHEMA_HASH, SCHEMA_VERSION
from hri_predict.protocol.generate.isotp import EXAMPLE
from hri_predict.protocol.messages import (
    Advice,
    Level,
    Pose,
    Schema,
    Zone,
    ZoneCapsule,
)
from hri_predict.protocol.profile4 import MAX_WHOLE, Profile4Receiver, Profile4Sender
from hri_predict.protocol.reasons import Reason
from hri_sim.wires.slcan_adapter import SlcanAdapter, open_pty
from tests.hri_drivers.links.can.can_pairs import connected
from tests.messages import make_status
from tests.waiting import eventually

OWN, PEER = 0x6C6, 0x6C7
GO_ON = CanFrame(PEER, b"\x30\x00\x00")
PROTOCOL = Path(__file__).resolve().parents[4] / "drivers" / "PROTOCOL.md"
FRAMES = st.binary(max_size=8).map(lambda data: CanFrame(OWN, data))


def zone(capsules: int = 21, step: int = 2, capture_ns: int | None = None) -> Zone:
    one = ZoneCapsule(3, (0.5, -1.0, 0.25), (1.0, 2.0, 3.0), 0.125)
    return Zone(
        person=7,
        step=step,
        horizon_s=0.08,
        capsules=(one,) * capsules,
        age_s=None if capture_ns else 0.02,
        capture_ns=capture_ns,
    )


def segments(message: Any, sender: Profile4Sender | None = None) -> list[CanFrame]:
    """All frames of a message whose peer lets everything go."""
    (whole,) = (sender or Profile4Sender(255)).encode(message)
    transfer = IsoTpTransfer(OWN, PEER, False)
    transfer.begin(whole, 0)
    frames = transfer.frames(0)
    transfer.feed(GO_ON)
    return frames + transfer.frames(0)


class Link:
    """A link on the virtual clock, and the frames that it writes."""

    def __init__(self, **more: Any) -> None:
        self.clock = VirtualClock()
        near, self.far = pipe()  # type: ignore[var-annotated]
        made: dict[str, Any] = {"isotp": {"peer_id": PEER}} | more
        settings = CanLinkSettings(name="c", interface="virtual", channel="x", **made)
        self.link = CanLink(settings, self.clock, near)
        self.far.open()
        self.link.service(0)

    def after(self, seconds: float) -> list[CanFrame]:
        self.clock.advance_to(self.clock.now_ns() + int(seconds * 1e9))
        self.link.service(self.clock.now_ns())
        return self.far.read(0.0)


def test_the_largest_zone_fits_iso_tp():
    (whole,) = Profile4Sender(255).encode(zone(255))
    assert len(whole) == MAX_WHOLE <= 4095
    receiver = IsoTpReceiver(0x680, False, OWN)
    heard = [m for f in segments(zone(255)) for m in receiver.feed(f)]
    assert heard == [zone(255)]
    with pytest.raises(ValueError, match="at most 255"):
        Profile4Sender(255).encode(zone(256))


def test_what_a_zone_takes_of_the_wire_is_known():
    frames = segments(zone())
    assert isotp_bits(zone(), False).nominal == 135 * (len(frames) + 1)  # and flow control


def test_a_silent_peer_costs_one_frame_a_second_and_no_advice():
    pair = Link()
    first = []
    for tick in range(50):  # two seconds
        pair.link.post(zone(step=tick))
        pair.link.post(Advice(robot=0, level=Level.SLOW, reason=Reason.PERSON_NEAR, latch_id=tick))
        frames = pair.after(0.04)
        first += [f for f in frames if f.arbitration_id == OWN]
        assert len([f for f in frames if f.arbitration_id < 0x683]) == 3
    assert len(first) == 2
    assert {f.data[0] >> 4 for f in first} == {1}
    counters = pair.link.counters
    assert counters.messages_sent == 50
    assert counters.write_errors == 1
    assert "ISO-TP peer 0x6c7: it did not accept the whole message within a second" in str(
        pair.link.last_error
    )
    waiting = len(pair.link._slots) + 1
    assert counters.messages_sent + counters.write_errors + counters.decimated + waiting == 100


def test_a_peer_without_room_is_named_and_the_next_zone_tried():
    pair = Link()
    pair.link.post(zone(step=1))
    pair.link.post(zone(step=2))
    assert len(pair.after(0.0)) == 1
    pair.far.write(CanFrame(PEER, b"\x32\x00\x00"))
    assert pair.after(0.01) == []
    assert "has no room" in str(pair.link.last_error)
    assert len(pair.after(FIRST_S)) == 1  # the next one's first frame
    pair.far.write(GO_ON)
    assert len(pair.after(0.01)) == 48
    assert (pair.link.counters.messages_sent, pair.link.counters.write_errors) == (1, 1)


def test_a_peer_that_never_has_room_is_asked_ever_more_rarely():
    """Ten seconds: after 50 ms, 100 ms, ... and then every two seconds."""
    pair = Link()
    asked = []
    for tick in range(2500):  # a fast peer: it refuses at once
        pair.link.post(zone(step=tick % 250, capture_ns=pair.clock.now_ns()))
        for frame in pair.after(0.004):
            asked.append(pair.clock.now_ns() * 1e-9)
            assert frame.data[0] >> 4 == 1
            pair.far.write(CanFrame(PEER, b"\x32\x00\x00"))
    assert 6 <= len(asked) <= 10
    assert asked[-1] - asked[-2] >= LAST_S
    pair.link.post(zone(step=1, capture_ns=pair.clock.now_ns()))
    assert len(pair.after(LAST_S)) <= 1


def test_an_answer_that_comes_before_the_wire_is_free_is_not_slept_over():
    """The wire is free later by calculation, which is of the worst stuffing, than in truth."""
    pair = Link()
    link, now_ns = pair.link, pair.clock.now_ns()
    link.post(zone())
    link._drain(lambda: now_ns, paced=True)
    for robot in range(8):
        link.post(Advice(robot=robot, level=Level.SLOW, reason=Reason.PERSON_NEAR))
    link._drain(lambda: now_ns, paced=True)
    pair.far.read(0.0)
    pair.far.write(GO_ON)
    link._receive(link._transport.read(0.0), now_ns)
    link._drain(lambda: now_ns, paced=True)  # what the answer woke up; the wire is full
    assert pair.far.read(0.0) == []
    asleep_s = link._patience_s()
    assert asleep_s is not None
    assert asleep_s < 0.02
    now_ns += int(asleep_s * 1e9)
    link._drain(lambda: now_ns, paced=True)
    assert [f.arbitration_id for f in pair.far.read(0.0)][:1] == [OWN]


def test_block_size_and_wait_are_heeded():
    pair = Link()
    pair.link.post(zone())
    assert len(pair.after(0.0)) == 1
    pair.far.write(CanFrame(PEER, b"\x31\x00\x00"))  # wait
    assert pair.after(0.1) == []
    pair.far.write(CanFrame(PEER, b"\x30\x05\x00"))  # five at a time
    assert [len(pair.after(0.01)), len(pair.after(0.01))] == [5, 0]
    pair.far.write(CanFrame(PEER, b"\x30\x05\x00"))
    assert len(pair.after(0.01)) == 5


@pytest.mark.realtime
def test_the_pause_that_the_peer_asks_for_is_kept():
    with connected("virtual", answers=False, isotp={"peer_id": PEER}) as (link, controller):
        link.post(zone(1))
        eventually(lambda: len(controller.frames) == 1)
        controller.wire.write(CanFrame(PEER, b"\x30\x00\x14"))  # 20 ms
        eventually(lambda: link.counters.messages_sent == 1)
        assert len(segments(zone(1))) == len(controller.frames)


def test_a_lost_link_begins_afresh():
    pair = Link()
    pair.link.post(zone(step=1))
    pair.after(0.0)
    pair.link._lost(LinkError("unplugged"), pair.clock.now_ns())
    assert pair.link.counters.decimated == 1
    pair.link.post(zone(step=2))
    assert pair.after(1.0)[0].data[0] >> 4 == 1
    pair.far.write(GO_ON)
    assert len(pair.after(0.01)) == 48


def test_a_stale_zone_or_one_that_no_field_holds_is_not_begun():
    pair = Link()
    pair.clock.advance_to(10_000_000_000)
    pair.link.post(zone(capture_ns=9_000_000_000))
    pair.link.post(Pose(person=1, step=1, horizon_s=0.1, joints=((1, 0.0, 0.0, 0.0),) * 256))
    assert pair.after(0.0) == []
    assert (pair.link.counters.decimated, pair.link.counters.write_errors) == (1, 1)


def test_without_a_peer_zones_are_not_sent():
    pair = Link(isotp=None)
    pair.link.post(zone())
    assert pair.after(0.0) == []
    assert pair.link.counters.decimated == 1


@given(st.lists(st.binary(max_size=8), max_size=12))
def test_whatever_the_peer_answers_is_survived(answers):
    pair = Link()
    for step, data in enumerate(answers):
        pair.link.post(zone(2, step))
        pair.far.write(CanFrame(PEER, data))
        for frame in pair.after(0.01):
            assert frame.arbitration_id == OWN
            assert len(frame.data) == 8
    assert pair.link.connected
    pair.after(2.0)
    pair.after(0.0)
    counters = pair.link.counters
    counted = counters.messages_sent + counters.write_errors + counters.decimated
    active = pair.link._transfer is not None and pair.link._transfer.active
    assert counted + len(pair.link._slots) + active == len(answers)


# -- the listener ---------------------------------------------------------------------------------


@given(st.lists(FRAMES, max_size=12))
def test_a_listener_survives_anything_and_then_hears_the_next(garbage):
    receiver = IsoTpReceiver(0x680, False, OWN)
    for frame in garbage:
        assert receiver.feed(frame) == []
    assert [m for f in segments(zone(2)) for m in receiver.feed(f)] == [zone(2)]


@given(st.data())
def test_a_listener_takes_no_zone_with_wrong_bits(data):
    frames = segments(zone(4))
    receiver = IsoTpReceiver(0x680, False, OWN)
    at = data.draw(st.integers(0, len(frames) - 1))
    used = 8 * (7 if at == len(frames) - 1 else 8)  # the last one's padding means nothing
    bit = data.draw(st.integers(0, used - 1))
    flipped = bytearray(frames[at].data)
    flipped[bit // 8] ^= 1 << bit % 8
    frames[at] = CanFrame(OWN, bytes(flipped))
    heard = [m for f in frames for m in receiver.feed(f)]
    assert heard == []


def test_a_listener_takes_no_advice_by_this_way_and_no_zone_twice():
    receiver = IsoTpReceiver(0x680, False, OWN)
    status = make_status(cycle=0)
    assert [m for f in segments(status) for m in receiver.feed(f)] == []
    assert receiver.counters.malformed == 1
    frames = segments(zone()) * 2
    assert [m for f in frames for m in receiver.feed(f)] == [zone()]
    assert receiver.counters.counter_errors == 1


def test_a_lost_segment_costs_its_message_alone():
    sender, receiver = Profile4Sender(255), IsoTpReceiver(0x680, False, OWN)
    first, second = segments(zone(step=1), sender), segments(zone(step=2), sender)
    del first[5]
    assert [m for f in first + second for m in receiver.feed(f)] == [zone(step=2)]
    assert receiver.counters.incomplete >= 1


def test_a_listener_of_the_link_decodes_both_ways_of_sending():
    receiver = CanLink.receiver(CanLinkSettings(name="l", interface="virtual", channel="x"))
    pair = Link()
    for message in (zone(), Schema(1, 2)):
        pair.link.post(message)
    frames = pair.after(0.0)
    pair.far.write(GO_ON)
    heard = [m for f in frames + pair.after(0.0) for m in receiver.feed(f)]
    assert heard == [Schema(1, 2), zone()]


def test_without_can_isotp_one_line_says_what_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, "isotp", None)
    with pytest.raises(LinkError, match=r"pip install 'hri-predict\[isotp\]'"):
        Link()
    assert not can_isotp.is_available()
    plain = CanLink.receiver(CanLinkSettings(name="l", interface="virtual", channel="x"))
    assert type(plain) is CanReceiver


def test_the_example_of_the_protocol_is_what_is_sent():
    text = PROTOCOL.read_text(encoding="utf-8").partition("### Classic: ISO-TP to one peer")[2]
    rows = re.findall(r"\| `16#(6C[67])` \| `([0-9A-F ]+)` \|", text)
    example = [CanFrame(int(i, 16), bytes.fromhex(data)) for i, data in rows]
    assert [f for f in example if f.arbitration_id == PEER] == [GO_ON]
    assert [f for f in example if f.arbitration_id == OWN] == segments(EXAMPLE)


@pytest.mark.realtime
@pytest.mark.long
def test_the_listen_command_shows_zones_that_come_by_isotp():
    """A link, its peer of can-isotp's, and a third that listens, over a pseudo-terminal."""
    master, path = open_pty()
    tap = SlcanAdapter(master)
    tap.open()
    command = [sys.executable, "-m", "hri_predict", "listen", f"can:slcan:{path}"]
    listening = subprocess.Popen(
        [*command, "--listen-only", "--json"], stdout=subprocess.PIPE, text=True
    )
    try:
        eventually(lambda: (tap.read(0.05), tap.channel_open)[1])
        assert tap.listen_only
        with connected("virtual", isotp={"peer_id": PEER}) as (link, controller):
            link.post(Schema(SCHEMA_VERSION, SCHEMA_HASH))
            eventually(lambda: controller.heard)
            link.post(zone())
            eventually(lambda: controller.heard_of(Zone))
            for frame in controller.frames:
                tap.write(frame)
        assert listening.stdout
        for line in listening.stdout:
            shown = json.loads(line)
            if shown["message"] == "zone":
                break
        assert (shown["person"], shown["step"], len(shown["capsules"])) == (7, 2, 21)
    finally:
        listening.terminate()
        listening.wait(20)
        tap.close()


def test_listening_only_is_refused_where_it_makes_no_sense():
    with pytest.raises(ConfigError, match="--listen-only: only for CAN"):
        listen(link="serial:/dev/ttyX0", listen_only=True)
    with pytest.raises(LinkError, match="no such mode for 'gs_usb'"):
        listen(link="can:gs_usb:0", listen_only=True)
    with pytest.raises(ConfigError, match=r"isotp\.id 0x680"):
        listen(link="can:virtual:nobody", isotp_id=0x680)


@pytest.mark.realtime
def test_segments_of_another_id_are_heard_where_one_says_so(capsys):
    bus = CanTransport(interface="virtual", channel="another")
    bus.open()

    def play() -> None:
        for frame in segments(zone()):
            bus.write(dataclasses.replace(frame, arbitration_id=0x123))

    playing = threading.Timer(0.2, play)
    playing.start()
    listen(link="can:virtual:another", isotp_id=0x123, seconds=1.0, as_json=True)
    playing.join()
    bus.close()
    shown = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    assert [line["message"] for line in shown].count("zone") == 1


def test_what_the_peer_takes_is_protected_as_on_a_serial_line():
    (whole,) = Profile4Sender(255).encode(zone(3))
    (serial,) = Profile4Sender().encode(zone(3))
    assert whole == serial
    assert Profile4Receiver().take(whole) == zone(3)
    (long,) = Profile4Sender(255).encode(zone(4))
    assert Profile4Receiver().take(long) is None  # no serial frame holds four
