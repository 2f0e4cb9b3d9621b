"""Sixteen people, from the source to what a controller decodes from serial and CAN FD."""

import math
from collections import Counter
from dataclasses import replace
from typing import Any

from hri_drivers.links.can.link import CanLink, CanLinkSettings
from hri_drivers.links.serial.link import SerialLink, SerialLinkSettings
from hri_predict.base.clock import VirtualClock
from hri_predict.protocol.messages import Advice, Pose, Status, Zone
from hri_predict.protocol.reasons import Reason
from hri_predict.run import assemble
from hri_predict.run.runtime import run_virtual
from hri_sim.baseline_demo import baseline_demo

PEOPLE, SECONDS = 16, 2.0
SERIAL = SerialLinkSettings(name="serial", port="none", baudrate=921_600)
CAN_FD = CanLinkSettings(name="can", interface="virtual", channel="none", fd=True)


class Wire:
    """Takes all that is written, and says nothing."""

    def __init__(self):
        self.written = []

    def open(self): ...

    def close(self): ...

    def read(self, timeout_s):
        return []

    def write(self, unit):
        self.written.append(unit)


def cell(links, count, **node):
    """Everybody stands on a circle of 2.5 m around a robot that needs no controller."""
    demo = baseline_demo()
    at = [2 * math.pi * k / 16 for k in range(count)]
    people = [
        {"start": [2.5 * math.cos(a), 2.5 * math.sin(a)], "script": [{"do": "wait", "seconds": 99}]}
        for a in at
    ]
    config = demo.with_source(demo.source.model_dump() | {"people": people, "rate_hz": 25.0})
    robot = config.node.robots[0].model_dump() | {
        "motion": {"kind": "trajectory", "file": "pick_and_place"}
    }
    settings = {
        "robots": [type(config.node.robots[0]).model_validate(robot)],
        "people": config.node.people.model_copy(update={"exits": [], "entrances": None}),
    }
    return replace(config, links=links, node=config.node.model_copy(update=settings | node))


def test_sixteen_people_are_followed_judged_and_told():
    wires = {"serial": Wire(), "can": Wire()}
    assembly = assemble.build(
        cell((SERIAL, CAN_FD), PEOPLE), VirtualClock(10**9), transports=wires, deadline=False
    )
    run_virtual(assembly, duration_s=SECONDS)
    assert assembly.node.assess_failures == 0
    receivers: list[Any] = [SerialLink.receiver(SERIAL), CanLink.receiver(CAN_FD)]
    for link, receiver in zip(assembly.links, receivers, strict=True):
        heard = [message for unit in wires[link.name].written for message in receiver.feed(unit)]
        _everybody_is_told(heard)
        assert link.counters.superseded == link.counters.write_errors == 0
        assert link.counters.decimated > 0
        assert receiver.counters.crc_errors == receiver.counters.counter_errors == 0


def _everybody_is_told(heard):
    counts = Counter(type(message) for message in heard)
    # each tick and twice until the next, and the announcements of start and stop
    assert counts[Status] == counts[Advice] == 3 * 25 * SECONDS + 2
    told = [m for m in heard if isinstance(m, Status)][10:-1]
    assert {m.people for m in told} == {15}  # which means 15 or more
    assert not {m.reason for m in told} & {Reason.TOO_MANY_PEOPLE, Reason.LOAD_SHED}
    everybody = set(range(1, PEOPLE + 1))
    for sort in (Zone, Pose):  # few fit, and everybody gets a turn
        assert {m.person for m in heard if isinstance(m, sort)} == everybody


def test_one_more_than_configured_makes_the_advice_unknown():
    people = baseline_demo().node.people.model_copy(update={"exits": [], "max_people": 15})
    wire, config = Wire(), cell((SERIAL,), PEOPLE, people=people)
    assembly = assemble.build(
        config, VirtualClock(10**9), transports={"serial": wire}, deadline=False
    )
    run_virtual(assembly, duration_s=1.0)
    receiver = SerialLink.receiver(SERIAL)
    heard = [m for unit in wire.written for m in receiver.feed(unit) if isinstance(m, Status)]
    assert {m.reason for m in heard[10:-1]} == {Reason.TOO_MANY_PEOPLE}
