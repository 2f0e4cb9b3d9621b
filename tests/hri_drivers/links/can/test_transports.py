"""The same of every CAN link, back to back over every transport that works without hardware.

udp_multicast needs a network in which nobody else listens: the last test runs this file again in a
network namespace, where ``HRI_UDP_MULTICAST`` says that it is there.
"""

import os
import sys
from pathlib import Path
from typing import Any

import pytest

from hri_predict.protocol.can import CanFrame, CanSender
from hri_predict.protocol.messages import (
    Acknowledge,
    Advice,
    Level,
    NodeState,
    Pose,
    Schema,
    Status,
    Zone,
    ZoneCapsule,
)
from hri_predict.protocol.reasons import Reason
from tests.hri_drivers.links.can.can_pairs import connected
from tests.messages import make_advice, make_state
from tests.namespaces import in_namespace, why_not
from tests.waiting import eventually

IN_NAMESPACE = "HRI_UDP_MULTICAST" in os.environ
INTERFACES = ["udp_multicast"] if IN_NAMESPACE else ["virtual", "slcan"]
KINDS = [interface + fd for interface in INTERFACES for fd in ("", " fd")]
PEER = {"peer_id": 0x6C7}
STATE = make_state((0.25,) * 6, counter=9, robot=1)
STATUS = Status(node_state=NodeState.RUNNING, reason=Reason.NONE, people=1, predictor=0, cycle=7)
ERRORS = ["crc_errors", "counter_errors", "malformed", "incomplete", "write_errors"]
ERRORS += ["unexpected"]

pytestmark = pytest.mark.realtime


@pytest.fixture(params=KINDS)
def kind(request):
    return request.param


def advice(latch_id: int = 0) -> Advice:
    return make_advice(
        Level.SLOW, Reason.PERSON_NEAR, robot=1, latch_id=latch_id, speed_limit_m_s=0.25
    )


def zone(step: int, capsules: int = 21) -> Zone:
    return Zone(
        person=40_000 + step,
        step=step,
        horizon_s=0.04 * step,
        capsules=tuple(
            ZoneCapsule(i, (i / 100, -1.0, 0.5), (1.0, i / 50, 2.0), 0.125) for i in range(capsules)
        ),
        age_s=0.02,
    )


def pose(step: int, joints: int = 21) -> Pose:
    return Pose(
        person=3,
        step=step,
        horizon_s=0.04 * step,
        joints=tuple((i, i / 100, 0.5, 1.5) for i in range(joints)),
        age_s=0.02,
    )


def received(link: Any, count: int) -> list[Any]:
    got: list[Any] = []

    def enough() -> bool:
        got.extend(r.message for r in link.take())
        return len(got) >= count

    eventually(enough)
    return got


def no_errors(link: Any) -> bool:
    return not any(getattr(link.counters, name) for name in ERRORS)


def test_messages_pass_both_ways(kind):
    with connected(kind) as (link, controller):
        for message in (advice(5), STATUS, Schema(1, 2)):
            link.post(message)
        eventually(lambda: len(controller.heard) == 3)
        assert {type(m) for m in controller.heard} == {Advice, Status, Schema}
        controller.say(STATE, Acknowledge(5, 77))
        assert received(link, 2) == [STATE, Acknowledge(5, 77)]
        link.post(advice(6))
        eventually(lambda: controller.heard[-1] == controller.heard_of(Advice)[-1])
        eventually(lambda: controller.heard_of(Advice)[-1].latch_id == 6)
        assert controller.heard_of(Advice)[-1].echo == 9
        assert no_errors(link)


def test_29_bit_ids_from_any_base(kind):
    with connected(kind, base_id=0x18AB_0000, extended=True) as (link, controller):
        link.post(advice(5))
        controller.say(STATE)
        eventually(lambda: controller.heard)
        assert received(link, 1) == [STATE]
        assert {f.extended for f in controller.frames} == {True}
        assert controller.frames[0].arbitration_id == 0x18AB_0008


