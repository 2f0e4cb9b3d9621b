"""Writes of a PLC in another process: both edges of the button, and choices of sets."""

import time
from dataclasses import replace
from typing import Any

import pytest

pytest.importorskip("pymodbus", reason="pymodbus is not installed: the link cannot be used")
from hri_predict.protocol.messages import Acknowledge, SetChoice
from tests.hri_drivers.links.modbus.test_link import link, plc
from tests.hri_drivers.links.plant.test_codec import STATUS
from tests.waiting import eventually

__all__ = ["link", "plc"]  # the fixtures
pytestmark = pytest.mark.realtime


def test_a_plc_chooses_a_set_and_reads_what_is_in_force(link, plc):
    server = link()
    there = plc(server)
    for counter in (1, 2):  # the first says only where the counter stands
        assert "words" in there.ask(write=[1010, [2, counter]])
    heard: list[Any] = []

    def chosen() -> bool:
        heard.extend(r.message for r in server.take())
        return bool(heard)

    eventually(chosen)
    assert heard == [SetChoice(2)]
    shown = replace(STATUS, set_number=2, set_hash=0x01020304)

    def read() -> Any:
        server.post(shown)
        return there.ask(read=[20, 3])["words"]

    assert eventually(lambda: (words := read())[0] and words) == [2, 0x0102, 0x0304]
    time.sleep(0.1)  # the silence time-out of 60 ms, in real time
    assert there.ask(read=[20, 3])["words"] == [0, 0, 0]


def test_both_edges_of_the_button_reach_the_node(link, plc):
    server = link()
    there = plc(server)
    for latch_id in (77, 77, 0, 0):  # as an I/O scanner writes: in each cycle
        there.ask(write=[1001, [latch_id, 0, 9]])
    there.ask(write=[1001, [0, 0, 8]])  # of no press
    there.ask(write=[1001, [0, 0, 0]])
    there.ask(write=[1001, [78, 0, 10]])
    heard: list[Any] = []

    def all_three() -> bool:
        heard.extend(r.message for r in server.take())
        return len(heard) >= 3

    eventually(all_three)
    assert heard == [Acknowledge(77, 9), Acknowledge(0, 9), Acknowledge(78, 10)]
