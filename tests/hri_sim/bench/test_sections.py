"""Each section runs in a tiny configuration, and its rows have the shape that they promise."""

import math

import pytest

from hri_sim.bench import running, scaling
from hri_sim.bench.command import SECTIONS
from hri_sim.bench.rows import Row, Scope

TINY = Scope(
    seconds=0.2,
    baseline="zero_velocity",
    network="constant_velocity",  # starts at once; what is measured is the same
    predictors=("mixer",),
    batches=(1, 2),
    people=(1, 2),
    joint_maps=("coco17", "mediapipe33"),
    horizons_s=(0.4, 0.8),
    robots=(1, 2),
    rates_hz=(50.0, 100.0),
    wires=1,
    age_rates_hz=(100.0,),
    episodes=0,
    cold=False,
)


def rows_of(name: str) -> dict[str, Row]:
    rows = list(SECTIONS[name].rows(TINY))
    found = {row.part: row for row in rows}
    assert len(found) == len(rows), "each part is named once, or runs cannot be compared"
    for row in rows:
        assert row.note == "" or row.p50 is not None, row
        if row.p50 is not None and row.p99 is not None and row.max is not None and row.unit != "x":
            assert row.p50 <= row.p99 <= row.max, row
    return found


def test_parts_and_stages_of_the_risk():
    found = rows_of("parts")
    stages = [found[f"risk, {stage}"].p50 for stage in ("zones", "separation", "levels")]
    assert all(stage is not None and stage > 0 for stage in stages)
    assert found["tick of the demo, without inference"].aim_of == "p99"
    assert found["encode Status, CAN FD"].unit == "µs"
    assert "decode Zone, classic CAN" not in found


@pytest.mark.realtime
@pytest.mark.long
def test_scaling_along_each_axis():
    found = rows_of("scaling")
    assert {row.axis for row in found.values()} - {""} == {
        "people",
        "joints",
        "horizon, ms",
        "robots",
        "rate, Hz",
    }
    growth = found["zero_velocity, people: 2 over 1"]
    one, two = (found[f"zero_velocity, people: {n}"].p50 for n in (1, 2))
    assert one
    assert two
    assert growth.p50 == pytest.approx(two / one)
    assert growth.aim == pytest.approx(2 / 3)
    power = found["zero_velocity, people: power"].p50
    assert power == pytest.approx(math.log2(two / one))


@pytest.mark.long
def test_a_scaled_cell_sees_all_its_people():
    case = scaling._case("zero_velocity", 16, {"people": 16})
    case.open()
    snapshot = case.assembly.node._people.snapshot(case.assembly.clock.now_ns())
    assert len(snapshot.ids) == 16
    case.assembly.source.close()


@pytest.mark.realtime
@pytest.mark.long
def test_a_node_is_heard_in_another_process():
    """Jitter, load and start look at the same runs."""
    found = rows_of("jitter")
    busy = "serial 921600, inference busy"
    node, bare, over = (found[f"{busy}{rest}"] for rest in ("", ": bare loop", ": over bare"))
    assert node.more["stamps"] == "receiver's clock after a blocking read"
    assert node.p50 is not None
    assert bare.p50 is not None
    assert over.p50 == pytest.approx(node.p50 / bare.p50)
    looked_at = found["serial 921600, looked at"]
    assert min(looked_at.more["seen_bytes"].values()) > 0
    hooks = looked_at.more["alerts"]
    assert len(hooks) == 3
    assert not any(hook["delivered"] for hook in hooks)
    load = rows_of("load")
    groups = ("loop", "busiest other thread", "other threads", "helper processes")
    parts = sum(load[f"zero_velocity: {group}"].p50 or 0.0 for group in groups)
    assert load["zero_velocity: whole node"].p50 == pytest.approx(parts)
    assert parts > 0
    start = rows_of("start")
    assert (start["zero_velocity: first advice"].p50 or 0) > 0
    assert (start["zero_velocity: resident"].p50 or 0) > 20  # numpy alone has that


def test_a_wire_that_is_not_here_is_a_note(monkeypatch):
    monkeypatch.setattr(running, "heard", lambda *_, watched=False: "no multicast here")
    rows = list(running.jitter(TINY))
    assert [row.note for row in rows] == ["no multicast here"] * 3


@pytest.mark.realtime
def test_age_is_the_sum_of_its_stages():
    found = rows_of("age")
    name = "serial 921600, 100 Hz, zero_velocity"
    stages = [found[f"{name}: {stage}"] for stage in ("wait", "node", "inference", "link", "age")]
    assert all(stage.p50 is not None for stage in stages)
    # of each scene it is the sum; so in the median it is more than any stage's, but for rounding
    assert (stages[-1].p50 or 0) + 0.001 >= max(stage.p50 or 0 for stage in stages[:-1])
    assert stages[0].floor == 5.0  # half of 10 ms
    assert stages[-1].aim == 25.0


@pytest.mark.realtime
@pytest.mark.long
def test_predictors_with_memory_and_start():
    found = rows_of("predictors")
    assert "mixer torch, 2 people, 25 Hz" in found
    assert "mixer torch, 1 person, hot" in found
    resident = found["mixer torch, resident"]
    assert resident.p50 is not None
    assert resident.floor is not None
    assert resident.p50 > resident.floor


@pytest.mark.realtime
@pytest.mark.long
def test_speed():
    found = rows_of("speed")
    assert (found["replay --speed max, zero_velocity"].p50 or 0) > 0
    assert found["replay --speed max, zero_velocity"].more_is_better
