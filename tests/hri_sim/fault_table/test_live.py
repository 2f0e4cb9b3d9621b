"""Live sources with faults, over real sockets; that reactions are in time, ``bench`` measures."""

from dataclasses import replace

import pytest

from hri_sim.fault_table.live import CASES, LiveCase, run_live_case, run_live_faults
from hri_sim.senders.live_ends import LIVE_ENDS

pytestmark = pytest.mark.realtime
ROS2 = pytest.mark.skipif("ros2" not in LIVE_ENDS, reason="needs the extra ros2")


def case(name: str) -> LiveCase:
    """A case of the table, shorter, and however long the reaction takes on a busy machine."""
    (found,) = [c for c in CASES if c.name.startswith(name)]
    return replace(found, limit_ms=None, length_s=1.0)


@pytest.mark.parametrize(
    ("kind", "name", "counters"),
    [
        ("udp", "unplugged", {"lost"}),
        pytest.param("udp", "flooded", {"overrun"}, marks=pytest.mark.long),
        pytest.param("udp with a key", "clock steps back", set(), marks=pytest.mark.long),
        pytest.param("udp with a key", "restarted", {"restarts"}, marks=pytest.mark.long),
        *(
            pytest.param("ros2", name, counters, marks=[pytest.mark.long, ROS2])
            for name, counters in (
                ("unplugged", set()),
                ("delayed", set()),
                ("flooded", {"overrun"}),
                ("1 bit", set()),
                ("restarted", set()),
                ("clock steps back", {"restarts"}),
            )
        ),
    ],
)
def test_a_fault_leads_to_what_the_table_says_and_is_counted(kind, name, counters):
    outcome = run_live_case(kind, case(name))
    assert outcome.fine, outcome
    assert outcome.clear_while_near == 0
    assert counters <= outcome.counted.keys()
    assert name == "1 bit" or "false_scenes" not in outcome.counted


@pytest.mark.long
def test_damage_is_counted_and_never_believed():
    wet = replace(case("1 bit"), amount=1e-3)  # nine of ten datagrams
    outcome = run_live_case("udp", wet)
    assert outcome.fine, outcome
    assert outcome.counted["crc_errors"] + outcome.counted.get("malformed", 0) >= 10
    assert "false_scenes" not in outcome.counted


def test_every_kind_of_source_is_in_the_table():
    assert {"udp", "udp with a key"} <= LIVE_ENDS.keys()
    assert list(run_live_faults("nothing has this name")) == []