@pytest.mark.parametrize("extended", [False, True])
def test_whole_bodies_arrive_whole(kind, extended):
    """On FD in several complete frames, on classic CAN by ISO-TP to a peer of can-isotp's."""
    fd = kind.endswith("fd")
    ids: dict[str, Any] = {"base_id": 0x12_0000 if extended else 0x300, "extended": extended}
    peer: dict[str, Any] = {} if fd else {"isotp": {"peer_id": ids["base_id"] + 0x47}}
    with connected(kind, **ids, **peer) as (link, controller):
        sent: list[Any] = [zone(1), pose(2), zone(3, 0), zone(4, 1)]
        for message in sent:
            link.post(message)
        frames = 7 + 3 + 1 + 1 if fd else 4
        eventually(lambda: len(controller.heard) == frames)
        for message in sent:
            parts = [m for m in controller.heard if m.step == message.step]
            items = "capsules" if isinstance(message, Zone) else "joints"
            assert tuple(i for m in parts for i in getattr(m, items)) == getattr(message, items)
            assert {(m.person, m.age_s) for m in parts} == {(message.person, message.age_s)}
        eventually(lambda: link.counters.messages_sent == 4)
        assert no_errors(link)
        assert link.counters.decimated == 0


def test_advice_goes_on_beside_zones(kind):
    peer: dict[str, Any] = {} if kind.endswith("fd") else {"isotp": PEER}
    with connected(kind, **peer) as (link, controller):
        for latch_id in range(1, 11):
            link.post(zone(latch_id))
            link.post(advice(latch_id))
            eventually(
                lambda: (
                    controller.heard_of(Advice)
                    and controller.heard_of(Advice)[-1].latch_id == latch_id  # noqa: B023
                )
            )
        eventually(lambda: {z.step for z in controller.heard_of(Zone)} == set(range(1, 11)))
        assert no_errors(link)


def test_what_is_not_ours_or_broken_costs_nothing_else(kind):
    fd = kind.endswith("fd")
    sender = CanSender(fd)
    with connected(kind) as (link, controller):
        for base in (0x100, 0x67F, 0x6E0, 0x7FF):  # others' frames, ids at the edges among them
            controller.wire.write(CanFrame(base, b"12345678"))
        good = sender.encode(STATE)
        broken = CanFrame(good[0].arbitration_id, good[0].data[:-1] + b"\xff", fd=fd)
        short = CanFrame(0x6C1, b"1")
        wrong_kind = CanFrame(0x6C1, b"12345678", fd=not fd)
        for frame in (broken, short, *([wrong_kind] if fd else []), *sender.encode(STATE)):
            controller.wire.write(frame)
        assert received(link, 1) == [STATE]
        counters = link.counters
        assert counters.crc_errors + counters.malformed == 2 + fd
        assert counters.ignored == 4
        assert link.connected


def test_a_link_that_only_listens_hears_and_sends_nothing(kind):
    with connected(kind, listen_only=True) as (link, controller):
        for message in (advice(1), STATUS, zone(1)):
            link.post(message)
        controller.say(STATE)
        assert received(link, 1) == [STATE]
        assert controller.frames == []
        assert (link.counters.messages_sent, link.counters.decimated) == (0, 3)
        if kind.startswith("slcan"):  # the adapter was told not even to acknowledge
            assert controller.wire.listen_only


@pytest.mark.long
@pytest.mark.skipif(IN_NAMESPACE, reason="is what runs this")
def test_the_same_over_udp_multicast():
    pytest.importorskip("msgpack", reason="python-can's udp_multicast needs msgpack")
    if reason := why_not():
        pytest.skip(reason)
    root = Path(__file__).resolve().parents[4]
    pytest_again = f"{sys.executable} -m pytest -o addopts=--import-mode=importlib {__file__}"
    done = in_namespace(f"cd {root} && HRI_UDP_MULTICAST=1 exec {pytest_again}", 170)
    assert done.returncode == 0, done.stdout[-2000:] + done.stderr[-2000:]
    assert " 14 passed" in done.stdout
